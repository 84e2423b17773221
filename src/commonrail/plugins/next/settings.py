"""Settings of a measuring plan."""

from __future__ import annotations

import math
from enum import StrEnum

from commonrail.base.arguments import Limits
from commonrail.base.declare import Choice, Number, OptionalNumber, Setting, setting, settings

NOT_NEGATIVE = Limits(0.0, math.inf)


class Criterion(StrEnum):
    """Figure that a plan minimises."""

    V = "v"
    """Mean variance of the predictions: criterion A for the predictions instead of the parameters."""

    D = "d"
    """Volume of the region of the parameters: ½ ln det C over their number."""

    A = "a"
    """Mean squared standard error of the parameters: ½ ln of the mean of C's diagonal."""


@settings
class DesignSettings:
    """Settings of a measuring plan; `ConfigurationError` for a value of the wrong type or beyond its limits."""

    points: int = setting(
        words="number of points", default=3, limits=Limits(1, 100), text="Largest number of measurements."
    )
    criterion: Choice[Criterion] = setting(
        words="criterion",
        default=Criterion.V,
        text="v: mean variance of predictions on the grid; d: volume of the region of the parameters; a: their mean "
        "squared relative standard error.",
    )
    parameters: Setting[tuple[str, ...], tuple[str, ...]] = setting(
        words="parameters", default=(), text="Parameters that criteria d and a are about; all if empty.", option=False
    )
    budget: OptionalNumber = setting(
        words="budget", default=None, limits=NOT_NEGATIVE, text="Largest cost. [default: none]"
    )
    pressure_cost: Number = setting(
        words="cost of a rail pressure",
        default=0.0,
        limits=NOT_NEGATIVE,
        text="Cost of every rail pressure in the plan.",
    )
    apart_pressure: Number = setting(
        words="distance of rail pressures",
        default="20MPa",
        unit="Pa",
        limits=NOT_NEGATIVE,
        text="Least difference of rail pressures between points with similar energising times.",
    )
    apart_time: Number = setting(
        words="distance of energising times",
        default="30us",
        unit="s",
        limits=NOT_NEGATIVE,
        text="Least difference of energising times between points with similar pressures; 0 allows repetitions.",
    )
    seed: int = setting(words="seed", default=0, text="Seed of the draws.")
