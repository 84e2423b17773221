"""The loop over blocks, steps and lanes that `lanes` compiles.

Working rows of a block, each `LANES` wide, behind one pointer: coefficients, state, the three waves that
leave, and notes (samples, opening and closing, figures kept at the end). Travelling waves wait in three ring
buffers of `ring` slots. Parameters are read once, through the rings' memory, before the first wave is written.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from commonrail.compile import physics
from commonrail.fuel.kernel import FuelCoefficients
from commonrail.injector import setup
from commonrail.injector.joints import CLEAR_LIFT, RELAXED
from commonrail.injector.layout import LANES, layout_of
from commonrail.injector.model import Inputs, Parameters, Setting, Waves
from commonrail.injector.variants import Variant, wiring

PARAMETERS = layout_of(Parameters)
FUEL = layout_of(FuelCoefficients)
CHECK_EVERY = 32  # steps between looks at health and closing
RUNAWAY = 2e-3  # a tip or top this far off [m] has left the injector
RECOVERED = 0.9  # share of the accumulation's pressure that the control chamber regains once the valve is shut

# figures of a lane in `out`, in the order of `lanes.Outcome`
INJECTED, RETURNED, SUPPLIED, OPENING, CLOSING, GREATEST_LIFT, ABSOLUTE, SQUARED, SOUND, CLOSED_AT_START, CLOSED = (
    range(11)
)


class Rows(NamedTuple):
    """First working row of each group, and single rows of the state that the loop itself looks at."""

    state: int
    leaving: int
    arriving: int
    before: int
    mark: int
    absolute: int
    squared: int
    greatest: int
    opened: int
    shut: int
    clear: int
    final: int
    done: int
    delays: int
    end: int
    injected: int
    returned: int
    supplied: int
    sac_pressure: int
    control_pressure: int
    store_pressure: int
    return_pressure: int
    valve_lift: int
    tip: int
    top: int
    feed_delay: int
    back_delay: int


def make_rows(variant: Variant) -> Rows:
    """Where everything stands for a variant; coefficients begin at row 0."""
    wired = wiring(variant)
    state = len(wired.coefficients.paths)
    leaving = state + len(wired.state.paths)
    note = leaving + 6
    body = ("body.z.i9", "body.z.i1") if "body.z.i9" in wired.state.paths else ("body.z", "body.z")
    looked_at = (
        "nozzle.injected",
        "books.returned",
        "books.supplied",
        "sac.pressure",
        "control_chamber.fuel.pressure",
        "accumulation.fuel.pressure",
        "return_line.pressure",
        "valve.lift",
        *body,
    )
    single = [note + i for i in (0, 1, 2, 3, 4)]
    opened, shut, clear, final = note + 5, note + 8, note + 11, note + 12  # step, lift before, lift after; four figures
    done, delays, end = final + 4, final + 5, final + 11  # delays: whole steps and rest, for each wave
    state_rows = [state + wired.state.row(name) for name in looked_at]
    delay_rows = [wired.coefficients.row(name) for name in ("delays.feed", "delays.back")]
    groups = [state, leaving, leaving + 3, *single, opened, shut, clear, final, done, delays, end]
    return Rows._make(groups + state_rows + delay_rows)


@physics
def at(row: int, lane: int) -> int:
    """Index of a row's lane."""
    return row * LANES + lane


def make_begin(variant: Variant, rows: Rows) -> Callable[..., Any]:
    """Function that puts the candidates of a block to rest; true if all their delays are alike."""
    wired = wiring(variant)
    load_parameters, load_fuel = PARAMETERS.load, FUEL.load
    store_coefficients, store_state = wired.coefficients.store, wired.state.store
    at_rest, motion = wired.body.at_rest, wired.body.motion
    coefficients, static_loads, seat_contact = setup.coefficients, setup.static_loads, setup.seat_contact
    state_at_rest = setup.state_at_rest
    known, fuel_known = len(PARAMETERS.paths), len(FUEL.paths)

    @physics
    def begin(work, waves, ring, theta, candidates, setting, out):  # type: ignore[no-untyped-def]
        for lane in range(LANES):
            for row in range(known + fuel_known):
                waves[at(row, lane)] = theta[candidates[1 + lane], row]
        for lane in range(LANES):
            c = coefficients(load_parameters(waves, 0, lane), load_fuel(waves, known, lane), setting)
            body = at_rest(c.plunger_needle, seat_contact(c), static_loads(c, setting))
            store_coefficients(work, 0, lane, c)
            store_state(work, rows.state, lane, state_at_rest(c, setting, body, motion(body)))
            for row in range(rows.leaving, rows.end):
                work[at(row, lane)] = 0.0
            rests = work[at(rows.tip, lane)] < 0.0 and work[at(rows.valve_lift, lane)] < 0.0
            out[lane, CLOSED_AT_START] = 1.0 if rests else 0.0
            work[at(rows.leaving, lane)] = work[at(rows.store_pressure, lane)]
            work[at(rows.leaving + 1, lane)] = work[at(rows.store_pressure, lane)]
            work[at(rows.leaving + 2, lane)] = work[at(rows.return_pressure, lane)]
        for wave in range(3):
            for slot in range(ring):
                for lane in range(LANES):
                    waves[at(wave * ring + slot, lane)] = work[at(rows.leaving + wave, lane)]
        alike = True
        for wave in range(3):
            row = rows.feed_delay if wave < 2 else rows.back_delay
            for lane in range(LANES):
                delay = min(max(work[at(row, lane)], 1.0), ring - 2.0)
                work[at(rows.delays + 2 * wave, lane)] = float(int(delay))
                work[at(rows.delays + 2 * wave + 1, lane)] = delay - int(delay)
                alike = alike and work[at(row, lane)] == work[at(row, 0)]
        return alike

    return begin  # type: ignore[no-any-return]


def make_advance(variant: Variant, rows: Rows) -> Callable[..., Any]:
    """Function that takes all lanes of a block one step on; the loop in it is what the compiler vectorises."""
    wired = wiring(variant)
    load_coefficients, load_state, store_state = wired.coefficients.load, wired.state.load, wired.state.store
    step, motion = wired.step, wired.body.motion

    @physics
    def advance(work, k, u, dt):  # type: ignore[no-untyped-def]
        for lane in range(LANES):
            c = load_coefficients(work, 0, lane)
            s = load_state(work, rows.state, lane)
            arriving = Waves(
                work[at(rows.arriving, lane)], work[at(rows.arriving + 1, lane)], work[at(rows.arriving + 2, lane)]
            )
            after, away = step(c, s, u, arriving, dt)
            old, new = motion(s.body).tip, motion(after.body).tip
            note_crossing(work, rows, lane, k, old, new)
            work[at(rows.greatest, lane)] = max(work[at(rows.greatest, lane)], new)
            work[at(rows.before, lane)] = s.nozzle.injected
            store_state(work, rows.state, lane, after)
            work[at(rows.leaving, lane)] = away.down
            work[at(rows.leaving + 1, lane)] = away.up
            work[at(rows.leaving + 2, lane)] = away.back

    return advance  # type: ignore[no-any-return]


@physics
def note_crossing(work, rows, lane, k, old, new):  # type: ignore[no-untyped-def]
    """Keep step and lifts of the opening and of the last closing; the instants are worked out at the end.

    The needle is open once its tip has first risen by `CLEAR_LIFT`, and closes when it first meets the seat after
    that: the ringing of a closed needle and bounces are neither.
    """
    opens = old <= CLEAR_LIFT < new and work[at(rows.greatest, lane)] <= CLEAR_LIFT
    closes = new <= 0.0 < old and work[at(rows.clear, lane)] > 0.0
    work[at(rows.opened, lane)] = k + 1.0 if opens else work[at(rows.opened, lane)]
    work[at(rows.opened + 1, lane)] = old - CLEAR_LIFT if opens else work[at(rows.opened + 1, lane)]
    work[at(rows.opened + 2, lane)] = new - CLEAR_LIFT if opens else work[at(rows.opened + 2, lane)]
    work[at(rows.shut, lane)] = k + 1.0 if closes else work[at(rows.shut, lane)]
    work[at(rows.shut + 1, lane)] = old if closes else work[at(rows.shut + 1, lane)]
    work[at(rows.shut + 2, lane)] = new if closes else work[at(rows.shut + 2, lane)]
    work[at(rows.clear, lane)] = 1.0 if new > CLEAR_LIFT else (0.0 if closes else work[at(rows.clear, lane)])


@physics
def arrive(work, waves, ring, rows, k, alike):  # type: ignore[no-untyped-def]
    """Waves that arrive in step k: slots k − delay and k − delay − 1, interpolated.

    Lanes that differ in no delay read neighbouring memory; others gather.
    """
    mask = ring - 1
    for wave in range(3):
        row = rows.delays + 2 * wave
        if alike:
            whole, part = int(work[at(row, 0)]), work[at(row + 1, 0)]
            late = at(wave * ring + ((k - whole) & mask), 0)
            later = at(wave * ring + ((k - whole - 1) & mask), 0)
            for lane in range(LANES):
                mix = (1.0 - part) * waves[late + lane] + part * waves[later + lane]
                work[at(rows.arriving + wave, lane)] = mix
        else:
            for lane in range(LANES):
                whole, part = int(work[at(row, lane)]), work[at(row + 1, lane)]
                late = at(wave * ring + ((k - whole) & mask), lane)
                later = at(wave * ring + ((k - whole - 1) & mask), lane)
                work[at(rows.arriving + wave, lane)] = (1.0 - part) * waves[late] + part * waves[later]


@physics
def sample(work, rows, part, width, target, weight, first):  # type: ignore[no-untyped-def]
    """Take the sample that ends `part` of a step into the last one, and add up its misfit."""
    for lane in range(LANES):
        start = work[at(rows.before, lane)]
        here = start + part * (work[at(rows.injected, lane)] - start)
        error = (here - work[at(rows.mark, lane)]) / width - target
        counts = 0.0 if first else weight
        work[at(rows.absolute, lane)] += counts * abs(error)
        work[at(rows.squared, lane)] += counts * error * error
        work[at(rows.mark, lane)] = here


@physics
def look(work, rows, cylinder, quiet, stop_when_closed, out):  # type: ignore[no-untyped-def]
    """Keep the figures of lanes that are still running; true once every lane is done.

    A lane is done when it has failed or, if asked for, when its needle rests, its SAC is empty and its control
    chamber is shut: what its neighbours go on doing then no longer touches its figures.
    """
    done = 0
    for lane in range(LANES):
        lift, top, mass = work[at(rows.tip, lane)], work[at(rows.top, lane)], work[at(rows.injected, lane)]
        sac = work[at(rows.sac_pressure, lane)]
        sane = abs(lift) < RUNAWAY and abs(top) < RUNAWAY and abs(mass) < 1.0 and abs(sac) < 1e10
        rests = lift <= 0.0 and sac - cylinder < RELAXED
        shut = work[at(rows.control_pressure, lane)] > RECOVERED * work[at(rows.store_pressure, lane)]
        closed = quiet and rests and shut
        if work[at(rows.done, lane)] == 0.0:
            work[at(rows.final, lane)] = mass
            work[at(rows.final + 1, lane)] = work[at(rows.returned, lane)]
            work[at(rows.final + 2, lane)] = work[at(rows.supplied, lane)]
            work[at(rows.final + 3, lane)] = 1.0 if sane else 0.0
            out[lane, CLOSED] = 1.0 if closed else 0.0
            if (stop_when_closed and closed) or not sane:
                work[at(rows.done, lane)] = 1.0
        if work[at(rows.done, lane)] != 0.0:
            done += 1
    return done == LANES


@physics
def crossing(work, row, lane):  # type: ignore[no-untyped-def]
    """Instant of a noted crossing in steps, by linear interpolation; NaN where there was none."""
    index, old, new = work[at(row, lane)], work[at(row + 1, lane)], work[at(row + 2, lane)]
    return index - new / (new - old) if index > 0.0 else np.nan


@physics
def report(work, rows, out):  # type: ignore[no-untyped-def]
    """Write the figures of a block, (LANES, figures)."""
    for lane in range(LANES):
        for i in range(3):
            out[lane, INJECTED + i] = work[at(rows.final + i, lane)]
        out[lane, SOUND] = work[at(rows.final + 3, lane)]
        out[lane, OPENING] = crossing(work, rows.opened, lane)
        out[lane, CLOSING] = crossing(work, rows.shut, lane)
        out[lane, GREATEST_LIFT] = work[at(rows.greatest, lane)]
        out[lane, ABSOLUTE] = work[at(rows.absolute, lane)]
        out[lane, SQUARED] = work[at(rows.squared, lane)]


@physics
def record(work, rows, trace):  # type: ignore[no-untyped-def]
    """Copy state and leaving waves into a trace, (rows, LANES)."""
    for row in range(trace.shape[0]):
        for lane in range(LANES):
            trace[row, lane] = work[at(rows.state + row, lane)]


def make_loop(variant: Variant) -> Callable[..., Any]:
    """The loop over blocks [first, last) of a job; arguments are those of `lanes.Job`, `lanes.Misfit`, then outputs."""
    rows = make_rows(variant)
    begin, advance = make_begin(variant, rows), make_advance(variant, rows)
    parameters = len(PARAMETERS.paths) + len(FUEL.paths)

    def loop(  # type: ignore[no-untyped-def]
        theta, settings, inputs, steps, quiet, blocks, dt, ring, stop_when_closed,
        bound_count, bounds, target, weight, trace, out, first, last,
    ):  # fmt: skip
        mask = ring - 1
        work = np.empty(rows.end * LANES)
        waves = np.empty(max(3 * ring, parameters) * LANES)
        for block in range(first, last):
            point = blocks[block, 0]
            setting = Setting(settings[point, 0], settings[point, 1], settings[point, 2], dt)
            alike = begin(work, waves, ring, theta, blocks[block], setting, out[block])
            if trace.shape[0] > 0:
                record(work, rows, trace[block, 0])
            bound = 0
            for k in range(steps[point]):
                x = inputs[point, k]
                u = Inputs(x[0], x[1], x[2], x[3], x[4], x[5])
                arrive(work, waves, ring, rows, k, alike)
                advance(work, k, u, dt)
                for wave in range(3):
                    for lane in range(LANES):
                        waves[at(wave * ring + (k & mask), lane)] = work[at(rows.leaving + wave, lane)]
                while bound < bound_count[point] and bounds[point, bound] <= k + 1.0:
                    width = dt * (bounds[point, bound] - bounds[point, max(bound - 1, 0)]) if bound > 0 else 1.0
                    sample(
                        work,
                        rows,
                        bounds[point, bound] - k,
                        width,
                        target[point, bound],
                        weight[point, bound],
                        bound == 0,
                    )
                    bound += 1
                if trace.shape[0] > 0:
                    record(work, rows, trace[block, k + 1])
                if k % CHECK_EVERY == CHECK_EVERY - 1 or k == steps[point] - 1:  # noqa: SIM102
                    if look(work, rows, u.cylinder, k >= quiet[point], stop_when_closed, out[block]):
                        break
            report(work, rows, out[block])

    return loop
