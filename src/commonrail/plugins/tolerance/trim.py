"""Trim: correction of each part's energising time from one or two measured quantities, and the remaining spread.

The correction is (nominal quantity − measured quantity) over the nominal slope dQ/dET at the test point, as a control
unit computes it from the nominal map, rounded to the resolution of the energising time. Parts with the same energising
time are simulated together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.base.record import Key
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.status import OK
from commonrail.plugins.tolerance.statistics import Draws, Parts, PartSimulator, Spread, describe_spread

STEP = 10e-6  # change of the energising time to both sides for the nominal slope [s]; above the ripple of PWM
SHORTEST, LONGEST = 0.5, 1.5  # corrected energising time as a multiple of the nominal one


class Shift(NamedTuple):
    """Mean and standard deviation of the correction of the energising time [s]."""

    mean: float
    deviation: float


class TrimmedPoint(NamedTuple):
    """Spread of the trimmed parts at one operating point, before and after.

    `limited` counts the parts whose correction was limited to half of the energising time.
    """

    name: str
    before: Spread
    after: Spread
    correction: Shift
    limited: Annotated[int, Key("held")]


class Trimmed(NamedTuple):
    """Result of a trim at all points.

    `parts` were measured at the test points, `unmeasured` could not be; `resolution` [s], `scatter` [m³] and the
    nominal `slopes` [m³/s] define the trim.
    """

    test_points: tuple[str, ...]
    parts: int
    unmeasured: int
    resolution: float
    scatter: float
    slopes: tuple[float, ...]
    points: tuple[TrimmedPoint, ...]


def trim_parts(
    simulated: PartSimulator,
    parts: Parts,
    nominal: Floats,
    limits: list[tuple[float | None, float | None]],
    confidence: float,
    report: Callable[[int, int], None],
) -> Trimmed:
    """Trim the first parts of a study.

    `parts`: all parts before the trim; `nominal` (points,) and `limits` [m³]; `report`: called with the number of
    operating points done and in total. SimulationError if the nominal quantity does not rise with the energising time
    at a test point.
    """
    t = simulated.tolerances
    assert t.trim is not None
    tests = [t.names_of_points.index(name) for name in t.trim.points]
    slopes = [_slope(simulated, k) for k in tests]
    count = min(t.trim.parts, len(parts.quantities))
    rng = np.random.default_rng([t.seed, 1])
    measured = parts.quantities[:count, tests] + t.trim.scatter * rng.standard_normal((count, len(tests)))
    complete = np.isfinite(measured).all(axis=1)
    values = Draws(t).take(count)[complete]
    at_tests = (nominal[tests] - measured[complete]) / slopes
    points = []
    for k, p in enumerate(t.points):
        corrections = _corrections(simulated, tests, at_tests, k)
        times, limited = _round_times(p.point.pulses[0].duration, corrections, t.trim.resolution)
        quantities, codes = _simulate_at_times(simulated, p.point, times, values)
        before = describe_spread(
            parts.quantities[:count][complete, k], parts.codes[:count][complete, k], limits[k], confidence
        )
        after = describe_spread(quantities, codes, limits[k], confidence)
        if before is None or after is None:
            raise SimulationError(f"{t.title}: hardly any trimmed part can be simulated at {p.name}.")
        shift = times - p.point.pulses[0].duration
        points.append(TrimmedPoint(p.name, before, after, Shift(float(shift.mean()), float(shift.std())), limited))
        report(k + 1, len(t.points))
    return Trimmed(
        test_points=t.trim.points,
        parts=int(complete.sum()),
        unmeasured=count - int(complete.sum()),
        resolution=t.trim.resolution,
        scatter=t.trim.scatter,
        slopes=tuple(slopes),
        points=tuple(points),
    )


def _slope(simulated: PartSimulator, k: int) -> float:
    """Nominal slope of the quantity over the energising time at a test point [m³/s]."""
    p = simulated.tolerances.points[k]
    time = p.point.pulses[0].duration
    low, high = (simulated.at(_with_time(p.point, time + shift), None) for shift in (-STEP, STEP))
    slope = float(high.quantities[0, 0] - low.quantities[0, 0]) / (2.0 * STEP)
    if not slope > 0.0:
        raise SimulationError(
            f"{p.name}: the nominal quantity does not rise with the energising time, so parts cannot be trimmed there; "
            "name another point in the trim."
        )
    return slope


def _corrections(simulated: PartSimulator, tests: list[int], at_tests: Floats, k: int) -> Floats:
    """Correction of each part [s] at operating point k."""
    if len(tests) == 1:
        return np.asarray(at_tests[:, 0])
    points = simulated.tolerances.points
    first, second, here = (points[i].point.pulses[0].duration for i in (*tests, k))
    share = (here - first) / (second - first)
    return np.asarray(at_tests[:, 0] + share * (at_tests[:, 1] - at_tests[:, 0]))


def _round_times(time: float, corrections: Floats, resolution: float) -> tuple[Floats, int]:
    """Energising times in steps of the resolution [s], and the number of corrections cut at a limit."""
    steps = np.round(corrections / resolution)
    low, high = np.ceil((SHORTEST - 1.0) * time / resolution), np.floor((LONGEST - 1.0) * time / resolution)
    return time + resolution * np.clip(steps, low, high), int(np.count_nonzero((steps < low) | (steps > high)))


def _simulate_at_times(
    simulated: PartSimulator, point: OperatingPoint, times: Floats, values: Floats
) -> tuple[Floats, NDArray[np.int8]]:
    """Quantities and codes of parts, each at its own energising time."""
    quantities, codes = np.full(len(values), np.nan), np.full(len(values), OK, np.int8)
    order = np.argsort(times, kind="stable")
    starts = np.flatnonzero(np.diff(times[order], prepend=-np.inf))
    for group in np.split(order, starts[1:]):
        group_parts = simulated.at(_with_time(point, float(times[group[0]])), values[group])
        quantities[group], codes[group] = group_parts.quantities[:, 0], group_parts.codes[:, 0]
    return quantities, codes


def _with_time(point: OperatingPoint, time: float) -> OperatingPoint:
    """Return the point with another energising time and the same simulated time after it."""
    pulse = point.pulses[0]
    horizon = None if point.horizon is None else point.horizon + time - pulse.duration
    return replace(point, energisings=(Energising(pulse.start, time),), horizon=horizon)
