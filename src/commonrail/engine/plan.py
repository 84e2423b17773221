"""Convert injectors and operating points to the arrays of the fast engines."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import array, sequence
from commonrail.base.arrays import Bools, Floats, IndexArray, Ints
from commonrail.base.choices import Actuation, Precision
from commonrail.base.errors import ConfigurationError
from commonrail.engine.courses import courses_of
from commonrail.engine.job import VECTORS, Courses, Job, Outcome
from commonrail.engine.operating_point import Course, OperatingPoint, Trace
from commonrail.engine.status import OK, STILL_INJECTING, Status, check_point, note_limits, note_narrow_pipe
from commonrail.engine.time_step import Medium, medium_of, too_long
from commonrail.physics.fuel import Fuel
from commonrail.physics.fuel_polynomials import coefficient_rows, fuel_coefficients
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_paths, parameter_quantities
from commonrail.physics.law import Domain
from commonrail.physics.model import Setting
from commonrail.physics.variants import wiring

# From a user's values for many candidates to full parameter vectors.


def read_candidates(names: Sequence[str], values: ArrayLike | None) -> Floats:
    """Values (candidates, names) as SI numbers; text is read in the unit of its own column."""
    if values is None:
        candidates = np.empty((1, 0))
    elif isinstance(values, np.ndarray) and values.dtype.kind in "iuf":
        candidates = np.atleast_2d(np.asarray(values, float))
    else:
        candidates = _read_rows(names, values)
    if candidates.ndim != 2 or candidates.shape[1] != len(names):
        raise ConfigurationError(
            f"{len(names)} names but {candidates.shape[-1]} values a candidate were given: the values must have a row "
            "for each candidate and in it one value for each name, such as [[1e-3], [2e-3]] for one name."
        )
    if not len(candidates):
        raise ConfigurationError("At least one candidate is needed among the values.")
    return candidates


def _read_rows(names: Sequence[str], values: Any) -> Floats:
    rows = sequence(values, "values", "[[1e-3], [2e-3]], a row for each candidate")
    if not any(isinstance(row, Sequence | np.ndarray) and not isinstance(row, str) for row in rows):
        rows = [rows]
    quantities = parameter_quantities()
    read = []
    for i, row in enumerate(rows, start=1):
        what = f"values of candidate {i}"
        items = sequence(row, what, "[1e-3]")
        if len(items) != len(names):
            raise ConfigurationError(f"{len(names)} names but {len(items)} {what} were given; give one for each name.")
        read.append(
            [
                float(array(item, quantities[name].unit, f"{what}, {name}", 0, finite=False))
                for item, name in zip(items, names, strict=True)
            ]
        )
    return np.reshape(read, (len(read), len(names))).astype(float)


def candidate_matrix(injector: Injector, names: Sequence[str], values: Floats, row: Floats | None = None) -> Floats:
    """Full parameter vectors of candidates: (candidates, parameters + fuel coefficients).

    `injector`: gives the fixed values; `names`: dotted names of the values that vary, possibly with "fuel.temperature";
    `values` (candidates, names): SI values; `row` (parameters + fuel coefficients,), optional: the
    injector's own full vector, if already computed.
    """
    actuation = injector.variant.actuation
    paths = parameter_paths(actuation)
    if row is None:
        fuel = coefficient_rows(injector.fuel, (injector.values[FUEL_TEMPERATURE],))[0]
        row = np.array([*(injector.values[path] for path in paths), *fuel.tolist()])
    theta = np.empty((len(values), len(row)))
    theta[:] = row
    if FUEL_TEMPERATURE in names:
        column = list(names).index(FUEL_TEMPERATURE)
        distinct, which = np.unique(values[:, column], return_inverse=True)
        theta[:, len(paths) :] = coefficient_rows(injector.fuel, tuple(distinct.tolist()))[which]
        names, values = [*names[:column], *names[column + 1 :]], np.delete(values, column, axis=1)
    theta[:, columns(tuple(names), actuation)] = values
    return theta


@functools.lru_cache(maxsize=64)
def columns(names: tuple[str, ...], actuation: Actuation = Actuation.SERVO) -> IndexArray:
    """Positions of parameters in a full vector of an actuation."""
    paths = parameter_paths(actuation)
    return np.array([paths.index(name) for name in names], np.intp)


def admissible(
    names: Sequence[str], values: Floats, fuel: Fuel | None = None, actuation: Actuation | None = None
) -> Bools:
    """True for candidates in the domain of their parameters, and in the fuel's range of temperature: (candidates,).

    `fuel` (Fuel, optional): without it the range of temperature is not checked;
    `actuation` (Actuation, optional): with these parameters, by default any.
    """
    inside = np.isfinite(values)
    if fuel is not None and FUEL_TEMPERATURE in names:
        column = list(names).index(FUEL_TEMPERATURE)
        inside[:, column] &= fuel.is_defined_at(values[:, column])
    for domain, where in _domains(tuple(names), actuation):
        inside[:, where] &= domain.admits(values[:, where])
    return np.asarray(inside.all(axis=1))


@functools.lru_cache(maxsize=64)
def _domains(names: tuple[str, ...], actuation: Actuation | None) -> list[tuple[Domain, list[int] | slice]]:
    """Domains of parameters, and the columns of each."""
    quantities = parameter_quantities(actuation)
    columns: dict[Domain, list[int]] = {}
    for column, name in enumerate(names):
        columns.setdefault(quantities[name].domain, []).append(column)
    if len(columns) == 1:
        return [(domain, slice(None)) for domain in columns]
    return list(columns.items())


CHECK_INTERVAL = 20e-6  # between checks of health and rest [s]
RESTING = 100e-6  # time at rest of needle and valve after which an injection has ended [s]
SLOWEST_WAVE = 600.0  # below the sound speed of any fuel [m/s]: sizes the buffers of the travelling waves
_WAYS = {"feed_pipe.length": 1.0, "return_line.length": 2.0}  # of a wave in the buffers, in lengths


class Prepared(NamedTuple):
    """Arrays shared by all batches of an injector at the same operating points; `prepare` makes them."""

    injector: Injector
    points: Sequence[OperatingPoint]
    dt: float  # time step [s]
    row: Floats  # (parameters + fuel coefficients,): the injector's own full vector
    courses: Courses
    begin: Floats  # (points,): time at which a simulation begins [s]
    densities: Floats  # (1, points): `reference_densities` of the injector itself [kg/m³]
    highest: Floats  # (points,): largest rail pressure at each point [Pa]
    medium: Medium  # fuel at the largest rail pressure of all points, which decides how long a step may be


def prepare(injector: Injector, points: Sequence[OperatingPoint], dt: float) -> Prepared:
    """Compute the data shared by many batches once.

    `dt`: time step [s]. `ConfigurationError` if a point has too many steps, lacks a trace for its drive,
    or is refused by `check_point`.
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
    """Coefficients of an injector at a point."""
    fuel = fuel_coefficients(injector.fuel, injector.values[FUEL_TEMPERATURE])
    return wiring(injector.variant).setup(injector.parameters, fuel, Setting(*point.initial_pressures(), dt))


def reference_density(injector: Injector, point: OperatingPoint) -> float:
    """Fuel density at cylinder pressure of time zero and fuel temperature [kg/m³]."""
    return float(reference_densities(injector, [point])[0, 0])


def reference_densities(
    injector: Injector, points: Sequence[OperatingPoint], names: Sequence[str] = (), values: Floats | None = None
) -> Floats:
    """`reference_density` of candidates, each at its own fuel temperature [kg/m³].

    `names`, `values`: as in `candidate_matrix`; the temperature must lie in the fuel's range.

    Returns `densities` (1 or candidates, points): one row if all candidates have the injector's own temperature.
    """
    pressures = [point.at_start(point.cylinder_pressure) for point in points]
    if values is None or FUEL_TEMPERATURE not in names:
        return np.array([_densities(injector.fuel, tuple(pressures), injector.values[FUEL_TEMPERATURE])])
    warmth, candidate = np.unique(values[:, list(names).index(FUEL_TEMPERATURE)], return_inverse=True)
    pressure, column = np.unique(pressures, return_inverse=True)
    return np.asarray(injector.fuel.density(pressure, warmth[:, None])[candidate][:, column])


@functools.lru_cache(maxsize=64)
def _densities(fuel: Fuel, pressures: tuple[float, ...], temperature: float) -> tuple[float, ...]:
    """Densities [kg/m³] at one temperature, which take half a millisecond: cached for the next batch."""
    pressure, column = np.unique(pressures, return_inverse=True)
    return tuple(fuel.density(pressure, temperature)[column].tolist())


def make_job(
    prepared: Prepared,
    theta: Floats,
    stop_when_closed: bool,
    width: int = VECTORS[Precision.F64].lanes,
    *,
    separate_points: bool = False,
) -> Job:
    """Every candidate at every point, in blocks of lanes.

    `theta` (candidates, parameters + fuel coefficients): of `candidate_matrix`; `stop_when_closed`: end a simulation
    once its needle has closed for good; `width`: lanes of a block; `separate_points`: as in `fill_lanes`, required by
    samples to compare with.
    """
    dt, courses = prepared.dt, prepared.courses
    every = max(round(CHECK_INTERVAL / dt), 1)
    points, candidates = fill_lanes(
        courses, len(theta), width, by_earliest_end=stop_when_closed, separate_points=separate_points
    )
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

    `order`: points in the order in which they fill the lanes; `starts`: places in that order at which a new block
    begins, zero included; `width`: lanes of a block.
    """
    filled = []
    for point_group in np.split(np.frombuffer(order, np.int64), np.frombuffer(starts, np.int64)[1:]):
        pairs = np.stack([np.repeat(point_group, candidates), np.tile(np.arange(candidates), len(point_group))])
        spare = -pairs.shape[1] % width
        filled.append(np.concatenate([pairs, np.repeat(pairs[:, -1:], spare, axis=1)], axis=1))
    points, lane_candidates = np.concatenate(filled, axis=1).reshape(2, -1, width)
    return np.ascontiguousarray(points), np.ascontiguousarray(lane_candidates)


def fill_lanes(
    courses: Courses, candidates: int, width: int, *, by_earliest_end: bool = False, separate_points: bool = False
) -> tuple[Ints, Ints]:
    """Points and candidates of the lanes of each block, (blocks, width) each: every candidate at every point.

    Points are sorted by the end of their simulation: the lanes of a block, and the blocks of each
    thread, then end at about the same time. A last block that is not full repeats its last lane.

    `width`: lanes of a block; `by_earliest_end`: simulations end once their injection has ended, rather than at their
    horizon; `separate_points`: only candidates at the same point share a block.
    """
    points = len(courses.steps)
    end = courses.earliest_end if by_earliest_end else courses.steps
    order = np.lexsort((courses.settings[:, 0], -end, courses.clock)) if points > 1 else np.zeros(1, np.int64)
    clock = courses.clock[order]
    starts = np.arange(points) if separate_points else np.append(0, 1 + np.flatnonzero(clock[1:] != clock[:-1]))
    return _lanes(order.astype(np.int64).tobytes(), starts.astype(np.int64).tobytes(), candidates, width)


def _ring(injector: Injector, theta: Floats, dt: float, steps: int) -> int:
    names = tuple(name for name in _WAYS if name in injector.quantities)
    at = columns(names, injector.variant.actuation)
    way = max(_WAYS[name] * theta[:, i].max() for name, i in zip(names, at, strict=True))
    longest = min(way / SLOWEST_WAVE / dt, float(steps)) + 4.0
    return 1 << int(np.ceil(np.log2(longest)))


# Statuses of simulations, from what the compiled loop has recorded.

BACKFLOW = 1e-7  # largest mass that a SAC takes back from the cylinder [kg]; more is an injector that has run empty


def statuses_of(names: Sequence[str], theta: Floats, prepared: Prepared, outcome: Outcome) -> Ints:
    """Status of each candidate at each operating point: (candidates, points).

    `names`: parameters in which the candidates differ; `theta` (candidates, parameters): flat parameter vectors;
    `prepared`: injector, operating points and step; `outcome`: figures of the run.
    """
    status = np.full((len(theta), len(prepared.points)), OK)
    status[outcome.closed_at_end == 0.0] = STILL_INJECTING
    bad = outcome.sound == 0.0
    if bad.any():
        finite = np.isfinite(outcome.injected)
        status[bad] = np.where(finite[bad], Status.RAN_AWAY, Status.NOT_FINITE)
    status[outcome.injected < -BACKFLOW] = Status.NOT_FINITE
    # whatever came out: beyond the limit, at the greatest lift that was reached, a plausible figure may be far off
    status[_step_too_long(names, theta, prepared, np.nan_to_num(outcome.greatest_lift))] = Status.STEP_UNSTABLE
    status[outcome.closed_at_start == 0.0] = Status.NOT_CLOSED_AT_START
    return status


def _step_too_long(names: Sequence[str], theta: Floats, prepared: Prepared, lifts: Floats) -> Bools:
    """True for (candidates, points) whose step is too long at the point's own rail pressure and largest lift.

    `lifts` (candidates, points): [m].
    """
    injector, dt, points = prepared.injector, prepared.dt, lifts.shape[1]
    # fuel is stiffest at the largest pressure: a candidate stable there, at its largest lift, is stable at every point
    step_too_long = np.repeat(
        too_long(injector, names, theta, prepared.medium, dt, lifts.max(axis=1))[:, None], points, axis=1
    )
    asked = np.flatnonzero(step_too_long[:, 0])
    if points > 1 and len(asked):
        modulus, speed, at_return = medium_of(injector, prepared.highest)
        medium = Medium(np.tile(modulus, len(asked)), np.tile(speed, len(asked)), at_return)
        rows = np.repeat(theta[asked], points, axis=0)
        step_too_long[asked] = too_long(injector, names, rows, medium, dt, lifts[asked].ravel()).reshape(-1, points)
    return step_too_long
