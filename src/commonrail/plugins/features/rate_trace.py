"""Injection rate as means between bounds in time, from any source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import array, instances, settle, shown
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.data.curves.samples import bounds_around
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.solution import Solution

RATE_UNITS = {"m3/s": "m3", "kg/s": "kg"}  # of a rate, and of its quantity
LEAST_SAMPLES = 4
NORMAL = 0.6745  # median of |x| of a standard normal distribution
FEWEST_AT_REST = 20  # samples before the first energising from which noise is estimated


@dataclass(frozen=True, eq=False)
class RateTrace:
    """Injection rate, sample by sample.

    Attributes
    ----------
    bounds : (samples + 1,)
        Bounds of the samples [s]; a sample is the mean rate between two of them.
    rate : (samples,)
        [m³/s], or [kg/s] by mass.
    unit : str
        "m3/s" or "kg/s".
    energisings : tuple of Energising
        In order; empty if unknown, which leaves delays unknown too.

    Raises
    ------
    ConfigurationError
        If the arrays do not fit each other, there are fewer than four samples, or the bounds do not increase.
    """

    bounds: Floats
    rate: Floats
    unit: str = "m3/s"
    energisings: tuple[Energising, ...] = field(default=())

    def __post_init__(self) -> None:
        bounds, rate = array(self.bounds, "s", "bounds of the trace", 1), array(self.rate, "1", "rate of the trace", 1)
        if self.unit not in RATE_UNITS:
            raise ConfigurationError(f'The unit of a rate must be "m3/s" or "kg/s", not {shown(self.unit)}.')
        if len(bounds) != len(rate) + 1 or len(rate) < LEAST_SAMPLES:
            raise ConfigurationError(
                f"A rate needs at least {LEAST_SAMPLES} samples and one bound more, not {len(rate)} samples and "
                f"{len(bounds)} bounds."
            )
        if not np.all(np.diff(bounds) > 0.0):
            raise ConfigurationError("The bounds of the samples must increase from sample to sample.")
        pulses = sorted(instances(self.energisings, Energising, "energisings"))
        settle(self, bounds=bounds, rate=rate, energisings=tuple(pulses))

    @cached_property
    def interval(self) -> float:
        """Median length of a sample [s]."""
        return float(np.median(np.diff(self.bounds)))

    @cached_property
    def cumulated(self) -> Floats:
        """Quantity injected up to each bound, (samples + 1,) [m³ or kg]."""
        return np.concatenate(([0.0], np.cumsum(self.rate * np.diff(self.bounds))))

    def quantity(self, begin: float, end: float) -> float:
        """Quantity injected between two times [s]; the rate is zero before the first and after the last bound."""
        return float(np.diff(np.interp([begin, end], self.bounds, self.cumulated))[0])

    def means(self, time: ArrayLike, width: float) -> Floats:
        """Means of the rate over intervals of a width [s] around times [s]."""
        middle = np.asarray(time, float)
        ends = np.interp(np.stack([middle - 0.5 * width, middle + 0.5 * width]), self.bounds, self.cumulated)
        return np.asarray((ends[1] - ends[0]) / width)

    def with_rate(self, rate: Floats) -> RateTrace:
        """Another rate (samples,) between the same bounds."""
        return replace(self, rate=rate)

    @cached_property
    def at_rest(self) -> Floats:
        """Samples that end before the first energising; empty if it is unknown."""
        if not self.energisings:
            return np.empty(0)
        return self.rate[self.bounds[1:] <= self.energisings[0].start]

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a sample: from second differences, and from the samples at rest if there are enough.

        A smooth course has hardly any second difference; slow noise shows at rest only. The larger one counts. Both are
        medians, which an injection before the stated energisings hardly changes.
        """
        white = float(np.median(np.abs(np.diff(self.rate, 2))) / (NORMAL * np.sqrt(6.0)))  # white: σ √(1 + 4 + 1)
        return max(white, spread(self.at_rest)) if len(self.at_rest) >= FEWEST_AT_REST else white


def spread(values: Floats) -> float:
    """Robust standard deviation, from the median distance from the median."""
    return float(np.median(np.abs(values - np.median(values))) / NORMAL)


def rate_trace(source: Any, energisings: OperatingPoint | Sequence[Energising] | None = None) -> RateTrace:
    """Take the injection rate from a source that has one.

    A sample of a `Trace` is the mean over the interval around its time [m³/s]. Energisings default to those in
    the source. `ConfigurationError` if the source has no rate.
    """
    pulses = energisings.pulses if isinstance(energisings, OperatingPoint) else energisings
    pulses = None if pulses is None else instances(pulses, Energising, "energisings")
    if isinstance(source, RateTrace):
        return source if pulses is None else replace(source, energisings=tuple(pulses))
    if isinstance(source, Solution):
        energisings_of_point = () if source.point is None else source.point.pulses
        return RateTrace(
            source.time, source.rate, energisings=tuple(energisings_of_point if pulses is None else pulses)
        )
    if isinstance(source, Trace):
        return RateTrace(bounds_around(np.array(source.time)), np.array(source.value), energisings=tuple(pulses or ()))
    point = getattr(source, "point", None)
    if isinstance(point, OperatingPoint) and hasattr(source, "bounds") and hasattr(source, "rate"):
        return RateTrace(source.bounds, source.rate, energisings=tuple(point.pulses if pulses is None else pulses))
    raise ConfigurationError(
        "Features need an injection rate: a RateTrace, the result of commonrail.simulate, a Trace or a "
        f"RateData, not {shown(source)}."
    )
