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
    """Possible measurement, of one of the `KINDS`."""

    kind: str
    point: OperatingPoint
    cost: float = 1.0


def locate(point: OperatingPoint) -> tuple[float, float, float]:
    """Locate a point by rail pressure [Pa], last energising time [s] and dwell before it [s] (0: single injection)."""
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
    """Operating points for all combinations of pressures [Pa], times and dwells [s]; otherwise as in `like`.

    Without dwells injections are single. ConfigurationError for dwells without a first energising time, or a value
    beyond its limits.
    """
    if len(dwells) and not first_energising_time > 0.0:
        raise ConfigurationError("Dwells need the energising time of the first injection; state it.")
    operating_points = []
    for rail, time, dwell in itertools.product(rail_pressures, energising_times, dwells if len(dwells) else [None]):
        pulses: tuple[Energising, ...] = (Energising(0.0, time),)
        if dwell is not None:
            first = Energising(0.0, first_energising_time)
            pulses = first, Energising(first_energising_time + dwell, time)
        operating_points.append(replace(like, rail_pressure=rail, energisings=pulses, horizon=None, start=0.0))
    return operating_points


def usual_axes(data: Sequence[DataSet]) -> tuple[Floats, Floats]:
    """Rail pressures [Pa] and energising times [s] over the range of the data, in round numbers.

    ConfigurationError if the data have a single rail pressure and energising time.
    """
    places = np.array([locate(point) for data_set in data for point in data_set.points])
    pressures, times = (
        np.unique(
            np.clip(step * np.round(np.linspace(column.min(), column.max(), n) / step), column.min(), column.max())
        )
        for column, n, step in ((places[:, 0], _PRESSURES, _ROUND_PRESSURE), (places[:, 1], _TIMES, _ROUND_TIME))
    )
    if len(pressures) * len(times) == 1:
        raise ConfigurationError(
            "All data have the same rail pressure and energising time; state the rail pressures and energising times "
            "that the bench can run."
        )
    return pressures, times


def list_fitted_kinds(data: Sequence[DataSet]) -> list[str]:
    """Kinds of measurement that can be planned, in the order of the data; ConfigurationError if there is no kind."""
    kinds = list(dict.fromkeys(data_set.kind for data_set in data if data_set.kind in KINDS))
    if not kinds:
        fitted = join_words(sorted({data_set.kind for data_set in data}))
        raise ConfigurationError(
            f"The study fits only {fitted}, but the noise of a new measurement comes from fitted data of its kind; fit "
            f"{', '.join(KINDS[:-1])} or {KINDS[-1]}."
        )
    return kinds


def plan_data_sets(kind: str, points: Sequence[OperatingPoint], like: Sequence[DataSet]) -> list[DataSet]:
    """Make data sets for planned measurements, with values zero.

    Meter, tolerances and sampling are copied from the first data set of the kind; ConfigurationError if it is absent.
    """
    model = next((data_set for data_set in like if data_set.kind == kind), None)
    if isinstance(model, RateData):
        return [_plan_rate(model, point) for point in points]
    if not isinstance(model, QuantityData):
        raise ConfigurationError(
            f'The study fits no data of the kind "{kind}", from which a measurement takes noise and meter; plan '
            f"for {' or '.join(list_fitted_kinds(like))}."
        )
    zeros = np.zeros(len(points))
    values = {"points": tuple(points), "quantity": zeros, "dead_time": zeros > 0.0}
    return [model.changed(**values, mass_density=float("nan"), sister=None, weight=1.0)]


def _plan_rate(model: RateData, point: OperatingPoint) -> RateData:
    """Curve with the model's sampling interval and the model's record time after the end of energising."""
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
# A measurement with whitened derivatives r adds rᵀr to the information H; V = H⁻¹. With rows e of the predictions or
# parameters of interest, C = e V eᵀ. An error shared by measurements is a further column of H, r and e with unit prior
# information; this equals generalised least squares with the full covariance.


class Problem(NamedTuple):
    """Linear model of measurements."""

    criterion: Criterion
    information: Floats  # (D, D), before any measurement, positive definite
    rows: Floats  # (c, r, D), whitened derivatives of c candidates with up to r independent values, padded with zeros
    aims: Floats  # (k, D), rows of the predictions or parameters of interest

    def covariance(self, plan: Sequence[int]) -> Floats:
        """Covariance V (D, D) after the candidates of a plan, which may repeat."""
        rows = self.rows[list(plan)].reshape(-1, self.rows.shape[-1])
        return np.asarray(np.linalg.inv(self.information + rows.T @ rows))

    def score(self, plan: Sequence[int]) -> float:
        """Criterion after the candidates of a plan."""
        aimed = self.aims @ self.covariance(plan) @ self.aims.T
        if self.criterion is Criterion.D:
            return float(0.5 * np.linalg.slogdet(aimed)[1] / len(aimed))
        return float(0.5 * np.log(np.trace(aimed) / len(aimed)))

    def scores(self, plan: Sequence[int]) -> Floats:
        """Criterion (c,) after the candidates of a plan and one more, for each candidate."""
        covariance = self.covariance(plan)
        spread = self.rows @ covariance  # (c, r, D)
        # covariance (c, r, r) of a candidate's values before its measurement, and with the aims (c, r, k)
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
