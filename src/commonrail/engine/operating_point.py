"""Operating point of a simulation: pressures, energisings, horizon."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import Limits, Quantity, amount, array, instance, number, sequence, settle, shown
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.engine.record_filter import low_pass

# Limits that no injector approaches, but that catch numbers in another unit: 160 (MPa) and 1600 (bar) lie below
# the pressures, 700 (us) and 0.7 (ms) above the durations.
RAIL_PRESSURES = Limits(0.1e6, 1e9, (5e6, 400e6), ("MPa", "bar"))
OTHER_PRESSURES = Limits(
    10e3, 1e9, (0.05e6, 30e6), ("MPa", "bar")
)  # cylinder, return line: down to slightly below the atmosphere
ENERGISING_TIMES = Limits(0.0, 0.1, (10e-6, 20e-3), ("us", "ms"))
SHORTEST = 1e-9  # energising [s]; zero: no energising, only leakage
LONGEST = 1.0  # of a simulation [s]
CUT_OFFS = Limits(1.0, 1e9, (100.0, 20e3), ("Hz", "kHz"))


@dataclass(frozen=True)
class Trace:
    """A measured course in time, linear between its samples, constant before and after them.

    A simulation follows it exactly, noise included: apply `low_pass` to the signal of a pressure sensor.

    Attributes
    ----------
    time : tuple of float
        Strictly increasing [s].
    value : tuple of float
        SI values at those times.

    Raises
    ------
    ConfigurationError
        If times and values are not two finite lists of one length, or the times do not increase.
    """

    time: tuple[float, ...]
    value: tuple[float, ...]

    def __post_init__(self) -> None:
        time, value = array(self.time, "s", "time of a trace", 1), array(self.value, "1", "value of a trace", 1)
        if len(time) != len(value) or len(time) < 2:
            raise ConfigurationError(
                f"A trace needs at least two times and as many values, not {len(time)} times and {len(value)} values."
            )
        if not np.all(np.diff(time) > 0.0):
            raise ConfigurationError("The times of a trace must increase from sample to sample.")
        settle(self, time=tuple(time.tolist()), value=tuple(value.tolist()))

    @classmethod
    def of(cls, time: ArrayLike, value: ArrayLike) -> Trace:
        """Trace from arrays (samples,) of times [s], or texts with units, and of SI values."""
        return cls(time, value)  # type: ignore[arg-type]  # read by __post_init__

    def low_pass(self, cut_off: Quantity | None = None) -> Trace:
        """Trace without the noise of its sensor, see `record_filter.low_pass`.

        `cut_off`: [Hz], or text such as ``"2 kHz"``; default: as far above the signal as the noise permits.
        """
        limit = None if cut_off is None else amount(cut_off, "Hz", "cut-off", CUT_OFFS)
        filtered = low_pass(np.array(self.time), np.array(self.value), limit)
        return Trace.of(filtered.time, filtered.value)

    def at(self, time: ArrayLike) -> Floats:
        """Values at times [s]."""
        return np.asarray(np.interp(np.asarray(time, float), self.time, self.value))

    def mean(self, start: Floats, stop: Floats) -> Floats:
        """Means over intervals [s], exact for the piecewise linear course."""
        knots = np.asarray(self.time)
        area = np.concatenate(([0.0], np.cumsum(np.diff(knots) * 0.5 * (np.add(self.value[1:], self.value[:-1])))))
        return np.asarray((self._area(stop, knots, area) - self._area(start, knots, area)) / (stop - start))

    def _area(self, t: Floats, knots: Floats, area: Floats) -> Floats:
        inside = np.clip(t, knots[0], knots[-1])
        i = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, len(knots) - 2)
        value = np.asarray(self.value)
        partial = area[i] + 0.5 * (value[i] + self.at(inside)) * (inside - knots[i])
        outside = np.minimum(t - knots[0], 0.0) * value[0] + np.maximum(t - knots[-1], 0.0) * value[-1]
        return np.asarray(partial + outside)


Course = float | Trace


class _Pulse(NamedTuple):
    start: float
    duration: float


class Energising(_Pulse):
    """One energising of the solenoid.

    Parameters
    ----------
    start, duration : float or str
        Start and energising time [s], or texts such as ``"900 us"``; 1 ns to 100 ms long, or zero for none.

    Raises
    ------
    ConfigurationError
        If a value is not a time, or the duration lies beyond its limits.
    """

    __slots__ = ()

    def __new__(cls, start: Quantity, duration: Quantity) -> Energising:
        return super().__new__(
            cls,
            number(start, "s", "start of an energising"),
            _energising_time(duration, "duration of an energising"),
        )

    _make = classmethod(lambda cls, values: cls(*values))  # type: ignore[assignment]  # `_replace` checks too


@dataclass(frozen=True)
class OperatingPoint:
    """Operating point of one simulation; SI numbers, or texts with their unit, which are read as SI numbers.

    Attributes
    ----------
    rail_pressure : float or Trace
        [Pa], from 0.1 MPa to 1000 MPa, always above the other two.
    energisings : sequence of Energising or (start, duration), or float
        A number is one energising of that duration [s] from t = 0, from 1 ns to 100 ms, or zero for none.
    cylinder_pressure, return_pressure : float or Trace
        [Pa], from 10 kPa to 1000 MPa.
    drive : Trace, optional
        Measured coil current [A] or voltage [V], for an injector driven by a trace.
    horizon : float, optional
        Time simulated after `start` [s]; default: until 2.5 ms after the end of the last energising.
    start : float
        Time at which the simulation begins, at rest at the pressures of that instant [s].

    Raises
    ------
    ConfigurationError
        If a value is not a quantity of its kind or lies beyond its limits, energisings overlap, or more than 1 s would
        be simulated.

    Examples
    --------
    >>> OperatingPoint("160 MPa", "700 us") == OperatingPoint(160e6, 700e-6)
    True
    """

    rail_pressure: Course
    energisings: tuple[Energising, ...] | float
    cylinder_pressure: Course = 5e6
    return_pressure: Course = 0.5e6
    drive: Trace | None = None
    horizon: float | None = None
    start: float = field(default=0.0, kw_only=True)

    if TYPE_CHECKING:  # accepted types are wider than stored ones

        def __init__(
            self,
            rail_pressure: Course | str,
            energisings: Sequence[tuple[Quantity, Quantity]] | Quantity,
            cylinder_pressure: Course | str = 5e6,
            return_pressure: Course | str = 0.5e6,
            drive: Trace | None = None,
            horizon: Quantity | None = None,
            *,
            start: Quantity = 0.0,
        ) -> None: ...

    def __post_init__(self) -> None:
        settle(
            self,
            rail_pressure=_course("rail pressure", self.rail_pressure, RAIL_PRESSURES),
            energisings=_energisings(self.energisings),
            cylinder_pressure=_course("cylinder pressure", self.cylinder_pressure, OTHER_PRESSURES),
            return_pressure=_course("return pressure", self.return_pressure, OTHER_PRESSURES),
            drive=None if self.drive is None else instance(self.drive, Trace, "drive"),
            horizon=None if self.horizon is None else number(self.horizon, "s", "horizon"),
            start=number(self.start, "s", "start"),
        )
        _refuse_unless_below(self.rail_pressure, "cylinder pressure", self.cylinder_pressure)
        _refuse_unless_below(self.rail_pressure, "return pressure", self.return_pressure)
        ends = self.start
        for pulse in self.pulses:
            if not pulse.start >= ends:
                raise ConfigurationError(
                    f"The energising at {pulse.start * 1e6:g} us must start at or after {ends * 1e6:g} us; energisings "
                    "must follow one another, the first not before the start of the simulation."
                )
            ends = pulse.start + pulse.duration
        if not 0.0 < self.duration <= LONGEST:
            if self.horizon is not None:
                raise ConfigurationError(
                    f"The horizon must lie between 0 and {LONGEST:g} s, not {self.horizon:g} s; for microseconds write "
                    '"1500 us".'
                )
            raise ConfigurationError(
                f"The energisings end {self.duration:g} s after the start, and at most {LONGEST:g} s are simulated; "
                'for microseconds write "900 us".'
            )

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
        if isinstance(self.energisings, float):
            return (Energising(0.0, self.energisings),)
        return self.energisings

    @property
    def end_of_energising(self) -> float:
        """End of the last energising, or the start of the simulation without one [s]."""
        return self.pulses[-1].start + self.pulses[-1].duration if self.pulses else self.start

    @property
    def duration(self) -> float:
        """Time simulated [s]."""
        if self.horizon is not None:
            return self.horizon
        last = max((p.start + p.duration for p in self.pulses), default=self.start)
        return last - self.start + 2.5e-3

    def initial_pressures(self) -> tuple[float, float, float]:
        """Rail, cylinder and return pressure at rest, at `start` [Pa]."""
        rail, cylinder, low = self.rail_pressure, self.cylinder_pressure, self.return_pressure
        return self.at_start(rail), self.at_start(cylinder), self.at_start(low)

    def at_start(self, course: Course) -> float:
        """Value of one of the point's courses at the start of the simulation, whatever was before."""
        return value_at(course, self.start)


def _refuse_unless_below(rail: Course, name: str, course: Course) -> None:
    """Refuse a pressure that reaches the rail pressure at any time: no law covers the reverse flow."""
    times = [t for pressure in (rail, course) if isinstance(pressure, Trace) for t in pressure.time] or [0.0]
    high, low = (
        pressure.at(times) if isinstance(pressure, Trace) else np.full(len(times), pressure)
        for pressure in (rail, course)
    )
    worst = int(np.argmin(high - low))
    if not low[worst] < high[worst]:
        raise ConfigurationError(
            f"The {name} must stay below the rail pressure, but is {low[worst] * 1e-6:g} MPa where the rail has "
            f"{high[worst] * 1e-6:g} MPa; correct the pressures or their units."
        )


def _course(name: str, course: object, limits: Limits) -> Course:
    if not isinstance(course, Trace):
        return amount(course, "Pa", name, limits)
    for value in (min(course.value), max(course.value)):
        amount(value, "Pa", name, limits)
    return course


def _energisings(value: object) -> tuple[Energising, ...] | float:
    if isinstance(value, Energising):
        return (value,)
    if np.ndim(value) if isinstance(value, np.ndarray) else isinstance(value, list | tuple):
        return read_pulses(value)
    return _energising_time(value, "energising time")


def _energising_time(value: object, what: str) -> float:
    duration = amount(value, "s", what, ENERGISING_TIMES)
    if 0.0 < duration < SHORTEST:
        raise ConfigurationError(f"The {what} must be 1 ns or longer, or zero for none, not {duration:g} s.")
    return duration


_PULSES = '[(0.0, "250 us"), ("900 us", "600 us")], pairs of start and duration'


def read_pulses(pairs: object) -> tuple[Energising, ...]:
    """Energisings of a list of pairs of start and duration; `ConfigurationError` for anything else."""
    return tuple(_pulse(item) for item in sequence(pairs, "energisings", _PULSES))


def _pulse(item: object) -> Energising:
    pair = item if isinstance(item, tuple | list | np.ndarray) else ()
    if len(pair) != 2:
        raise ConfigurationError(f"The energisings must be a list, such as {_PULSES}, and {shown(item)} is no pair.")
    return Energising(*pair)


# Boundary courses and the drive's schedule against time.


class Segment(NamedTuple):
    """Interval of time [s] with a constant schedule: energised, and in the peak phase (1 or 0)."""

    start: float
    stop: float
    on: float
    peak: float


def courses(point: OperatingPoint) -> tuple[Course, Course, Course, Course]:
    """Rail, cylinder and return pressure [Pa] and the drive's trace, zero without one."""
    drive: Course = 0.0 if point.drive is None else point.drive
    return point.rail_pressure, point.cylinder_pressure, point.return_pressure, drive


def value_at(course: Course, t: float) -> float:
    """Value of a course at a time [s]."""
    return float(np.interp(t, course.time, course.value)) if isinstance(course, Trace) else course


def values_at(course: Course, times: Floats) -> Floats:
    """Values of a course at times [s]."""
    return course.at(times) if isinstance(course, Trace) else np.full(len(times), course)


def knots(point: OperatingPoint) -> Floats:
    """Times [s] at which the slope of a course may change."""
    return np.array([t for course in courses(point) if isinstance(course, Trace) for t in course.time])


def segments(point: OperatingPoint, peak_duration: float, start: float, stop: float) -> Sequence[Segment]:
    """The schedule from `start` to `stop` [s], peak phases `peak_duration` [s] long."""
    edges = {start, stop}
    for pulse in point.pulses:
        edges |= {pulse.start, pulse.start + pulse.duration, pulse.start + min(peak_duration, pulse.duration)}
    inside = sorted(e for e in edges if start <= e <= stop)
    return [Segment(a, b, *_schedule(point, peak_duration, 0.5 * (a + b))) for a, b in pairwise(inside)]


def _schedule(point: OperatingPoint, peak_duration: float, t: float) -> tuple[float, float]:
    for pulse in point.pulses:
        if pulse.start <= t < pulse.start + pulse.duration:
            return 1.0, float(t < pulse.start + peak_duration)
    return 0.0, 0.0
