"""Records of each lane: opening and closing of the needle, samples of the rate, figures of the result, traces."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from commonrail.engine.job import FIGURE
from commonrail.physics.connections import CLEAR_LIFT, RELAXED, REOPENED
from commonrail.physics.law import physics


@physics
def at(rows: Any, row: int, lane: int) -> int:
    """Index of a row and lane in the work array."""
    return row * rows.lanes + lane


class Sample(NamedTuple):
    """Part of a step at which a sample ends, its width [s], target [m³/s] and weight."""

    fraction: float
    width: float
    target: float
    weight: float


@physics
def crossing(old, new):  # type: ignore[no-untyped-def]
    """1 if a tip has passed the seat or `CLEAR_LIFT` in this step, upwards or downwards; lifts before and after it."""
    return 1.0 if (old <= 0.0) != (new <= 0.0) or (old <= CLEAR_LIFT) != (new <= CLEAR_LIFT) else 0.0


@physics
def record_crossing(work, rows, lane, count):  # type: ignore[no-untyped-def]
    """Keep the opening, the first and the last closing, in steps; zero means absent.

    The needle is open once its tip has first risen by `CLEAR_LIFT`, and closes when it first meets the seat after that.
    A later contact is a further closing if the tip has risen by `CLEAR_LIFT` again, or if more than the share
    `REOPENED` of the injected mass has flowed since lift-off; smaller bounces do not count.
    """
    old, new = work[at(rows, rows.tip_before, lane)], work[at(rows, rows.tip, lane)]
    injected = work[at(rows, rows.injected, lane)]
    if old <= 0.0 < new:
        work[at(rows, rows.injected_at_lift, lane)] = injected
    if old <= CLEAR_LIFT < new:
        if work[at(rows, rows.opening, lane)] == 0.0:
            work[at(rows, rows.opening, lane)] = count - (new - CLEAR_LIFT) / (new - old)
        work[at(rows, rows.is_open, lane)] = 1.0
        work[at(rows, rows.last_closing, lane)] = 0.0  # the last closing is yet to come
    reopened = injected - work[at(rows, rows.injected_at_lift, lane)] > REOPENED * injected
    counts = work[at(rows, rows.is_open, lane)] > 0.0 or reopened
    if new <= 0.0 < old and work[at(rows, rows.opening, lane)] > 0.0 and counts:
        work[at(rows, rows.last_closing, lane)] = count - new / (new - old)
        if work[at(rows, rows.first_closing, lane)] == 0.0:
            work[at(rows, rows.first_closing, lane)] = work[at(rows, rows.last_closing, lane)]
        work[at(rows, rows.is_open, lane)] = 0.0


@physics
def set_densities(work, rows, candidates, points, density):  # type: ignore[no-untyped-def]
    """Keep the density that converts each lane's samples to volumes; one row of `density` serves all candidates."""
    for lane in range(rows.lanes):
        candidate = candidates[lane] if density.shape[0] > 1 else 0
        work[at(rows, rows.density, lane)] = density[candidate, points[lane]]


@physics
def take_sample(work, rows, due, first):  # type: ignore[no-untyped-def]
    """Take the `Sample` that ends in the last step, and add its misfit, by volume like the target."""
    for lane in range(rows.lanes):
        start = work[at(rows, rows.injected_before, lane)]
        here = start + due.fraction * (work[at(rows, rows.injected, lane)] - start)
        # divide: the compiler would fuse a product and a difference in some lanes only
        gain, density = here - work[at(rows, rows.injected_at_sample, lane)], work[at(rows, rows.density, lane)]
        error = gain / (due.width * density) - due.target
        counts = 0.0 if first else due.weight
        work[at(rows, rows.absolute, lane)] += counts * abs(error)
        work[at(rows, rows.squared, lane)] += counts * error * error
        work[at(rows, rows.injected_at_sample, lane)] = here


@physics
def needle_rests(work, rows, lane):  # type: ignore[no-untyped-def]
    """True for a needle on its seat and a SAC that has emptied."""
    excess = work[at(rows, rows.sac_pressure, lane)] - work[at(rows, rows.cylinder, lane)]
    return work[at(rows, rows.tip, lane)] <= 0.0 and excess < RELAXED


@physics
def is_sound(work, rows, lane):  # type: ignore[no-untyped-def]
    """True for a state that is finite and inside its stops."""
    return (
        abs(work[at(rows, rows.tip, lane)]) < work[at(rows, rows.farthest_lift, lane)]
        and abs(work[at(rows, rows.top, lane)]) < work[at(rows, rows.farthest_lift, lane)]
        and abs(work[at(rows, rows.injected, lane)]) < 1.0
        and abs(work[at(rows, rows.sac_pressure, lane)]) < 1e10
    )


@physics
def _instant(work, rows, row, lane):  # type: ignore[no-untyped-def]
    """Recorded instant in steps; NaN if absent."""
    return work[at(rows, row, lane)] if work[at(rows, row, lane)] > 0.0 else np.nan


@physics
def report(work, rows, lane, out):  # type: ignore[no-untyped-def]
    """Write the figures of a lane, (lanes, figures)."""
    out[lane, FIGURE.injected] = work[at(rows, rows.injected, lane)]
    out[lane, FIGURE.returned] = work[at(rows, rows.returned, lane)]
    out[lane, FIGURE.supplied] = work[at(rows, rows.supplied, lane)]
    out[lane, FIGURE.opening] = _instant(work, rows, rows.opening, lane)
    out[lane, FIGURE.closing] = _instant(work, rows, rows.last_closing, lane)
    out[lane, FIGURE.first_closing] = _instant(work, rows, rows.first_closing, lane)
    out[lane, FIGURE.greatest_lift] = work[at(rows, rows.greatest_lift, lane)]
    out[lane, FIGURE.absolute] = work[at(rows, rows.absolute, lane)]
    out[lane, FIGURE.squared] = work[at(rows, rows.squared, lane)]
    out[lane, FIGURE.sound] = 1.0 if is_sound(work, rows, lane) else 0.0
    out[lane, FIGURE.closed_at_end] = 1.0 if needle_rests(work, rows, lane) else 0.0


@physics
def report_remaining(work, rows, cylinder, out):  # type: ignore[no-untyped-def]
    """Write the figures of all lanes that have not ended, at the given cylinder pressure."""
    for lane in range(rows.lanes):
        if work[at(rows, rows.has_ended, lane)] == 0.0:
            work[at(rows, rows.cylinder, lane)] = cylinder
            report(work, rows, lane, out)


@physics
def record(work, rows, trace):  # type: ignore[no-untyped-def]
    """Copy state and outgoing waves into a trace (rows, kept lanes); a trace of one row takes the injected mass."""
    first = rows.injected if trace.shape[0] == 1 else rows.state
    for row in range(trace.shape[0]):
        for lane in range(trace.shape[1]):
            trace[row, lane] = work[at(rows, first + row, lane)]


@physics
def keep_if_asked(work, rows, trace, block, k):  # type: ignore[no-untyped-def]
    """Copy state and outgoing waves of step k into the trace, unless the trace is empty."""
    if trace.shape[0] > 0:
        record(work, rows, trace[block, k])
