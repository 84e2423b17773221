"""Boundary conditions of operating points as the loop over blocks reads them: `Courses`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.base.arrays import Floats, Ints
from commonrail.base.errors import ConfigurationError
from commonrail.engine.job import NEVER, Courses
from commonrail.engine.operating_point import OperatingPoint, Trace, courses
from commonrail.physics.injector import Injector

CHECK_AFTER = 100e-6  # earliest time after energising at which an injection may have ended [s]
MAXIMUM_STEPS = 2_000_000
ALMOST_ALL = 1.0 - 1e-9  # an energising that begins after this share of a step counts from the next step
_IDLE = -1.0  # constant clock of a point without energisings [s]


def courses_of(injector: Injector, points: Sequence[OperatingPoint], dt: float) -> Courses:
    """Boundary conditions of points.

    Arguments as in `plan.prepare`. `ConfigurationError` if a point has too many steps, or lacks a trace for its
    drive.
    """
    steps = np.array([_steps(point, dt) for point in points])
    pulses = [point.pulses for point in points]
    own_start = [point.start if its else None for point, its in zip(points, pulses, strict=True)]
    starts = list(dict.fromkeys(own_start))
    after = dt * np.arange(int(steps.max()))
    times = np.array([after * 0.0 + _IDLE if start is None else start + after for start in starts])
    row_of = {start: row for row, start in enumerate(starts)}
    clock = np.array([row_of[start] for start in own_start])
    count = np.array([max(len(its), 1) for its in pulses])
    flat = np.array([pulse for its in pulses for pulse in its or [(0.0, 0.0)]])
    first, turns, origins = _turns(np.stack([flat[:, 0], flat[:, 0] + flat[:, 1]]), count, (clock, steps), times, dt)
    traced = [i for i, point in enumerate(points) if _is_traced(injector, point)]
    trace, traces = np.full(len(points), -1), np.zeros((len(traced), len(after) if traced else 0, 4))
    for row, i in enumerate(traced):
        trace[i], traces[row] = row, _means(points[i], dt, int(steps[i]), len(after))
    return Courses(
        settings=np.array([point.initial_pressures() for point in points]),
        steps=steps,
        earliest_end=np.array([_earliest_end(point, dt) for point in points]),
        times=times,
        clock=clock,
        first=first,
        turns=turns,
        origins=origins,
        trace=trace,
        traces=traces,
    )


def _steps(point: OperatingPoint, dt: float) -> int:
    steps = max(round(point.duration / dt), 1)
    if steps > MAXIMUM_STEPS:
        raise ConfigurationError(
            f"{point.duration:g} s in steps of {dt:g} s are {steps} steps; at most {MAXIMUM_STEPS} are allowed."
        )
    return steps


def _earliest_end(point: OperatingPoint, dt: float) -> int:
    last = max((p.start + p.duration for p in point.pulses), default=point.start)
    if point.drive is not None:
        last = max(last, point.drive.time[-1])
    return round((last - point.start + CHECK_AFTER) / dt)


def _turns(pulses: Floats, count: Ints, at: tuple[Ints, Ints], times: Floats, dt: float) -> tuple[Ints, Ints, Floats]:
    """Index of each point's first turn, and steps and origins of all turns, as in `Courses`.

    `pulses` (2, energisings): starts and ends [s], in order for each point; a point without energisings has a dummy;
    `count` (points,) int: energisings of each point; `at` ((points,), (points,)) of int: row in `times`
    and number of steps; `times` (clocks, steps): clock times [s].
    """
    if pulses.shape[1] == len(count):  # usual case: one energising per point, its turn in step 0
        now = times[at[0], 0]
        origins = np.zeros((2 * len(count), 4))
        origins[::2] = np.stack([*pulses, now - pulses[0], now - pulses[1]], axis=1)
        return 2 * np.arange(len(count)), np.tile([0, NEVER], len(count)), origins
    point, place = np.repeat(np.arange(len(count)), count), np.arange(pulses.shape[1])
    ordinal, row = place - (np.cumsum(count) - count)[point], at[0][point]
    step = np.zeros(len(place), np.int64)
    for i, clock_times in enumerate(times):
        step[row == i] = np.searchsorted(clock_times + dt * ALMOST_ALL, pulses[0, row == i], side="right")
    step[ordinal == 0] = 0
    following = np.append(np.where(point[1:] == point[:-1], step[1:], NEVER), NEVER)
    last_in_step = (step < following) & (step < at[1][point])  # the last of several that begin in one step
    now = times[row, np.minimum(step, times.shape[1] - 1)]
    since = np.stack([now - pulses[0] + _still_on(pulses, ordinal, now, dt), now - pulses[1]])
    each = np.bincount(point[last_in_step], minlength=len(count)) + 1  # plus the sentinel
    first = np.cumsum(each) - each
    where = (
        first[point[last_in_step]]
        + np.arange(int(last_in_step.sum()))
        - (np.cumsum(each - 1) - (each - 1))[point[last_in_step]]
    )
    turns, origins = np.full(int(each.sum()), NEVER), np.zeros((int(each.sum()), 4))
    turns[where], origins[where] = step[last_in_step], np.concatenate([pulses, since]).T[last_in_step]
    return first, turns, origins


def _still_on(pulses: Floats, ordinal: Ints, now: Floats, dt: float) -> Floats:
    """Time [s] for which earlier energisings are still on in the step in which each energising begins.

    A step with the end of one energising and the start of the next is energised for the sum of both times: the start of
    the second is shifted back by the rest of the first.

    `pulses` (2, energisings): starts and ends [s]; `ordinal` (energisings,) int: number of earlier ones of the same
    point; `now` (energisings,): start of that step [s].
    """
    lasting = np.zeros(len(now))
    for back in range(int(ordinal.max()), 0, -1):
        start, end = (np.concatenate([np.zeros(back), edge[:-back]]) for edge in pulses)
        on = np.minimum(end, now + dt) - np.maximum(start, now)
        lasting += np.where(ordinal >= back, np.maximum(on, 0.0), 0.0)
    return lasting


def _is_traced(injector: Injector, point: OperatingPoint) -> bool:
    """True if a pressure changes with time, or a trace drives the injector."""
    driven = injector.variant.drive.is_trace
    if driven and point.drive is None:
        raise ConfigurationError(
            f"{injector.name} is driven by a {injector.variant.drive.value}, but the operating point gives none; "
            "add its file, or set the injector's drive to regulated or pwm."
        )
    return driven or any(isinstance(pressure, Trace) for pressure in courses(point)[:3])


def _means(point: OperatingPoint, dt: float, steps: int, length: int) -> Floats:
    """Means of a traced point over its steps, (length, 4); rows after its end repeat the course.

    `steps`, `length`: steps of the point, and rows.
    """
    begin: Floats = np.asarray(point.start + dt * np.arange(steps), float)
    means = np.empty((length, 4))
    for i, course in enumerate(courses(point)):
        means[:steps, i] = course.mean(begin, np.asarray(begin + dt)) if isinstance(course, Trace) else course
    means[steps:] = means[steps - 1]
    return means
