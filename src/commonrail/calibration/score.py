"""How well one injector agrees with one data set, in figures that a person reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.objective import Objective, curve_j, dead_times
from commonrail.calibration.study import QuantityData, RateData
from commonrail.injector.definition import Injector

Floats = NDArray[np.float64]

SMALL_QUANTITY = 3e-9  # below it errors are judged in mm³, above it in percent [m³]


@dataclass(frozen=True)
class RateScore:
    """Injection curve: simulated samples [m³/s] and J, Σ |error| [mm³/ms]; NaN if the simulation failed."""

    rate: Floats
    j: float


@dataclass(frozen=True)
class QuantityScore:
    """Quantity map: simulated quantities (points,) [m³], dead times (dead-time rows,) [s], and root mean squares.

    `rms_large` is relative and over Q > 3 mm³, `rms_small` [m³] over the rest, `rms_dead_time` [s]; NaN where
    there is no such row.
    """

    quantity: Floats
    dead_time: Floats
    rms_large: float
    rms_small: float
    rms_dead_time: float


DataScore = RateScore | QuantityScore


def score_data(
    data: RateData | QuantityData, injector: Injector, time_step: float, threads: int | None = None
) -> DataScore:
    """Score of an injector as it is."""
    objective = Objective(injector, (), [data], time_step, threads)
    itself = np.empty((1, 0))
    if isinstance(data, RateData):
        rate = objective.rates(data, itself)[0]
        return RateScore(rate, curve_j(rate, data))
    quantity = objective.quantities(data, itself)[0]
    found = dead_times(injector, data, time_step, threads)
    error = quantity - data.quantity
    large = (data.quantity > SMALL_QUANTITY) & ~data.dead_time
    small = ~large & ~data.dead_time
    measured = np.array([data.points[i].pulses[0].duration for i in np.flatnonzero(data.dead_time)])
    return QuantityScore(
        quantity, found, _rms(error[large] / data.quantity[large]), _rms(error[small]), _rms(found - measured)
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
