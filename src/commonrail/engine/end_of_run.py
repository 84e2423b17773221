"""Decide when a lane ends: after its injection has ended and all motion has stopped, on failure, or at its horizon."""

from __future__ import annotations

from typing import NamedTuple

from commonrail.engine.recorder import at, is_sound, needle_rests, report
from commonrail.physics.law import physics

RECOVERED = 0.9  # share of the accumulation pressure that the control chamber must regain after the valve has closed
DRIBBLE = 1e-12, 1e-6  # largest injected mass per check that counts as rest: [kg], and share of the injected mass


class StopRule(NamedTuple):
    """Rule for the end of a lane: present step, required checks at rest (0: never), steps between two checks."""

    step: float
    checks: float
    every: float


@physics
def set_horizons(work, rows, points, steps, earliest_end):  # type: ignore[no-untyped-def]
    """Keep the number of each lane's steps, and the first step at which its injection may have ended.

    Returns the largest number of steps.
    """
    most = 0
    for lane in range(rows.lanes):
        work[at(rows, rows.steps, lane)] = steps[points[lane]]
        work[at(rows, rows.earliest_end, lane)] = earliest_end[points[lane]]
        most = max(most, steps[points[lane]])
    return most


@physics
def next_horizon(work, rows, count):  # type: ignore[no-untyped-def]
    """Number of steps, above `count`, after which the next lane reaches its horizon; the last lane's if all have."""
    following = work[at(rows, rows.steps, 0)]
    for lane in range(rows.lanes):
        steps = work[at(rows, rows.steps, lane)]
        if steps > count and (steps < following or following <= count):
            following = steps
    return following


@physics
def check(work, rows, rule, out):  # type: ignore[no-untyped-def]
    """Report lanes that have ended; true once every lane has.

    A lane ends when it has failed or, by a `StopRule`, when needle and valve have rested for the required checks and
    for longer than the contact of a bounce lasts. Later motion in neighbouring lanes does not change its figures.
    """
    ended = 0
    for lane in range(rows.lanes):
        if work[at(rows, rows.has_ended, lane)] == 0.0:
            mass = work[at(rows, rows.injected, lane)]
            gain = mass - work[at(rows, rows.injected_at_check, lane)]
            work[at(rows, rows.injected_at_check, lane)] = mass
            rests = rule.step >= work[at(rows, rows.earliest_end, lane)] and is_at_rest(work, rows, lane)
            still = rests and gain <= DRIBBLE[0] + DRIBBLE[1] * mass
            checks = work[at(rows, rows.checks_at_rest, lane)] + 1.0 if still else 0.0
            work[at(rows, rows.checks_at_rest, lane)] = checks
            enough = checks > rule.checks and checks * rule.every > work[at(rows, rows.longest_contact, lane)]
            if (rule.checks > 0.0 and enough) or not is_sound(work, rows, lane):
                report(work, rows, lane, out)
                work[at(rows, rows.has_ended, lane)] = 1.0
        if work[at(rows, rows.has_ended, lane)] != 0.0:
            ended += 1
    return ended == rows.lanes


@physics
def is_at_rest(work, rows, lane):  # type: ignore[no-untyped-def]
    """True for a needle on its seat with an empty SAC, a closed valve and a control chamber that has refilled.

    A needle that has closed while the valve still moves, or before the chamber has refilled, may open again.
    """
    recovered = RECOVERED * work[at(rows, rows.accumulation_pressure, lane)]
    refilled = work[at(rows, rows.control_pressure, lane)] > recovered
    return needle_rests(work, rows, lane) and work[at(rows, rows.valve_lift, lane)] <= 0.0 and refilled


@physics
def report_ended(work, rows, count, out):  # type: ignore[no-untyped-def]
    """Report lanes that have run to their horizon, after `count` steps, and had not ended before."""
    for lane in range(rows.lanes):
        if work[at(rows, rows.steps, lane)] <= count and work[at(rows, rows.has_ended, lane)] == 0.0:
            report(work, rows, lane, out)
            work[at(rows, rows.has_ended, lane)] = 1.0
