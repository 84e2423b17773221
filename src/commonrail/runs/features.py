"""Features of traces as CSV and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.output import write_csv
from commonrail.base.text import FieldUnit, field_unit
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet
from commonrail.data.curves.data import RateData
from commonrail.data.feature_targets.data import FeatureData
from commonrail.data.features.features import features
from commonrail.data.features.rate_trace import rate_trace
from commonrail.data.features.result import Features, unit_of
from commonrail.data.features.settings import FeatureSettings
from commonrail.data.features.shots import ShotStatistic
from commonrail.data.features.table import features_of_traces
from commonrail.data.records import MEASURED
from commonrail.data.simulator import ITSELF, Simulator
from commonrail.runs.folder import read_fit, read_run
from commonrail.runs.traces import TIME

# Features of the injection curves of a run: measured and simulated, by one function with one set of levels.


class ComparedFeatures(NamedTuple):
    """Features of one data set, and of the simulation compared with it, whose levels are those of the measured ones."""

    name: str
    role: str
    synthetic: str
    measured: Features
    simulated: Features


def run_features(folder: Path, label: str = "best", settings: FeatureSettings | None = None) -> list[ComparedFeatures]:
    """Features of all traces of a run folder: injection curves, and data sets of features that have a trace.

    `label` is that of the simulated model: "best", "start" or "rigid". The settings are of injection curves; a data set
    of features keeps its own. `InputError` if the folder is no run folder, or has no trace with that label.
    """
    _, traces = read_run(folder)
    study, best = read_fit(folder)
    models = {"best": np.array([[best[name] for name in study.space.names]]), "start": None}
    found = []
    for data in study.data:
        if isinstance(data, RateData) and label in traces.get(data.name, {}):
            found.append(_compared(data, data, traces[data.name][label], settings))
        elif isinstance(data, FeatureData) and data.levels is not None and label in models:
            rates = _simulated(study, data.curve, models[label])
            found.append(_compared(data, data.curve, rates, data.settings))
    if not found:
        known = sorted({name for trace in traces.values() for name in trace} - {MEASURED, TIME})
        raise InputError(
            f'{folder}: there are no traces simulated as "{label}"'
            + (f"; there are {', '.join(known)}." if known else "; the run has no traces.")
        )
    return found


def _simulated(study: Study, curve: RateData, values: Floats | None) -> Floats:
    """Simulated rate of a curve with the values of the free parameters, or of the injector as it is."""
    names = () if values is None else study.space.names
    simulator = Simulator(study.injector, names, study.time_step, same_bits=study.same_bits)
    return np.asarray(curve.simulated(simulator, ITSELF if values is None else values)[0])


def _compared(data: DataSet, curve: RateData, rate: Floats, settings: FeatureSettings | None) -> ComparedFeatures:
    trace = rate_trace(curve)
    measured = features(trace, settings=settings)
    simulated = features(trace.with_rate(rate), settings=settings, levels=measured.levels)
    return ComparedFeatures(data.name, data.role.value, data.synthetic, measured, simulated)


def write_features(path: Path, found: Mapping[str, Features]) -> None:
    """Write a row for each injection of each trace, of features by the name of the trace; rates of one unit."""
    (unit,) = {one.unit for one in found.values()}
    units = {name: field_unit(unit_of(name, unit)) for name in features_of_traces()}
    header = [
        "trace",
        "injection",
        "energising",
        *(f"{name} [{shown.name}]" for name, shown in units.items()),
        "status",
    ]

    def rows() -> Iterator[list[str]]:
        for trace, one in found.items():
            if not one.injections:
                yield [trace, "", "", *[""] * len(units), one.status.value]
            for i, injection in enumerate(one.injections, start=1):
                values = (_text(injection.values[name], shown) for name, shown in units.items())
                status = "; ".join(status.value for status in injection.statuses) or "ok"
                yield [trace, str(i), str(injection.energising or ""), *values, status]

    write_csv(path, [_note(name, one) for name, one in found.items()], header, rows())


def write_compared(path: Path, found: Sequence[ComparedFeatures]) -> None:
    """Write a row for each feature of each injection: measured, simulated, and their difference."""

    def rows() -> Iterator[list[str]]:
        for one in found:
            for i in range(1, len(one.measured.energisings) + 1):
                for name in features_of_traces():
                    shown = field_unit(unit_of(name))
                    pair = one.measured.value(name, i), one.simulated.value(name, i)
                    texts = (_text(value, shown) for value in (*pair, pair[1] - pair[0]))
                    yield [one.name, str(i), name, shown.name, *texts]

    notes = [note for one in found for note in (_note(one.name, one.measured), *_synthetic(one))]
    write_csv(path, notes, ["data", "injection", "feature", "unit", "measured", "simulated", "difference"], rows())


def features_record(found: Mapping[str, Features], shots: Sequence[ShotStatistic]) -> dict[str, Any]:
    """Record of the features of a file [SI] by the name of the trace, and of the shots over the traces."""
    return {
        "schema": 1,
        "kind": "features",
        "traces": [{"name": name, **one.record()} for name, one in found.items()],
        **({"shots": [one.record() for one in shots]} if shots else {}),
    }


def compared_record(found: Sequence[ComparedFeatures]) -> dict[str, Any]:
    """Record of the features of a run [SI]."""
    return {
        "schema": 1,
        "kind": "features",
        "data": [
            {
                "name": one.name,
                "role": one.role,
                "synthetic": one.synthetic,
                "measured": one.measured.record(),
                "simulated": one.simulated.record(),
            }
            for one in found
        ],
    }


def _note(name: str, one: Features) -> str:
    shown, levels = field_unit(one.unit), one.levels
    threshold = f"{levels.threshold * shown.factor:.6g} {shown.name}"
    return f"{name}: threshold {threshold}, averaged over {levels.width * 1e6:.6g} us"


def _synthetic(one: ComparedFeatures) -> list[str]:
    return [f"{one.name}: synthetic, not measured: {one.synthetic}"] if one.synthetic else []


def _text(value: float, shown: FieldUnit) -> str:
    return f"{value * shown.factor:.9g}" if math.isfinite(value) else ""
