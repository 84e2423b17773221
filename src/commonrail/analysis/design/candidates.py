"""Candidates for the next measurement: a kind of measurement at an operating point, with its cost."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.errors import ConfigurationError
from commonrail.kinds import DataSet, QuantityData, RateData, ReturnData

__all__ = ["KINDS", "MOST_CANDIDATES", "Candidate", "grid", "place_of", "planned", "usual_axes"]


KINDS = (QuantityData.kind, RateData.kind, ReturnData.kind)
MOST_CANDIDATES = 2000

_PRESSURES, _TIMES = 8, 12  # values of the usual axes
_ROUND_PRESSURE, _ROUND_TIME = 1e6, 10e-6


class Candidate(NamedTuple):
    """Measurement that could be made.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    point : OperatingPoint
    cost : float
    """

    kind: str
    point: OperatingPoint
    cost: float = 1.0


def place_of(point: OperatingPoint) -> tuple[float, float, float]:
    """Rail pressure [Pa], last energising time [s] and dwell before it [s], 0 for a single injection."""
    pulses = point.pulses
    dwell = pulses[-1].start - pulses[-2].start - pulses[-2].duration if len(pulses) > 1 else 0.0
    return float(point.initial_pressures()[0]), pulses[-1].duration if pulses else 0.0, dwell


def grid(
    like: OperatingPoint,
    rail_pressures: Sequence[float],
    energising_times: Sequence[float],
    dwells: Sequence[float] = (),
    first_energising_time: float = 0.0,
) -> list[OperatingPoint]:
    """Operating points of all combinations.

    Parameters
    ----------
    like : OperatingPoint
        Gives the other pressures, and the drive.
    rail_pressures : sequence of float
        [Pa].
    energising_times : sequence of float
        [s].
    dwells : sequence of float
        Between the end of a first energising and the begin of the second [s]; none for single injections.
    first_energising_time : float
        [s].

    Raises
    ------
    ConfigurationError
        If dwells are given without a first energising time, or a value lies beyond its limits.
    """
    if len(dwells) and not first_energising_time > 0.0:
        raise ConfigurationError("Dwells need the energising time of the first injection; give it too.")
    found = []
    for rail, time, dwell in itertools.product(rail_pressures, energising_times, dwells if len(dwells) else [None]):
        pulses = (
            (Energising(0.0, time),)
            if dwell is None
            else (Energising(0.0, first_energising_time), Energising(first_energising_time + dwell, time))
        )
        found.append(replace(like, rail_pressure=rail, energisings=pulses, horizon=None, start=0.0))
    return found


def usual_axes(data: Sequence[DataSet]) -> tuple[Floats, Floats]:
    """Rail pressures [Pa] and energising times [s] within the range of data, in round numbers.

    Raises
    ------
    ConfigurationError
        If the data cover one rail pressure and one energising time alone.
    """
    places = np.array([place_of(point) for one in data for point in one.points])
    pressures = _rounded(places[:, 0], _PRESSURES, _ROUND_PRESSURE)
    times = _rounded(places[:, 1], _TIMES, _ROUND_TIME)
    if len(pressures) * len(times) == 1:
        raise ConfigurationError(
            "All data are of one rail pressure and energising time, so there is no range to choose new points from; "
            "state the rail pressures and energising times that the bench can run."
        )
    return pressures, times


def _rounded(values: Floats, many: int, step: float) -> Floats:
    low, high = float(values.min()), float(values.max())
    inner = step * np.round(np.linspace(low, high, many) / step)
    return np.unique(np.clip(inner, low, high))


def planned(kind: str, points: Sequence[OperatingPoint], like: Sequence[DataSet]) -> list[DataSet]:
    """Data sets of measurements that are not made yet, their values zero.

    Meter, tolerances and sampling are those of the first data set of the kind.

    Parameters
    ----------
    kind : str
    points : sequence of OperatingPoint
    like : sequence of DataSet
        The data that there are.

    Raises
    ------
    ConfigurationError
        If there is no data set of the kind.
    """
    model = next((one for one in like if one.kind == kind), None)
    if isinstance(model, RateData):
        return [_planned_rate(model, point) for point in points]
    if isinstance(model, QuantityData):
        zeros = np.zeros(len(points))
        return [
            replace(
                model,
                points=tuple(points),
                quantity=zeros,
                dead_time=np.zeros(len(points), bool),
                mass_density=float("nan"),
                sister=None,
                weight=1.0,
            )
        ]
    raise ConfigurationError(
        f'There is no fitted data set of the kind "{kind}" whose noise and meter a new one could have; plan for '
        f"{' or '.join(sorted({one.kind for one in like}))}."
    )


def _planned_rate(model: RateData, point: OperatingPoint) -> RateData:
    """Curve sampled as the model's, as long after the end of energising."""
    width = float(np.median(np.diff(model.bounds)))
    begin = min(float(model.bounds[0]) - model.point.start, 0.0)
    after = float(model.bounds[-1]) - model.point.end_of_energising
    bounds = np.arange(max(begin, 0.0), point.end_of_energising + max(after, 0.0), width)
    horizon = max(float(bounds[-1]) + width, point.duration)
    zeros = np.zeros(len(bounds) - 1)
    return replace(
        model, point=replace(point, horizon=horizon), bounds=bounds, rate=zeros, mass_density=float("nan"), weight=1.0
    )
