"""Features of the injection curves of a run: measured and simulated, by one function with one set of levels."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.errors import InputError
from commonrail.files.run_folder import read_fit, read_run
from commonrail.kinds import RateData
from commonrail.kinds.records import MEASURED
from commonrail.signals.features import Features, features
from commonrail.signals.rate_trace import rate_trace
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
    """Features of all injection curves of a run folder.

    Parameters
    ----------
    folder : Path
    label : str
        Simulated model, a label of the traces: "best", "start" or "rigid".
    settings : FeatureSettings, optional

    Raises
    ------
    InputError
        If the folder is no run folder, or has no curve with that label.
    """
    _, traces = read_run(folder)
    curves = [d for d in read_fit(folder)[0].data if isinstance(d, RateData) and label in traces.get(d.name, {})]
    if not curves:
        known = sorted({name for trace in traces.values() for name in trace} - {MEASURED, "time_s"})
        raise InputError(
            f'{folder}: there are no injection curves simulated as "{label}"'
            + (f"; there are {', '.join(known)}." if known else "; the run has no injection curves.")
        )
    return [_compared(curve, traces[curve.name][label], settings) for curve in curves]


def _compared(
    curve: RateData, rate: np.ndarray[tuple[int], np.dtype[np.float64]], settings: FeatureSettings | None
) -> ComparedFeatures:
    trace = rate_trace(curve)
    measured = features(trace, settings=settings)
    simulated = features(trace.with_rate(rate), settings=settings, levels=measured.levels)
    return ComparedFeatures(curve.name, curve.role.value, curve.synthetic, measured, simulated)
