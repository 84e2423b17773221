"""From injectors and operating points to the arrays that the fast engines run on."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from commonrail.arrays import Floats, Ints
from commonrail.choices import Precision
from commonrail.engine.courses import MAXIMUM_STEPS as MAXIMUM_STEPS
from commonrail.engine.courses import courses_of
from commonrail.engine.job import Courses, Job
from commonrail.engine.lanes import VECTORS
from commonrail.engine.operating_point import Course, OperatingPoint, Trace
from commonrail.engine.population import candidate_matrix, columns
from commonrail.engine.stability import Medium, medium_of
from commonrail.engine.validity import check_point, note_limits, note_narrow_pipe
from commonrail.fuel.coefficients import fuel_coefficients
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector
from commonrail.injector.model import Setting
from commonrail.injector.variants import wiring

CHECK_INTERVAL = 20e-6  # between checks of health and rest [s]
RESTING = 100e-6  # an injection has ended once needle and valve have rested this long [s]
SLOWEST_WAVE = 600.0  # below any sound speed of a fuel [m/s]: sizes the buffers of the travelling waves
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
    highest : (points,)
        Largest rail pressure at each point [Pa].
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
    highest: Floats
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
    note_limits(injector, points)
    note_narrow_pipe(injector, points)
    highest = np.array([_largest(point.rail_pressure) for point in points])
    return Prepared(
        injector=injector,
        points=points,
        dt=dt,
        row=candidate_matrix(injector, (), np.empty((1, 0)))[0],
        courses=courses_of(injector, points, dt),
        begin=np.array([point.start for point in points]),
        densities=reference_densities(injector, points),
        highest=highest,
        medium=medium_of(injector, float(highest.max())),
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
    prepared: Prepared,
    theta: Floats,
    stop_when_closed: bool,
    width: int = VECTORS[Precision.F64].lanes,
    *,
    apart: bool = False,
) -> Job:
    """Every candidate at every point, in blocks of lanes.

    Parameters
    ----------
    prepared : Prepared
    theta : (candidates, parameters + fuel coefficients)
        Of `candidate_matrix`.
    stop_when_closed : bool
        End a simulation once its needle has closed for good.
    width : int
        Lanes of a block.
    apart : bool
        As in `fill_lanes`; samples to compare with demand it.
    """
    dt, courses = prepared.dt, prepared.courses
    every = max(round(CHECK_INTERVAL / dt), 1)
    points, candidates = fill_lanes(courses, len(theta), width, by_earliest_end=stop_when_closed, apart=apart)
    return Job(
        theta=np.ascontiguousarray(theta),
        courses=courses,
        points=points,
        candidates=candidates,
        dt=dt,
        ring=_ring(prepared.injector, theta, dt, int(courses.steps.max())),
        check_every=every,
        checks_at_rest=max(round(RESTING / (every * dt)), 1) if stop_when_closed else 0,
    )


@functools.lru_cache(maxsize=4)
def _lanes(order: bytes, starts: bytes, candidates: int, width: int) -> tuple[Ints, Ints]:
    """Points and candidates of the lanes, (blocks, width) each.

    Parameters
    ----------
    order : bytes of int
        Points in the order in which they fill the lanes.
    starts : bytes of int
        Places in that order at which a new block begins, zero included.
    candidates : int
    width : int
        Lanes of a block.
    """
    filled = []
    for part in np.split(np.frombuffer(order, np.int64), np.frombuffer(starts, np.int64)[1:]):
        pairs = np.stack([np.repeat(part, candidates), np.tile(np.arange(candidates), len(part))])
        spare = -pairs.shape[1] % width
        filled.append(np.concatenate([pairs, np.repeat(pairs[:, -1:], spare, axis=1)], axis=1))
    points, own = np.concatenate(filled, axis=1).reshape(2, -1, width)
    return np.ascontiguousarray(points), np.ascontiguousarray(own)


def fill_lanes(
    courses: Courses, candidates: int, width: int, *, by_earliest_end: bool = False, apart: bool = False
) -> tuple[Ints, Ints]:
    """Points and candidates of the lanes of each block, (blocks, width) each: every candidate at every point.

    Points follow one another by the end of their simulation, so that the lanes of a block, and the blocks of each
    thread, end at about the same time. A last block that is not full repeats its last lane.

    Parameters
    ----------
    courses : Courses
    candidates : int
    width : int
        Lanes of a block.
    by_earliest_end : bool
        Simulations end once their injection has ended, rather than at their horizon.
    apart : bool
        Only candidates at the same point share a block.
    """
    points = len(courses.steps)
    end = courses.earliest_end if by_earliest_end else courses.steps
    order = np.lexsort((courses.settings[:, 0], -end, courses.clock)) if points > 1 else np.zeros(1, np.int64)
    clock = courses.clock[order]
    starts = np.arange(points) if apart else np.append(0, 1 + np.flatnonzero(clock[1:] != clock[:-1]))
    return _lanes(order.astype(np.int64).tobytes(), starts.astype(np.int64).tobytes(), candidates, width)


def _ring(injector: Injector, theta: Floats, dt: float, steps: int) -> int:
    names = tuple(name for name in _WAYS if name in injector.quantities)
    at = columns(names, injector.variant.actuation)
    way = max(_WAYS[name] * theta[:, i].max() for name, i in zip(names, at, strict=True))
    longest = min(way / SLOWEST_WAVE / dt, float(steps)) + 4.0
    return 1 << int(np.ceil(np.log2(longest)))
