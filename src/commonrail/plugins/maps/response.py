"""Quantities of one injector at many pairs of rail pressure and energising time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Bools, Floats, Ints
from commonrail.base.choices import Precision
from commonrail.base.errors import SimulationError
from commonrail.engine.lanes import load_loop
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, prepare, reference_density
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK, STILL_INJECTING, Status
from commonrail.engine.threads import usable_threads
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.injector import Injector

# Time simulated after the end of energising, plus a share of the energising. A simulation ends early once the needle
# has closed. If the needle is still open, the simulation is repeated with the longest horizon.
AFTER = (2e-3, 0.5)  # [s], [1]
LONGEST_AFTER = 12e-3  # [s]


class Conditions(NamedTuple):
    """Cylinder and return pressure [Pa], time step [s] and threads, shared by all points of a map."""

    cylinder_pressure: float = 5e6
    return_pressure: float = 0.5e6
    time_step: float = DEFAULT_STEP
    threads: int | None = None

    def point(self, rail_pressure: float, energising_time: float) -> OperatingPoint:
        """Operating point of a single injection: rail pressure [Pa], energising time [s]."""
        horizon = (1.0 + AFTER[1]) * energising_time + AFTER[0]
        return OperatingPoint(
            rail_pressure, energising_time, self.cylinder_pressure, self.return_pressure, horizon=horizon
        )


# Simulation of many operating points that share their pressures and energisings.

AT_A_TIME = 2048  # points of a batch: Ctrl-C takes effect between batches
ENOUGH = 4  # fewest batches per thread for each batch to run in one thread


def simulate_many(
    injector: Injector,
    points: Sequence[OperatingPoint],
    conditions: Conditions,
    names: Sequence[str] = (),
    values: Floats | None = None,
) -> Batch:
    """Simulate all candidates at all points without traces, some points at a time to save memory.

    Only the time step and the threads of the conditions are used. Candidates are SI `values` (candidates, names) of
    parameters; default: the injector itself. Many batches are prepared and simulated in parallel, each by one
    thread, to avoid waiting. The bits are the same as those of `simulate_batch`.
    `ConfigurationError` if the injector's model or its fuel does not cover a point.
    """
    step, threads = check_step(conditions.time_step), conditions.threads or usable_threads()
    places = [slice(first, first + AT_A_TIME) for first in range(0, len(points), AT_A_TIME)]

    def simulate_slice(place: slice, threads: int) -> Batch:
        prepared = prepare_shared(injector, points[place], step)
        return simulate_batch(
            injector, prepared.points, names, values, time_step=step, threads=threads, prepared=prepared
        )

    if len(places) < ENOUGH * threads:
        return _join_batches([simulate_slice(place, threads) for place in places])
    load_loop(injector.wired(names), Precision.F64, False)  # in the calling thread, where Ctrl-C ends it
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(copy_context().run, simulate_slice, place, 1) for place in places]
        return _join_batches([future.result() for future in futures])


def _join_batches(parts: Sequence[Batch]) -> Batch:
    """Join batches of consecutive points."""
    names = Batch.__dataclass_fields__
    return Batch(**{name: np.concatenate([getattr(batch, name) for batch in parts], axis=1) for name in names})


def prepare_shared(injector: Injector, points: Sequence[OperatingPoint], dt: float) -> Prepared:
    """Prepare points without traces as `plan.prepare`, computing each set of pressures and each energising once."""
    pressures: dict[object, int] = {}
    energisings: dict[object, int] = {}
    by_pressure, by_energising = [], []
    distinct: list[OperatingPoint] = []
    for point in points:
        pressure = point.rail_pressure, point.cylinder_pressure, point.return_pressure
        energising = point.energisings, point.horizon, point.start
        # prepare only points with new pressures or a new energising; their index serves both
        if pressure not in pressures or energising not in energisings:
            pressures.setdefault(pressure, len(distinct))
            energisings.setdefault(energising, len(distinct))
            distinct.append(point)
        by_pressure.append(pressures[pressure])
        by_energising.append(energisings[energising])
    few = prepare(injector, distinct, dt)
    once = few.courses
    return few._replace(
        points=points,
        courses=once._replace(
            settings=once.settings[by_pressure],
            steps=once.steps[by_energising],
            earliest_end=once.earliest_end[by_energising],
            clock=once.clock[by_energising],
            first=once.first[by_energising],
            trace=once.trace[by_energising],
        ),
        begin=few.begin[by_energising],
        densities=few.densities[:, by_pressure],
        highest=few.highest[by_pressure],
    )


@dataclass(frozen=True)
class Response:
    """Simulated injections: volume at the reference density [m³] and largest needle lift [m], arrays of one shape.

    A volume is NaN if the simulation failed or the needle did not close.
    """

    volume: Floats
    lift: Floats

    def only(self, which: Bools) -> Response:
        """Injections of a mask."""
        return Response(self.volume[which], self.lift[which])


def density_at(injector: Injector, conditions: Conditions) -> float:
    """Reference density [kg/m³], at cylinder pressure, which converts volumes of a map to masses."""
    return reference_density(injector, conditions.point(max(20e6, 2.0 * conditions.cylinder_pressure), 1e-4))


def respond(injector: Injector, rail_pressure: Floats, energising_time: Floats, conditions: Conditions) -> Response:
    """Simulate single injections at rail pressures (n,) [Pa] and energising times (n,) [s].

    An injection whose needle is still open is repeated with a longer horizon. `ConfigurationError` if the injector's
    model does not cover a point.
    """
    pairs = zip(rail_pressure.tolist(), energising_time.tolist(), strict=True)
    points = [conditions.point(*pair) for pair in pairs]
    volume, lift, status = _simulate_points(injector, points, conditions)
    open_ = np.flatnonzero(status == STILL_INJECTING).tolist()
    if open_:
        longer = [replace(points[i], horizon=points[i].end_of_energising + LONGEST_AFTER) for i in open_]
        volume[open_], lift[open_], status[open_] = _simulate_points(injector, longer, conditions)
    return Response(np.where(status == OK, volume, np.nan), lift)


def _simulate_points(
    injector: Injector, points: Sequence[OperatingPoint], conditions: Conditions
) -> tuple[Floats, Floats, Ints]:
    """Volumes [m³], lifts [m] and statuses of points."""
    batch = simulate_many(injector, points, conditions)
    return batch.injected_volume[0], batch.greatest_lift[0], batch.status[0]


# Quantity over energising time at each rail pressure: samples, falls, and brackets of a quantity.

# Spacing of the simulated energising times: within the first half millisecond, where the needle turns before its
# stop, a fall of the quantity is tens of microseconds wide; later the quantity is nearly linear.
FINE_UNTIL = 500e-6  # [s]
FINE = 12.5e-6  # [s]
SHORTEST = 50e-6  # below it no injector opens its needle [s]
GROWTH = 1.12  # ratio of neighbouring times beyond the fine range

FALL = 0.01e-9  # smallest fall that is listed [m³]: half the tolerance of the inverse


class Fall(NamedTuple):
    """Fall of the quantity although the injector is energised for longer.

    Rail pressure [Pa], energising times at the largest and at the smallest quantity [s], and these quantities [m³].
    """

    rail_pressure: float
    start: float
    end: float
    high: float
    low: float


class Line(NamedTuple):
    """Samples at one rail pressure [Pa], sorted: energising times [s], volumes [m³] and largest lifts [m].

    A volume is NaN if the simulation failed.
    """

    rail_pressure: float
    time: Floats
    volume: Floats
    lift: Floats

    def add_samples(self, time: Floats, response: Response) -> Line:
        """Line with more samples, at times (n,) [s]."""
        times = np.concatenate([self.time, time])
        order = np.argsort(times, kind="stable")
        volume = np.concatenate([self.volume, response.volume])[order]
        return Line(self.rail_pressure, times[order], volume, np.concatenate([self.lift, response.lift])[order])

    def at(self, times: Floats) -> Response:
        """Samples at times [s] that are among them."""
        places = np.searchsorted(self.time, times)
        return Response(self.volume[places], self.lift[places])


def require_some(injector: Injector, lines: Sequence[Line], conditions: Conditions) -> None:
    """Raise `SimulationError` if no line has a volume, with the reason at the last sample of the last line."""
    if all(np.isnan(line.volume).all() for line in lines):
        point = conditions.point(lines[-1].rail_pressure, float(lines[-1].time[-1]))
        status = _simulate_points(injector, [point], conditions)[2]
        raise SimulationError(f"{injector.name}: no point could be simulated. {Status(int(status[0])).sentence}")


def sample_times(times: Floats) -> Floats:
    """Energising times simulated at each rail pressure: an axis and a fine grid up to its end [s]."""
    longest = float(times[-1])
    count = int(np.ceil(np.log(max(longest / FINE_UNTIL, 1.0)) / np.log(GROWTH)))
    coarse = FINE_UNTIL * GROWTH ** np.arange(1, count)
    grid = np.concatenate([np.arange(SHORTEST, FINE_UNTIL + FINE / 2, FINE), coarse])
    # drop grid times next to one of the axis
    is_distinct = np.min(np.abs(grid[:, None] - times), axis=1) > FINE / 4
    return np.unique(np.concatenate([times, grid[(grid < longest) & is_distinct]]))


def find_falls(line: Line) -> Iterator[Fall]:
    """Falls of the quantity along a line from `FALL` on, each from its largest to its smallest quantity."""
    sound = np.flatnonzero(np.isfinite(line.volume))
    time, volume = line.time[sound], line.volume[sound]
    peak = trough = 0
    for i in range(1, len(time)):
        if volume[i] <= volume[trough]:
            trough = i
        elif volume[i] - volume[trough] > FALL or volume[i] > volume[peak]:  # it rises again
            yield from _fall(line, time, volume, peak, trough)
            peak = trough = i
        if volume[i] >= volume[peak]:
            peak = trough = i
    if len(time):
        yield from _fall(line, time, volume, peak, trough)


def _fall(line: Line, time: Floats, volume: Floats, peak: int, trough: int) -> Iterator[Fall]:
    if volume[peak] - volume[trough] > FALL:
        times, volumes = time[[peak, trough]].tolist(), volume[[peak, trough]].tolist()
        yield Fall(line.rail_pressure, *times, *volumes)
