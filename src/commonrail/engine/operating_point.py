"""What an injector is asked to do: pressures, energisings, horizon."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from commonrail.errors import ConfigurationError


@dataclass(frozen=True)
class Trace:
    """A measured course in time, linear between its samples, constant before and after them.

    Attributes
    ----------
    time : tuple of float
        Strictly increasing [s].
    value : tuple of float
        SI values at those times.
    """

    time: tuple[float, ...]
    value: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.time) != len(self.value) or len(self.time) < 2:
            raise ConfigurationError("A trace needs at least two times and as many values.")
        if not np.all(np.isfinite(self.time)) or not np.all(np.isfinite(self.value)):
            raise ConfigurationError("A trace holds a value that is not finite.")
        if not np.all(np.diff(self.time) > 0.0):
            raise ConfigurationError("The times of a trace must increase from sample to sample.")

    @classmethod
    def of(cls, time: ArrayLike, value: ArrayLike) -> Trace:
        """Trace from arrays."""
        return cls(tuple(np.asarray(time, float).tolist()), tuple(np.asarray(value, float).tolist()))

    def at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Values at times [s]."""
        return np.asarray(np.interp(np.asarray(time, float), self.time, self.value))

    def mean(self, start: NDArray[np.float64], stop: NDArray[np.float64]) -> NDArray[np.float64]:
        """Means over intervals [s], exact for the piecewise linear course."""
        knots = np.asarray(self.time)
        area = np.concatenate(([0.0], np.cumsum(np.diff(knots) * 0.5 * (np.add(self.value[1:], self.value[:-1])))))
        return np.asarray((self._area(stop, knots, area) - self._area(start, knots, area)) / (stop - start))

    def _area(
        self, t: NDArray[np.float64], knots: NDArray[np.float64], area: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        inside = np.clip(t, knots[0], knots[-1])
        i = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, len(knots) - 2)
        value = np.asarray(self.value)
        partial = area[i] + 0.5 * (value[i] + self.at(inside)) * (inside - knots[i])
        outside = np.minimum(t - knots[0], 0.0) * value[0] + np.maximum(t - knots[-1], 0.0) * value[-1]
        return np.asarray(partial + outside)


Course = float | Trace

AT_REST = 0.5e-3  # longest stretch before the first energising that a trace's value at rest is the mean of [s]


class Energising(NamedTuple):
    """One energising of the solenoid: start and duration (energising time) [s]."""

    start: float
    duration: float


@dataclass(frozen=True)
class OperatingPoint:
    """Operating point of one simulation; SI units.

    Attributes
    ----------
    rail_pressure : float or Trace
        [Pa], at any time above the two others. Before the simulation all is at rest at the pressures of `at_start`.
    energisings : sequence of Energising or (start, duration), or float
        A number is one energising of that duration from t = 0.
    cylinder_pressure, return_pressure : float or Trace
        [Pa].
    drive : Trace, optional
        Measured coil current [A] or voltage [V], for an injector driven by a trace.
    horizon : float, optional
        Time simulated after `start` [s]; by default 2.5 ms beyond the end of the last energising.
    start : float
        Time at which the simulation begins, all at rest [s].
    """

    rail_pressure: Course
    energisings: Sequence[tuple[float, float]] | float
    cylinder_pressure: Course = 5e6
    return_pressure: Course = 0.5e6
    drive: Trace | None = None
    horizon: float | None = None
    start: float = 0.0

    def __post_init__(self) -> None:
        for name, course in self.pressures.items():
            _refuse_unless_positive(name, course)
        _refuse_unless_below(self.rail_pressure, "cylinder pressure", self.cylinder_pressure)
        _refuse_unless_below(self.rail_pressure, "return pressure", self.return_pressure)
        ends = self.start
        for pulse in self.pulses:
            if not (pulse.duration >= 0.0 and pulse.start >= ends):
                raise ConfigurationError(
                    f"The energising at {pulse.start * 1e6:g} us must start at or after {ends * 1e6:g} us and last "
                    "zero or longer; energisings must follow one another."
                )
            ends = pulse.start + pulse.duration
        if self.horizon is not None and not 0.0 < self.horizon <= 1.0:
            raise ConfigurationError(f"The horizon must lie between 0 and 1 s, not {self.horizon:g} s.")

    @property
    def pressures(self) -> dict[str, Course]:
        """Pressures at the boundaries by name [Pa]."""
        return {
            "rail pressure": self.rail_pressure,
            "cylinder pressure": self.cylinder_pressure,
            "return pressure": self.return_pressure,
        }

    @property
    def pulses(self) -> tuple[Energising, ...]:
        """Energisings in order."""
        if isinstance(self.energisings, int | float):
            return (Energising(0.0, float(self.energisings)),)
        return tuple(Energising(*pulse) for pulse in self.energisings)

    @property
    def duration(self) -> float:
        """Time simulated [s]."""
        if self.horizon is not None:
            return self.horizon
        last = max((p.start + p.duration for p in self.pulses), default=self.start)
        return last - self.start + 2.5e-3

    def initial_pressures(self) -> tuple[float, float, float]:
        """Rail, cylinder and return pressure at rest, see `at_start` [Pa]."""
        rail, cylinder, low = self.rail_pressure, self.cylinder_pressure, self.return_pressure
        return self.at_start(rail), self.at_start(cylinder), self.at_start(low)

    def at_start(self, course: Course) -> float:
        """Value of one of the point's courses before anything moves.

        Of a trace it is the mean over at most `AT_REST` before the first energising, so that the noise of one sample
        does not set the state at rest, the wave speed and the densities; its value at the start where it has no
        sample before.
        """
        if not isinstance(course, Trace):
            return float(course)
        end = min((p.start for p in self.pulses), default=self.start)
        begin = max(course.time[0], end - AT_REST)
        if begin >= end:
            return float(course.at(self.start))
        return float(course.mean(np.array(begin), np.array(end)))


def _refuse_unless_below(rail: Course, name: str, course: Course) -> None:
    """Refuse a pressure that reaches the rail's at any time: fuel would flow back, which no part's law covers."""
    times = [t for one in (rail, course) if isinstance(one, Trace) for t in one.time] or [0.0]
    high, low = (one.at(times) if isinstance(one, Trace) else np.full(len(times), one) for one in (rail, course))
    worst = int(np.argmin(high - low))
    if not low[worst] < high[worst]:
        raise ConfigurationError(
            f"The {name} must stay below the rail pressure, but is {low[worst] * 1e-6:g} MPa where the rail has "
            f"{high[worst] * 1e-6:g} MPa; correct the pressures or their units."
        )


def _refuse_unless_positive(name: str, course: Course) -> None:
    values: Sequence[float] = course.value if isinstance(course, Trace) else (course,)
    if not (min(values) > 0.0 and max(values) < 1e9):
        raise ConfigurationError(f"The {name} must lie between 0 and 1000 MPa, not {min(values) * 1e-6:g} MPa.")
