"""Compiled loops of the reference engine: the right-hand side, and the explicit march.

The march is the classical Runge–Kutta method of order 4 at small steps, several times faster than LSODA and free of
Python, for simulating many truths at once. Steps end at every sample, edge of the schedule and knot of
a trace; the PWM switches inside a step, when its current meets the limit. In between steps have one length unless
the SAC, the stiffest of the volumes, settles sooner. A diverging state is reported, not raised.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.base.arrays import Floats, Ints
from commonrail.base.choices import Drive
from commonrail.compiler.table import REAL, floats, wholes
from commonrail.physics.components.drive import toggle_conduction
from commonrail.physics.connections import CLEAR_LIFT, REOPENED
from commonrail.physics.equations import AT, make_air_gap, make_rates, make_sac_rate, past_limit
from commonrail.physics.law import physics
from commonrail.physics.state_vector import core_of, make_frame
from commonrail.physics.variants import Variant, wiring

RATES = (floats(1), floats(1), floats(1), wholes(1), floats(2), floats(1))  # y, outside, constants, cells, friction, dy


def rates_entries(*words: str) -> dict[str, Any]:
    """Right-hand side of the equations for a `Variant` given by `words`; for `cache.Source`."""
    from commonrail.compiler.laws import TABLE, of_table

    rates = physics(make_rates(Variant(*words)))

    def slopes(y, outside, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        rates(y, outside, constants, cells, friction, dy)
        return 0

    return {"rates": (of_table(slopes, RATES), TABLE)}


# Runge-Kutta stages: times within the step (the last entry is a filler), and weights of the slopes
AHEAD = (0.0, 0.5, 0.5, 1.0, 0.0)
SHARE = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
MET = 1e-9  # distance of the current from its limit that counts as zero, relative to the band
SETTLED = 1.0  # share of the SAC's settling time that a step may take; Runge-Kutta's limit of stability is 2.8
SHORTEST = 0.02  # smallest share of the step to which the SAC's settling time shortens it
TRIES = 40  # most iterations to locate a switching instant; three suffice


class Fixed(NamedTuple):
    """Arguments of the rates in addition to the state, in order."""

    constants: Floats  # `Coefficients` as one lane of a layout
    cells: Ints  # (2,) int array: of the feed pipe and of the return line
    friction: Floats  # (9, 2) array: [N], [N s/m]


class Plan(NamedTuple):
    """Stops of the time integration.

    `stops` (n,) [s]; `courses` (n, 4) at the stops; `schedule` (n − 1, 2) of the intervals; `rows` (n,): row of the
    result that each stop fills, or −1.
    """

    stops: Floats
    courses: Floats
    schedule: Floats
    rows: Ints


MARCH = (
    Plan(floats(1), floats(2), floats(2), wholes(1)),
    Fixed(floats(1), wholes(1), floats(2)),
    REAL,
    floats(1),
    floats(2),
    floats(1),
    (floats(1), floats(2)),
)


def march_entries(*words: str) -> dict[str, Any]:
    """Time integration for a `Variant` given by `words`; for `cache.Source`."""
    from commonrail.compiler.laws import TABLE, of_table

    return {"march": (of_table(physics(make_march(Variant(*words))), MARCH), TABLE)}


@physics
def set_all(target: Any, source: Any) -> None:
    """Copy an array element by element: slice assignment makes a temporary in case the arrays overlap."""
    for i in range(len(source)):
        target[i] = source[i]


@physics
def set_courses(outside: Any, plan: Any, k: int, t: float) -> None:
    """Boundary courses at time t between stops k and k + 1, linear.

    `outside`: fields of `equations.Outside`, to be set; `t`: [s].
    """
    stops, courses = plan.stops, plan.courses
    share = (t - stops[k]) / (stops[k + 1] - stops[k])
    for i in range(3):
        outside[i] = courses[k, i] + share * (courses[k + 1, i] - courses[k, i])
    outside[AT.trace] = courses[k, 3] + share * (courses[k + 1, 3] - courses[k, 3])


@physics
def record_instants(recorded: Any, now: float, h: float, old: float, new: float, injected: float) -> None:
    """Update the opening and closing instants after a step.

    `recorded` (5,) array: fields of `Instants`, 1 while the needle is clear of its seat, mass injected at lift-off
    [kg]; `now`, `h`: start and length of the step [s]; `old`, `new`: tip before and after it [m]; `injected`: mass
    injected by then [kg].
    """
    if old <= 0.0:
        recorded[4] = injected
    if old <= CLEAR_LIFT < new:
        if math.isnan(recorded[0]):
            recorded[0] = now + h * (CLEAR_LIFT - old) / (new - old)
        recorded[1], recorded[3] = math.nan, 1.0
    flowed = injected - recorded[4]
    if new <= 0.0 < old and not math.isnan(recorded[0]) and (recorded[3] > 0.5 or flowed > REOPENED * injected):
        recorded[1], recorded[3] = now + h * old / (old - new), 0.0
        if math.isnan(recorded[2]):
            recorded[2] = recorded[1]


@physics
def stride(left: float, step: float) -> float:
    """Next step [s] if the time left is divided into the fewest equal steps not longer than `step`."""
    return left / max(math.ceil(left / step - 1e-6), 1)


def make_march(variant: Variant) -> Callable[..., int]:
    """Make the function (plan, fixed, step, start, states, recorded, memory) that is 1 if all stayed finite, else 0.

    `memory`: work arrays (fields of `equations.Outside`,) and (4, entries of the state).
    """
    load, frame, air_gap = wiring(variant).coefficients.load, make_frame(variant), make_air_gap(variant)
    flux_row, injected_row = core_of(variant).row("solenoid.flux"), core_of(variant).row("nozzle.injected")
    rates, sac_rate = physics(make_rates(variant)), make_sac_rate(variant)
    switching, farthest_lift = variant.drive is Drive.PWM, wiring(variant).farthest

    @physics
    def runge_kutta(work: Any, now: float, h: float, outside: Any, course: Any, fixed: Any) -> None:
        """Advance the state in the first row of `work` by a step of length h from `now`, into the second row."""
        plan, k = course
        y, new, trial, slope = work[0], work[1], work[2], work[3]
        for i in range(len(y)):
            new[i] = trial[i] = y[i]
        for stage in range(4):
            set_courses(outside, plan, k, now + AHEAD[stage] * h)
            rates(trial, outside, fixed.constants, fixed.cells, fixed.friction, slope)
            for i in range(len(y)):
                new[i] += SHARE[stage] * h * slope[i]
                trial[i] = y[i] + AHEAD[stage + 1] * h * slope[i]

    @physics
    def past(c: Any, cells: Any, y: Any, outside: Any) -> float:
        if not switching or outside[AT.on] < 0.5:
            return -1.0
        flux, gap = y[frame(cells).core + flux_row], air_gap(c, y, cells)
        return past_limit(c, outside[AT.peak], outside[AT.conducting], flux, gap)

    def loop(plan, fixed, step, start, states, recorded, memory):  # type: ignore[no-untyped-def]
        stops, rows, cells = plan.stops, plan.rows, fixed.cells
        c, at = load(fixed.constants, 0, 1), frame(cells)
        tip, injected = at.line - 2, at.core + injected_row
        farthest = farthest_lift(c)
        outside, work = memory
        y, new = work[0], work[1]
        set_all(y, start)
        outside[AT.conducting] = 2.0
        set_all(states[rows[0]], y)
        for k in range(len(stops) - 1):
            outside[AT.on], outside[AT.peak] = plan.schedule[k, 0], plan.schedule[k, 1]
            outside[AT.conducting] = outside[AT.conducting] if outside[AT.on] > 0.5 else 2.0
            if past(c, cells, y, outside) > MET:
                outside[AT.conducting] = toggle_conduction(outside[AT.conducting])
            now, stop, tries = stops[k], stops[k + 1], 0
            short, gap, long, over = 0.0, past(c, cells, y, outside), 0.0, 0.0
            while now < stop:
                settling = SETTLED / sac_rate(c, y, cells, outside[AT.cylinder])
                fits = max(min(step, settling), SHORTEST * step)
                h = short - gap * (long - short) / (over - gap) if long > 0.0 else stride(stop - now, fits)
                runge_kutta(work, now, h, outside, (plan, k), fixed)
                ahead = past(c, cells, new, outside)
                tries += 1
                if abs(ahead) > MET and (ahead > 0.0 or long > 0.0) and tries < TRIES:
                    # the PWM switches in this step: shorten it to the instant
                    short, gap = (short, gap) if ahead > 0.0 else (h, ahead)
                    long, over = (h, ahead) if ahead > 0.0 else (long, over)
                    continue
                record_instants(recorded, now, h, y[tip], new[tip], new[injected])
                now = stop if h >= stop - now else now + h
                set_all(y, new)
                if long > 0.0:
                    outside[AT.conducting] = toggle_conduction(outside[AT.conducting])
                short, gap, long, tries = 0.0, past(c, cells, y, outside), 0.0, 0
            if rows[k + 1] >= 0:
                set_all(states[rows[k + 1]], y)
                # not isfinite(), which "reassoc" folds to true; any comparison with NaN is false
                if not (abs(y[tip]) < farthest and abs(y[injected]) < 1.0):
                    return 0
        return 1

    return loop
