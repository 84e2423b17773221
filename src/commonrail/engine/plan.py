"""From injectors and operating points to the arrays that the fast engines run on."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.choices import Drive, Precision
from commonrail.engine.block import Courses, Job
from commonrail.engine.lanes import VECTORS
from commonrail.engine.operating_point import Course, OperatingPoint, Trace
from commonrail.engine.population import candidate_matrix, columns
from commonrail.engine.stability import Medium, medium_of
from commonrail.engine.validity import check_point
from commonrail.errors import ConfigurationError
from commonrail.fuel.coefficients import fuel_coefficients
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector
from commonrail.injector.model import Inputs, Setting
from commonrail.injector.variants import wiring

Floats = NDArray[np.float64]

LOOK_AFTER = 100e-6  # earliest time after energising at which the end of injection is looked for [s]
LOOK_INTERVAL = 20e-6  # between looks at health and rest [s]
RESTING = 100e-6  # an injection has ended once needle and valve have rested this long [s]
SLOWEST_WAVE = 600.0  # below any sound speed of a fuel [m/s]: sizes the buffers of the travelling waves
MAXIMUM_STEPS = 2_000_000
_WAYS = {"feed_pipe.length": 1.0, "return_line.length": 2.0}  # of a wave in the buffers, in lengths


class Prepared(NamedTuple):
    """Arrays shared by all batches of an injector at the same operating points; `prepare` makes them.

    Attributes
    ----------
    injector : Injector
    points : sequence of OperatingPoint
    dt : float
        Time step [s].
    row : (parameters + fuel coefficients,)
        The injector's own full vector.
    courses : Courses
    begin : (points,)
        Time at which a simulation begins [s].
    densities : (1, points)
        `reference_densities` of the injector itself [kg/m³].
    medium : Medium
        Fuel at the largest rail pressure of all points, which decides how long a step may be.
    """

    injector: Injector
    points: Sequence[OperatingPoint]
    dt: float
    row: Floats
    courses: Courses
    begin: Floats
    densities: Floats
    medium: Medium


def prepare(injector: Injector, points: Sequence[OperatingPoint], dt: float) -> Prepared:
    """Work out once what many batches need.

    Parameters
    ----------
    injector : Injector
    points : sequence of OperatingPoint
    dt : float
        Time step [s].

    Raises
    ------
    ConfigurationError
        If a point has too many steps, no trace for a drive that needs one, or is refused by `check_point`.
    """
    for point in points:
        check_point(injector, point)
    steps = np.array([_steps(point, dt) for point in points])
    inputs = np.zeros((len(points), int(steps.max()), len(Inputs._fields)))
    for i, point in enumerate(points):
        inputs[i, : steps[i]] = _inputs(injector, point, dt, int(steps[i]))
    settings = np.array([point.initial_pressures() for point in points])
    return Prepared(
        injector,
        points,
        dt,
        candidate_matrix(injector, (), np.empty((1, 0)))[0],
        Courses(settings, inputs, steps, np.array([_quiet(point, dt) for point in points])),
        np.array([point.start for point in points]),
        reference_densities(injector, points),
        medium_of(injector, max(_largest(point.rail_pressure) for point in points)),
    )


def _largest(course: Course) -> float:
    return max(course.value) if isinstance(course, Trace) else course


def coefficients_at(injector: Injector, point: OperatingPoint, dt: float) -> Any:
    """Coefficients of an injector at a point, those of its actuation.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
    dt : float
        Time step [s].
    """
    fuel = fuel_coefficients(injector.fuel, injector.values[FUEL_TEMPERATURE])
    return wiring(injector.variant).setup(injector.parameters, fuel, Setting(*point.initial_pressures(), dt))


def reference_density(injector: Injector, point: OperatingPoint) -> float:
    """Fuel density at cylinder pressure of time zero and fuel temperature [kg/m³]."""
    return float(reference_densities(injector, [point])[0, 0])


def reference_densities(
    injector: Injector, points: Sequence[OperatingPoint], names: Sequence[str] = (), values: Floats | None = None
) -> Floats:
    """`reference_density` of candidates, each at its own fuel temperature [kg/m³].

    Parameters
    ----------
    injector, points
        As in `prepare`.
    names, values
        As in `candidate_matrix`; the temperature must lie in the fuel's range.

    Returns
    -------
    densities : (1 or candidates, points)
        One row where all candidates have the injector's own temperature.
    """
    pressures = [point.at_start(point.cylinder_pressure) for point in points]
    temperature = np.array([injector.values[FUEL_TEMPERATURE]])
    if values is not None and FUEL_TEMPERATURE in names:
        temperature = values[:, list(names).index(FUEL_TEMPERATURE)]
    warmth, candidate = np.unique(temperature, return_inverse=True)
    pressure, column = np.unique(pressures, return_inverse=True)
    return np.asarray(injector.fuel.density(pressure, warmth[:, None])[candidate][:, column])


def make_job(
    prepared: Prepared, theta: Floats, stop_when_closed: bool, width: int = VECTORS[Precision.F64].lanes
) -> Job:
    """Every candidate at every point, candidates of a point side by side.

    With a `width` of 8 lanes block b of a point holds candidates 8 b … 8 b + 7; a last block that is not full repeats
    its last candidate.

    Parameters
    ----------
    prepared : Prepared
    theta : (candidates, parameters + fuel coefficients)
        Of `candidate_matrix`.
    stop_when_closed : bool
        End a simulation once its needle has closed for good.
    width : int
        Lanes of a block.
    """
    dt, courses = prepared.dt, prepared.courses
    every = max(round(LOOK_INTERVAL / dt), 1)
    return Job(
        np.ascontiguousarray(theta),
        courses,
        blocks(len(theta), len(courses.steps), width),
        dt,
        _ring(prepared.injector, theta, dt, int(courses.steps.max())),
        every,
        max(round(RESTING / (every * dt)), 1) if stop_when_closed else 0,
    )


@functools.lru_cache(maxsize=4)
def blocks(candidates: int, points: int, width: int) -> NDArray[np.int64]:
    """Blocks of a full product of points and candidates: (blocks, 1 + width).

    Parameters
    ----------
    candidates, points : int
    width : int
        Lanes of a block.
    """
    per_point = -(-candidates // width)
    lanes = np.minimum(np.arange(per_point * width), candidates - 1).reshape(per_point, width)
    column = np.repeat(np.arange(points), per_point)[:, None]
    return np.hstack([column, np.tile(lanes, (points, 1))])


def by_candidate(figures: Floats, candidates: int, points: int) -> Floats:
    """Lane figures of a full product as (candidates, points).

    Parameters
    ----------
    figures : (blocks, lanes)
    candidates, points : int
    """
    return np.asarray(figures.reshape(points, -1)[:, :candidates].T)


def _steps(point: OperatingPoint, dt: float) -> int:
    steps = max(round(point.duration / dt), 1)
    if steps > MAXIMUM_STEPS:
        raise ConfigurationError(
            f"{point.duration:g} s in steps of {dt:g} s are {steps} steps; at most {MAXIMUM_STEPS} are allowed."
        )
    return steps


def _inputs(injector: Injector, point: OperatingPoint, dt: float, steps: int) -> Floats:
    begin: Floats = np.asarray(point.start + dt * np.arange(steps), float)
    inputs = np.empty((steps, len(Inputs._fields)))
    for i, course in enumerate(
        (point.rail_pressure, point.cylinder_pressure, point.return_pressure, _drive(injector, point))
    ):
        inputs[:, i] = _mean(course, begin, dt)
    starts = np.array([p.start for p in point.pulses])
    ends = np.array([p.start + p.duration for p in point.pulses])
    if not len(starts):
        inputs[:, 4:] = -1.0
        return inputs
    current = np.maximum(np.searchsorted(starts, begin + dt * (1.0 - 1e-9), side="left") - 1, 0)
    inputs[:, 4] = begin - starts[current] + _still_on(starts, ends, current, begin, dt)
    inputs[:, 5] = begin - ends[current]
    return inputs


def _still_on(starts: Floats, ends: Floats, current: NDArray[np.intp], begin: Floats, dt: float) -> Floats:
    """Time [s] in each step for which an energising before the current one still lasts.

    A step that sees one energising end and the next begin is energised for as long as both together: the next counts
    as begun so much earlier.
    """
    lasting = np.zeros(len(begin))
    for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
        on = np.minimum(end, begin + dt) - np.maximum(start, begin)
        lasting += np.where(i < current, np.maximum(on, 0.0), 0.0)
    return lasting


def _drive(injector: Injector, point: OperatingPoint) -> Course:
    traced = injector.variant.drive in (Drive.VOLTAGE, Drive.CURRENT)
    if traced and point.drive is None:
        raise ConfigurationError(
            f"{injector.name} is driven by a {injector.variant.drive.value}, but the operating point gives none; "
            "add its file, or set the injector's drive to regulated or pwm."
        )
    return point.drive if traced and point.drive is not None else 0.0


def _mean(course: Course, begin: Floats, dt: float) -> Floats:
    return course.mean(begin, np.asarray(begin + dt)) if isinstance(course, Trace) else np.full(len(begin), course)


def _quiet(point: OperatingPoint, dt: float) -> int:
    last = max((p.start + p.duration for p in point.pulses), default=point.start)
    if point.drive is not None:
        last = max(last, point.drive.time[-1])
    return round((last - point.start + LOOK_AFTER) / dt)


def _ring(injector: Injector, theta: Floats, dt: float, steps: int) -> int:
    names = tuple(name for name in _WAYS if name in injector.quantities)
    at = columns(names, injector.variant.actuation)
    way = max(_WAYS[name] * theta[:, i].max() for name, i in zip(names, at, strict=True))
    longest = min(way / SLOWEST_WAVE / dt, float(steps)) + 4.0
    return 1 << int(np.ceil(np.log2(longest)))
