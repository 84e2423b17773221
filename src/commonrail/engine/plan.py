"""From injectors and operating points to the arrays that the lanes run on."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.choices import Drive, Precision
from commonrail.engine.block import FUEL
from commonrail.engine.lanes import VECTORS, Job
from commonrail.engine.operating_point import Course, OperatingPoint, Trace
from commonrail.engine.stability import Medium, medium_of
from commonrail.engine.validity import check_point
from commonrail.errors import ConfigurationError
from commonrail.fuel.coefficients import fuel_coefficients
from commonrail.fuel.fuel import Fuel
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector, parameter_paths, parameter_quantities
from commonrail.parts.furniture import Domain

Floats = NDArray[np.float64]

LOOK_AFTER = 100e-6  # earliest time after energising at which the end of injection is looked for [s]
LOOK_INTERVAL = 20e-6  # between looks at health and rest [s]
RESTING = 100e-6  # an injection has ended once needle and valve have rested this long [s]
SLOWEST_WAVE = 600.0  # below any sound speed of a fuel [m/s]: sizes the buffers of the travelling waves
MAXIMUM_STEPS = 2_000_000


class Prepared(NamedTuple):
    """What all batches of an injector at the same operating points share; `prepare` makes it.

    Attributes
    ----------
    points : sequence of OperatingPoint
    row : (parameters + fuel coefficients,)
        The injector's own full vector.
    settings, inputs, steps, quiet
        As in `Job`.
    begin : (points,)
        Time at which a simulation begins [s].
    densities : (1, points)
        `reference_densities` of the injector itself [kg/m³].
    medium : Medium
        Fuel at the largest rail pressure of all points, which decides how long a step may be.
    """

    points: Sequence[OperatingPoint]
    row: Floats
    settings: Floats
    inputs: Floats
    steps: NDArray[np.int64]
    quiet: NDArray[np.int64]
    begin: Floats
    densities: Floats
    medium: Medium


def prepare(injector: Injector, points: Sequence[OperatingPoint], dt: float) -> Prepared:
    """Work out once what many batches need.

    Raises
    ------
    ConfigurationError
        If a point has too many steps, no trace for a drive that needs one, or is refused by `check_point`.
    """
    for point in points:
        check_point(injector, point)
    steps = np.array([_steps(point, dt) for point in points])
    inputs = np.zeros((len(points), int(steps.max()), 6))
    for i, point in enumerate(points):
        inputs[i, : steps[i]] = _inputs(injector, point, dt, int(steps[i]))
    return Prepared(
        points,
        candidate_matrix(injector, (), np.empty((1, 0)))[0],
        np.array([point.initial_pressures() for point in points]),
        inputs,
        steps,
        np.array([_quiet(point, dt) for point in points]),
        np.array([point.start for point in points]),
        reference_densities(injector, points),
        medium_of(injector, max(_largest(point.rail_pressure) for point in points)),
    )


def _largest(course: Course) -> float:
    return max(course.value) if isinstance(course, Trace) else course


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


def candidate_matrix(
    injector: Injector, names: Sequence[str], values: Floats, prepared: Prepared | None = None
) -> Floats:
    """Full parameter vectors of candidates: (candidates, parameters + fuel coefficients).

    Parameters
    ----------
    injector : Injector
        Gives the values that do not vary.
    names : sequence of str
        Dotted names of the values that vary; "fuel.temperature" may be among them.
    values : (candidates, names)
        SI values.
    prepared : Prepared, optional
        Of the same injector.
    """
    if prepared is not None and FUEL_TEMPERATURE not in names:
        theta = np.empty((len(values), len(prepared.row)))
        theta[:] = prepared.row
        theta[:, _columns(tuple(names))] = values
        return theta
    paths = parameter_paths()
    theta = np.empty((len(values), len(paths) + len(FUEL.paths)))
    theta[:, : len(paths)] = [injector.values[path] for path in paths]
    temperature = np.full(len(values), injector.values[FUEL_TEMPERATURE])
    for column, name in enumerate(names):
        if name == FUEL_TEMPERATURE:
            temperature = values[:, column]
        else:
            theta[:, paths.index(name)] = values[:, column]
    distinct, which = np.unique(temperature, return_inverse=True)
    fuels = np.array([fuel_coefficients(injector.fuel, float(t)) for t in distinct])
    theta[:, len(paths) :] = fuels[which]
    return theta


@functools.lru_cache(maxsize=64)
def _columns(names: tuple[str, ...]) -> NDArray[np.intp]:
    """Where parameters stand in a full vector."""
    paths = parameter_paths()
    return np.array([paths.index(name) for name in names], np.intp)


def admissible(names: Sequence[str], values: Floats, fuel: Fuel | None = None) -> NDArray[np.bool_]:
    """Which candidates lie in the domain of their parameters, and in the fuel's range of temperature: (candidates,)."""
    inside = np.isfinite(values)
    if fuel is not None and FUEL_TEMPERATURE in names:
        column = list(names).index(FUEL_TEMPERATURE)
        inside[:, column] &= fuel.defined_at(values[:, column])
    for domain, columns in _domains(tuple(names)):
        inside[:, columns] &= domain.admits(values[:, columns])
    return np.asarray(inside.all(axis=1))


@functools.lru_cache(maxsize=64)
def _domains(names: tuple[str, ...]) -> list[tuple[Domain, list[int] | slice]]:
    """Domains of parameters, and the places of those that lie in each."""
    known = parameter_quantities()
    found: dict[Domain, list[int]] = {}
    for column, name in enumerate(names):
        found.setdefault(known[name].domain, []).append(column)
    if len(found) == 1:
        return [(domain, slice(None)) for domain in found]
    return list(found.items())


def make_job(
    injector: Injector,
    theta: Floats,
    points: Sequence[OperatingPoint],
    dt: float,
    stop_when_closed: bool,
    width: int = VECTORS[Precision.F64].lanes,
    prepared: Prepared | None = None,
) -> Job:
    """Every candidate at every point, candidates of a point side by side.

    With a `width` of 8 lanes block b of a point holds candidates 8 b … 8 b + 7; a last block that is not full repeats
    its last candidate.
    """
    given = prepared or prepare(injector, points, dt)
    every = max(round(LOOK_INTERVAL / dt), 1)
    return Job(
        np.ascontiguousarray(theta),
        given.settings,
        given.inputs,
        given.steps,
        given.quiet,
        blocks(len(theta), len(points), width),
        dt,
        _ring(theta, dt, int(given.steps.max())),
        every,
        max(round(RESTING / (every * dt)), 1) if stop_when_closed else 0,
    )


@functools.lru_cache(maxsize=4)
def blocks(candidates: int, points: int, width: int) -> NDArray[np.int64]:
    """Blocks of a full product of points and candidates: (blocks, 1 + width)."""
    per_point = -(-candidates // width)
    lanes = np.minimum(np.arange(per_point * width), candidates - 1).reshape(per_point, width)
    column = np.repeat(np.arange(points), per_point)[:, None]
    return np.hstack([column, np.tile(lanes, (points, 1))])


def by_candidate(figures: Floats, candidates: int, points: int) -> Floats:
    """Lane figures (blocks, lanes) of a full product as (candidates, points)."""
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
    columns = np.empty((steps, 6))
    for i, course in enumerate(
        (point.rail_pressure, point.cylinder_pressure, point.return_pressure, _drive(injector, point))
    ):
        columns[:, i] = _mean(course, begin, dt)
    starts = np.array([p.start for p in point.pulses])
    ends = np.array([p.start + p.duration for p in point.pulses])
    if not len(starts):
        columns[:, 4:] = -1.0
        return columns
    current = np.maximum(np.searchsorted(starts, begin + dt * (1.0 - 1e-9), side="left") - 1, 0)
    columns[:, 4] = begin - starts[current] + _still_on(starts, ends, current, begin, dt)
    columns[:, 5] = begin - ends[current]
    return columns


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


def _ring(theta: Floats, dt: float, steps: int) -> int:
    pipe, line = _columns(("feed_pipe.length", "return_line.length"))
    feed = theta[:, pipe].max()
    back = 2.0 * theta[:, line].max()
    longest = min(max(feed, back) / SLOWEST_WAVE / dt, float(steps)) + 4.0
    return 1 << int(np.ceil(np.log2(longest)))
