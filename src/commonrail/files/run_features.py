"""Features of the injection curves of a run: measured and simulated, by one function with one set of levels."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.calibration.study import Study
from commonrail.errors import InputError
from commonrail.files.run_folder import read_fit, read_run
from commonrail.files.traces_file import TIME
from commonrail.kinds import DataSet, FeatureData, RateData
from commonrail.kinds.records import MEASURED
from commonrail.kinds.simulator import ITSELF, Simulator
from commonrail.signals.features import features
from commonrail.signals.rate_trace import rate_trace
from commonrail.signals.result import Features
from commonrail.signals.settings import FeatureSettings

__all__ = ["ComparedFeatures", "run_features"]


class ComparedFeatures(NamedTuple):
    """Features of one data set, and of the simulation that was compared with it.

    Attributes
    ----------
    name, role, synthetic : str
        Of the data set.
    measured, simulated : Features
        The simulated ones with the levels of the measured ones.
    """

    name: str
    role: str
    synthetic: str
    measured: Features
    simulated: Features


def run_features(folder: Path, label: str = "best", settings: FeatureSettings | None = None) -> list[ComparedFeatures]:
    """Features of all traces of a run folder: injection curves, and data sets of features that have a trace.

    Parameters
    ----------
    folder : Path
    label : str
        Simulated model, a label of the traces: "best", "start" or "rigid".
    settings : FeatureSettings, optional
        Of injection curves; a data set of features keeps its own.

    Raises
    ------
    InputError
        If the folder is no run folder, or has no trace with that label.
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
