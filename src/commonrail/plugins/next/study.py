"""Candidates for the next measurement: a kind of measurement at an operating point, with its cost."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.text import join_words
from commonrail.data.base import DataSet
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.quantities.returned import ReturnData
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.plugins.next.settings import Criterion

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
    """Operating points of all combinations of pressures [Pa] and times [s], all else as in `like`.

    Dwells are between the end of a first energising and the begin of the second [s]; none for single injections.
    ConfigurationError if dwells are given without a first energising time, or a value lies beyond its limits.
    """
    if len(dwells) and not first_energising_time > 0.0:
        raise ConfigurationError("Dwells need the energising time of the first injection; give it too.")
    operating_points = []
    for rail, time, dwell in itertools.product(rail_pressures, energising_times, dwells if len(dwells) else [None]):
        pulses = (
            (Energising(0.0, time),)
            if dwell is None
            else (Energising(0.0, first_energising_time), Energising(first_energising_time + dwell, time))
        )
        operating_points.append(replace(like, rail_pressure=rail, energisings=pulses, horizon=None, start=0.0))
    return operating_points


def usual_axes(data: Sequence[DataSet]) -> tuple[Floats, Floats]:
    """Rail pressures [Pa] and energising times [s] within the range of data, in round numbers.

    ConfigurationError if the data cover one rail pressure and one energising time alone.
    """
    places = np.array([place_of(point) for data_set in data for point in data_set.points])
    pressures = _rounded(places[:, 0], _PRESSURES, _ROUND_PRESSURE)
    times = _rounded(places[:, 1], _TIMES, _ROUND_TIME)
    if len(pressures) * len(times) == 1:
        raise ConfigurationError(
            "All data are of one rail pressure and energising time, so there is no range to choose new points from; "
            "state the rail pressures and energising times that the bench can run."
        )
    return pressures, times


def _rounded(values: Floats, n: int, step: float) -> Floats:
    low, high = float(values.min()), float(values.max())
    inner = step * np.round(np.linspace(low, high, n) / step)
    return np.unique(np.clip(inner, low, high))


def fitted_kinds(data: Sequence[DataSet]) -> list[str]:
    """Kinds of measurement that can be planned, in the order of the fitted data; ConfigurationError if none is."""
    kinds = list(dict.fromkeys(data_set.kind for data_set in data if data_set.kind in KINDS))
    if not kinds:
        fitted = join_words(sorted({data_set.kind for data_set in data}))
        raise ConfigurationError(
            f"The study fits {fitted} alone, and the noise of a new measurement is that of a fitted set of its kind; "
            f"fit {', '.join(KINDS[:-1])} or {KINDS[-1]}."
        )
    return kinds


def planned(kind: str, points: Sequence[OperatingPoint], like: Sequence[DataSet]) -> list[DataSet]:
    """Data sets of measurements that are not made yet, their values zero.

    Meter, tolerances and sampling are those of the first data set of the kind; ConfigurationError if there is none.
    """
    model = next((data_set for data_set in like if data_set.kind == kind), None)
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
        f"{' or '.join(fitted_kinds(like))}."
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


# Criteria of optimal design, as the logarithm of a typical standard deviation.
#
# A measurement adds rᵀr of its whitened derivatives r to the information H, and V = H⁻¹. With rows e of what is to be
# predicted or estimated, C = e V eᵀ. Errors that measurements share are further columns of H, r and e, with unit prior
# information: the sum then is that of generalised least squares with the whole covariance.


class Problem(NamedTuple):
    """Linear model of measurements.

    `information` (D, D) before any of them is positive definite; `rows` (c, r, D) are whitened derivatives of each of c
    candidates, which has up to r independent values, zero where it has fewer; `aims` (k, D) rows of what is to be
    predicted or estimated.
    """

    criterion: Criterion
    information: Floats
    rows: Floats
    aims: Floats

    def covariance(self, plan: Sequence[int]) -> Floats:
        """Covariance V (D, D) after candidates have been measured; one may be measured several times."""
        rows = self.rows[list(plan)].reshape(-1, self.rows.shape[-1])
        return np.asarray(np.linalg.inv(self.information + rows.T @ rows))

    def score(self, plan: Sequence[int]) -> float:
        """Criterion after candidates have been measured."""
        aimed = self.aims @ self.covariance(plan) @ self.aims.T
        if self.criterion is Criterion.D:
            return float(0.5 * np.linalg.slogdet(aimed)[1] / len(aimed))
        return float(0.5 * np.log(np.trace(aimed) / len(aimed)))

    def scores(self, plan: Sequence[int]) -> Floats:
        """Criterion (c,) after candidates have been measured and, in addition, each of them."""
        covariance = self.covariance(plan)
        spread = self.rows @ covariance  # (c, r, D)
        # covariance (c, r, r) of a candidate's values before it is measured, and with what is aimed at (c, r, k)
        before = np.eye(self.rows.shape[1]) + spread @ self.rows.transpose(0, 2, 1)
        crossed = spread @ self.aims.T
        aimed = self.aims @ covariance @ self.aims.T
        if self.criterion is Criterion.D:
            explained = crossed @ np.linalg.solve(aimed, crossed.transpose(0, 2, 1))
            ratio = np.linalg.slogdet(before - explained)[1] - np.linalg.slogdet(before)[1]
            return np.asarray(0.5 * (np.linalg.slogdet(aimed)[1] + ratio) / len(aimed))
        fall = np.einsum("crk,crk->c", crossed, np.linalg.solve(before, crossed))
        left = np.maximum(np.trace(aimed) - fall, 1e-12 * np.trace(aimed))
        return np.asarray(0.5 * np.log(left / len(aimed)))
