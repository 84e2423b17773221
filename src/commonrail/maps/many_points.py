"""Simulation of many operating points that share their pressures and energisings."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from commonrail.arrays import Floats, Ints
from commonrail.choices import Precision
from commonrail.engine.job import Courses
from commonrail.engine.lanes import compiled
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, prepare
from commonrail.engine.simulate import simulate_batch, usable_threads
from commonrail.engine.solution import Batch
from commonrail.engine.time_step import check_step
from commonrail.injector.definition import Injector

__all__ = ["prepare_shared", "simulate_many"]


AT_A_TIME = 2048  # points of a batch: Ctrl-C is heeded between batches
ENOUGH = 4  # batches for each thread from which on every thread has batches of its own


def simulate_many(
    injector: Injector,
    points: Sequence[OperatingPoint],
    names: Sequence[str] = (),
    values: Floats | None = None,
    *,
    time_step: float,
    threads: int | None = None,
) -> Batch:
    """Simulate all candidates at all points, some points at a time to save memory.

    Many batches are prepared and simulated side by side, each by one thread, so that none waits for another one's end.
    The bits are those of `simulate_batch`.

    Parameters
    ----------
    injector : Injector
    points : sequence of OperatingPoint
        Without traces.
    names : sequence of str
        Parameters that vary.
    values : (candidates, names), optional
        Their SI values; one candidate, the injector itself, by default.
    time_step : float
        [s].
    threads : int, optional
        All usable processors by default.

    Raises
    ------
    ConfigurationError
        If the injector's model or its fuel does not cover a point.
    """
    step, threads = check_step(time_step), threads or usable_threads()
    places = [slice(first, first + AT_A_TIME) for first in range(0, len(points), AT_A_TIME)]

    def simulated(place: slice, threads: int) -> Batch:
        one = prepare_shared(injector, points[place], step)
        return simulate_batch(injector, one.points, names, values, time_step=step, threads=threads, prepared=one)

    if len(places) < ENOUGH * threads:
        return _joined([simulated(place, threads) for place in places])
    compiled(injector.wired(names), Precision.F64, False)  # in the calling thread, where Ctrl-C ends it
    with ThreadPoolExecutor(threads) as crew:
        return _joined(list(crew.map(lambda place: simulated(place, 1), places)))


def _joined(parts: Sequence[Batch]) -> Batch:
    """One batch of several that follow one another in their points."""
    names = Batch.__dataclass_fields__
    return Batch(**{name: np.concatenate([getattr(part, name) for part in parts], axis=1) for name in names})


def prepare_shared(injector: Injector, points: Sequence[OperatingPoint], dt: float) -> Prepared:
    """`plan.prepare` of points without traces, which works out each set of pressures and each energising once.

    Parameters
    ----------
    injector : Injector
    points : sequence of OperatingPoint
    dt : float
        Time step [s].

    Raises
    ------
    ConfigurationError
        As `plan.prepare`.
    """
    pressures: dict[object, int] = {}
    energisings: dict[object, int] = {}
    by_pressure, by_energising = [], []
    chosen: list[OperatingPoint] = []
    for point in points:
        pressure = point.rail_pressure, point.cylinder_pressure, point.return_pressure
        energising = point.energisings, point.horizon, point.start
        # one that brings something new is worked out; its number is that of both
        if pressure not in pressures or energising not in energisings:
            pressures.setdefault(pressure, len(chosen))
            energisings.setdefault(energising, len(chosen))
            chosen.append(point)
        by_pressure.append(pressures[pressure])
        by_energising.append(energisings[energising])
    few = prepare(injector, chosen, dt)
    return few._replace(
        points=points,
        courses=_spread(few.courses, np.array(by_pressure), np.array(by_energising)),
        begin=few.begin[by_energising],
        densities=few.densities[:, by_pressure],
        highest=few.highest[by_pressure],
    )


def _spread(few: Courses, by_pressure: Ints, by_energising: Ints) -> Courses:
    """Boundary conditions of many points from those of a few.

    Parameters
    ----------
    few : Courses
    by_pressure, by_energising : (points,) int
        Among the few the points of the same pressures, and of the same energisings.
    """
    return few._replace(
        settings=few.settings[by_pressure],
        steps=few.steps[by_energising],
        earliest_end=few.earliest_end[by_energising],
        clock=few.clock[by_energising],
        first=few.first[by_energising],
        trace=few.trace[by_energising],
    )
