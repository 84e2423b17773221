"""Read traces for features from a file, one column per shot; write features as CSV and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.csv_output import write_csv
from commonrail.base.errors import InputError
from commonrail.base.text import FieldUnit, field_unit
from commonrail.base.units import fits, to_text
from commonrail.data.base import DataSet
from commonrail.data.curves.data import RateData
from commonrail.data.curves.samples import bounds_around
from commonrail.data.records import MEASURED
from commonrail.data.simulator import ITSELF, Simulator
from commonrail.engine.operating_point import Energising
from commonrail.plugins.features.rate_trace import RATE_UNITS, RateTrace, rate_trace
from commonrail.plugins.features.result import Features, feature_unit
from commonrail.plugins.features.run import find_features
from commonrail.plugins.features.settings import FeatureSettings
from commonrail.plugins.features.shot_statistics import ShotStatistic
from commonrail.plugins.features.table import features_of_traces
from commonrail.plugins.features.targets import FeatureData
from commonrail.readers.columns import PLAIN, Column, FileForm, Sheet
from commonrail.readers.columns import unit_of as unit_in
from commonrail.readers.operating_points import named_points
from commonrail.readers.tables import open_sheet, take_each
from commonrail.runs.folder import read_fit, read_run
from commonrail.runs.traces import TIME

MOST_SHOTS = 500


class RateColumns(NamedTuple):
    """Columns of a file that hold rates, and the meaning of their samples.

    Without names all columns with the unit of a rate count; units apply if the file gives none. `centred`:
    a sample is the mean around its time, else over the interval that ends there. Only samples between the two times
    of the window [s] count.
    """

    time: str = "time"
    rates: tuple[str, ...] = ()
    time_unit: str | None = None
    rate_unit: str | None = None
    centred: bool = False
    window: tuple[float, float] | None = None
    form: FileForm = PLAIN


def read_rates(path: Path, columns: RateColumns, energisings: Sequence[Energising] = ()) -> dict[str, RateTrace]:
    """Read rates from a file, by column name.

    The energisings apply to every shot; without any, an energising time in the names of all columns is used, from
    time 0. `InputError` if the file has no rate, the window has no samples, or a name states another energising
    time.
    """
    sheet = open_sheet(path, columns.form)
    names = columns.rates or _find_rate_columns(sheet)
    if len(names) > MOST_SHOTS:
        raise InputError(f"{path}: there are {len(names)} rates, and at most {MOST_SHOTS} are read; name those wanted.")
    time = Column(columns.time, "s", columns.time_unit, increasing=True)
    rates = [Column(name, tuple(RATE_UNITS), columns.rate_unit) for name in names]
    tables = take_each(sheet, time, rates)
    if len({table.units[name] for name, table in zip(names, tables, strict=True)}) > 1:
        raise InputError(f"{path}: some rates are by mass and some by volume; choose columns of one kind.")
    energisings_by_name = _assign_energisings(path, names, tuple(energisings))
    traces = {}
    for name, table in zip(names, tables, strict=True):
        moments = table.columns[columns.time]
        before = np.concatenate(([2.0 * moments[0] - moments[1]], moments))
        bounds = bounds_around(moments) if columns.centred else before
        keep = _within(bounds, columns.window, path)
        edges = bounds[keep[0] : keep[-1] + 2]
        traces[name] = RateTrace(edges, table.columns[name][keep], table.units[name], energisings_by_name[name])
    return traces


def are_repeated(names: Sequence[str]) -> bool:
    """Return whether rates can be repeated shots: their names do not state different operating points."""
    return len({(point.rail_pressure, point.energising_time) for point in named_points(names)}) < 2


def _assign_energisings(
    path: Path, names: Sequence[str], energisings: tuple[Energising, ...]
) -> dict[str, tuple[Energising, ...]]:
    by_name = dict.fromkeys(names, energisings)
    for point in named_points(names):
        duration = point.energising_time
        if duration is None:
            continue
        if not energisings:
            by_name[point.column] = (Energising(0.0, duration),)
        elif len(energisings) > 1 or not math.isclose(energisings[0].duration, duration, rel_tol=1e-6):
            raise InputError(
                f'{path}: the name of "{point.column}" states an energising time of {to_text(duration, "s")}, but '
                f"{' and '.join(to_text(pulse.duration, 's') for pulse in energisings)} is given for all; state none "
                "to use the names, or choose only the rates measured with it."
            )
    return by_name


def _find_rate_columns(sheet: Sheet) -> tuple[str, ...]:
    """Columns that have a unit of a rate."""
    rate_names = tuple(name for name in sheet.names if any(fits(unit_in(sheet, name), unit) for unit in RATE_UNITS))
    if not rate_names:
        raise InputError(
            f'{sheet.path}: no column has the unit of a rate in its header, as in "rate [mm3/ms]"; name the columns '
            "and state their unit."
        )
    return rate_names


def _within(bounds: Floats, window: tuple[float, float] | None, path: Path) -> IndexArray:
    begin, end = (-np.inf, np.inf) if window is None else window
    keep = np.flatnonzero((bounds[:-1] >= begin) & (bounds[1:] <= end))
    if len(keep) < 4:
        raise InputError(
            f"{path}: only {len(keep)} samples lie in the window, and at least 4 are needed; the samples reach from "
            f"{1e6 * bounds[0]:.6g} µs to {1e6 * bounds[-1]:.6g} µs."
        )
    return keep


# Features of the injection curves of a run: measured and simulated, by one function with one set of levels.


class ComparedFeatures(NamedTuple):
    """Features of one data set, and of the simulation compared with it at the same levels."""

    name: str
    role: str
    synthetic: str
    measured: Features
    simulated: Features


def run_features(folder: Path, label: str = "best", settings: FeatureSettings | None = None) -> list[ComparedFeatures]:
    """Find features of all traces of a run folder: injection curves, and data sets of features with a trace.

    `label` names the simulated model: "best", "start" or "rigid". The settings apply to injection curves; data sets of
    features keep their own. `InputError` if the folder is not a run folder, or has no trace with that label.
    """
    _, traces = read_run(folder)
    study, best = read_fit(folder)
    best_values = np.array([[best[name] for name in study.space.names]])
    compared = []
    for data in study.data:
        if isinstance(data, RateData) and label in traces.get(data.name, {}):
            compared.append(_compare(data, data, traces[data.name][label], settings))
        elif isinstance(data, FeatureData) and data.levels is not None and label in ("best", "start"):
            names, values = ((), ITSELF) if label == "start" else (study.space.names, best_values)
            simulator = Simulator(study.injector, names, study.time_step, same_bits=study.same_bits)
            rate = np.asarray(data.curve.simulated(simulator, values)[0])
            compared.append(_compare(data, data.curve, rate, data.settings))
    if not compared:
        labels = sorted({name for trace in traces.values() for name in trace} - {MEASURED, TIME})
        raise InputError(
            f'{folder}: no traces are simulated as "{label}"'
            + (f"; there are {', '.join(labels)}." if labels else "; the run has no traces.")
        )
    return compared


def _compare(data: DataSet, curve: RateData, rate: Floats, settings: FeatureSettings | None) -> ComparedFeatures:
    trace = rate_trace(curve)
    measured = find_features(trace, settings=settings)
    simulated = find_features(trace.with_rate(rate), settings=settings, levels=measured.levels)
    return ComparedFeatures(data.name, data.role.value, data.synthetic, measured, simulated)


def write_features(path: Path, features: Mapping[str, Features]) -> None:
    """Write one row per injection of each trace, from features by trace name; all rates have one unit."""
    (unit,) = {features_of_trace.unit for features_of_trace in features.values()}
    units = {name: field_unit(feature_unit(name, unit)) for name in features_of_traces()}
    columns = (f"{name} [{shown.name}]" for name, shown in units.items())
    header = ["trace", "injection", "energising", *columns, "status"]

    def rows() -> Iterator[list[str]]:
        for trace, features_of_trace in features.items():
            if not features_of_trace.injections:
                yield [trace, "", "", *[""] * len(units), features_of_trace.status.value]
            for i, injection in enumerate(features_of_trace.injections, start=1):
                values = (_text(injection.values[name], shown) for name, shown in units.items())
                status = "; ".join(status.value for status in injection.statuses) or "ok"
                yield [trace, str(i), str(injection.energising or ""), *values, status]

    write_csv(path, [_note(name, features_of_trace) for name, features_of_trace in features.items()], header, rows())


def write_comparison(path: Path, compared: Sequence[ComparedFeatures]) -> None:
    """Write one row per feature of each injection: measured, simulated, and their difference."""

    def rows() -> Iterator[list[str]]:
        for data_set in compared:
            for i in range(1, len(data_set.measured.energisings) + 1):
                for name in features_of_traces():
                    shown = field_unit(feature_unit(name))
                    pair = data_set.measured.value(name, i), data_set.simulated.value(name, i)
                    texts = (_text(value, shown) for value in (*pair, pair[1] - pair[0]))
                    yield [data_set.name, str(i), name, shown.name, *texts]

    notes = []
    for data_set in compared:
        notes.append(_note(data_set.name, data_set.measured))
        notes += [f"{data_set.name}: synthetic, not measured: {data_set.synthetic}"] if data_set.synthetic else []
    write_csv(path, notes, ["data", "injection", "feature", "unit", "measured", "simulated", "difference"], rows())


def features_record(features: Mapping[str, Features], shots: Sequence[ShotStatistic]) -> dict[str, Any]:
    """Record of the features of a file [SI] by trace name, and of the shots over the traces."""
    return {
        "schema": 1,
        "kind": "features",
        "traces": [{"name": name, **item.record()} for name, item in features.items()],
        **({"shots": [item.record() for item in shots]} if shots else {}),
    }


def comparison_record(compared: Sequence[ComparedFeatures]) -> dict[str, Any]:
    """Record of the features of a run [SI]."""
    data = [
        pair._asdict() | {"measured": pair.measured.record(), "simulated": pair.simulated.record()} for pair in compared
    ]
    return {"schema": 1, "kind": "features", "data": data}


def _note(name: str, features: Features) -> str:
    shown, levels = field_unit(features.unit), features.levels
    threshold = f"{levels.threshold * shown.factor:.6g} {shown.name}"
    return f"{name}: threshold {threshold}, averaged over {levels.width * 1e6:.6g} µs"


def _text(value: float, shown: FieldUnit) -> str:
    return f"{value * shown.factor:.9g}" if math.isfinite(value) else ""
