"""Notes on a study of an FMU: what is allowed and can still make its result wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from commonrail.arrays import Floats
from commonrail.foreign.data import FmuData, FmuInputs
from commonrail.foreign.fmu import Fmu
from commonrail.units import to_text

__all__ = ["notes_on"]


_NEAR = 1e-6  # share of a step by which rounding may bring samples closer together


def notes_on(fmu: Fmu, data: Sequence[FmuData], step: float) -> tuple[str, ...]:
    """Sentences on samples closer together than communication points, and on inputs that the FMU need not take.

    Parameters
    ----------
    fmu : Fmu
    data : sequence of FmuData
    step : float
        Communication step [s].
    """
    return tuple(sentence for one in data for sentence in _on(fmu, one, step))


def _on(fmu: Fmu, data: FmuData, step: float) -> Iterator[str]:
    inputs = data.runs[0].inputs  # all simulations of a data set share them
    if closer := _closer(data.runs[0].times, step):
        yield f"The samples of {data.name} {closer}: outputs are linear between them; lower the step."
    if inputs is None:
        return
    if closer := _closer(inputs.times, step):
        yield f"The inputs of {data.name} {closer}: inputs are held between them; lower the step."
    yield from _beyond(fmu, data.name, inputs)


def _closer(times: Floats, step: float) -> str:
    """Words on times that are closer together than communication points; empty if they are not."""
    apart = float(np.median(np.diff(times))) if len(times) > 1 else math.inf
    if apart >= step * (1.0 - _NEAR):
        return ""
    return f"are {to_text(apart, 's')} apart, and the communication points {to_text(step, 's')}"


def _beyond(fmu: Fmu, data: str, inputs: FmuInputs) -> Iterator[str]:
    """Sentence on each input whose course leaves the limits that the FMU states, which noise can do."""
    for name, course in inputs.values.items():
        ends = ((np.min(course), "smallest"), (np.max(course), "largest"))
        found = (fmu.outside(name, float(value), f"{data}: the {word} value") for value, word in ends)
        yield from (f"{sentence}." for sentence in found if sentence)
