"""The loop over blocks, steps and lanes that `lanes` compiles.

Working rows of a block, each as wide as its lanes, behind one pointer: coefficients, state, the three waves that
leave and that arrive, and notes (samples, opening and closing, rest). Travelling waves wait in
three ring buffers of `ring` slots. Parameters are read once, through the rings' memory, before the first wave is
written. How many lanes there are, and in which precision, is a choice of the machine: see `Vector`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from commonrail.compile import (
    CACHE_LINE,
    FLUSH_TINY,
    KEEP_ALL,
    KEEP_NONE,
    exchange_rounding,
    physics,
    row_copier,
    widest_vectors,
)
from commonrail.fuel.kernel import FuelCoefficients
from commonrail.injector import setup
from commonrail.injector.joints import CLEAR_LIFT, RELAXED, REOPENED
from commonrail.injector.layout import layout_of
from commonrail.injector.model import Inputs, Parameters, Setting, Waves
from commonrail.injector.variants import Variant, wiring

PARAMETERS = layout_of(Parameters)
FUEL = layout_of(FuelCoefficients)
RUNAWAY = 2e-3  # a tip or top this far off [m] has left the injector
RECOVERED = 0.9  # share of the accumulation's pressure that the control chamber regains once the valve is shut
DRIBBLE = 1e-12, 1e-6  # what a resting injector injects between two looks, at most: [kg], and share of the stroke

# figures of a lane in `out`, in the order of `lanes.Outcome`
INJECTED, RETURNED, SUPPLIED, OPENING, CLOSING, GREATEST_LIFT, ABSOLUTE, SQUARED, SOUND, CLOSED_AT_START, CLOSED = (
    range(11)
)
FIRST_CLOSING = 11


class Vector(NamedTuple):
    """How many candidates stand side by side, and the numbers that they are computed in."""

    lanes: int
    real: Any


class Rows(NamedTuple):
    """Lanes; first working row of each group; single rows of the state that the loop itself looks at."""

    lanes: int
    state: int
    leaving: int
    arriving: int
    before: int
    mark: int
    absolute: int
    squared: int
    density: int
    greatest: int
    opened: int
    shut: int
    first_shut: int
    clear: int
    lifted: int
    tip_before: int
    rested: int
    seen: int
    done: int
    touch: int
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


def make_rows(variant: Variant, lanes: int) -> Rows:
    """Where everything stands for a variant; coefficients begin at row 0."""
    wired = wiring(variant)
    state = len(wired.coefficients.paths)
    leaving = state + len(wired.state.paths)
    note = leaving + 9
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
    single = [note + i for i in range(6)]
    crossings = [note + i for i in range(6, 12)]
    rested, seen, done, touch = note + 12, note + 13, note + 14, note + 15
    delays, end = note + 16, note + 22  # whole steps and rest, for each wave
    state_rows = [state + wired.state.row(name) for name in looked_at]
    delay_rows = [wired.coefficients.row(name) for name in ("delays.feed", "delays.back")]
    groups = [lanes, state, leaving, leaving + 3, *single, *crossings, rested, seen, done, touch, delays, end]
    return Rows._make(groups + state_rows + delay_rows)


@physics
def at(rows: Rows, row: int, lane: int) -> int:
    """Index of a row's lane."""
    return row * rows.lanes + lane


def make_memory(vector: Vector) -> Callable[..., Any]:
    """Function that allocates numbers from the start of a cache line: a vector as long as one would straddle two."""
    real, spare = vector.real, CACHE_LINE // np.dtype(vector.real).itemsize

    @physics
    def memory(count):  # type: ignore[no-untyped-def]
        whole = np.empty(count + spare, real)
        first = (-(whole.ctypes.data // whole.itemsize)) % spare
        return whole[first : first + count]

    return memory


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
        for lane in range(rows.lanes):
            for row in range(known + fuel_known):
                waves[at(rows, row, lane)] = theta[candidates[1 + lane], row]
        for lane in range(rows.lanes):
            c = coefficients(
                load_parameters(waves, 0, rows.lanes, lane), load_fuel(waves, known, rows.lanes, lane), setting
            )
            body = at_rest(c.plunger_needle, seat_contact(c), static_loads(c, setting))
            store_coefficients(work, 0, rows.lanes, lane, c)
            store_state(work, rows.state, rows.lanes, lane, state_at_rest(c, setting, body, motion(body)))
            for row in range(rows.leaving, rows.end):
                work[at(rows, row, lane)] = 0.0
            work[at(rows, rows.touch, lane)] = longest_touch(c) / setting.dt
            rests = work[at(rows, rows.tip, lane)] < 0.0 and work[at(rows, rows.valve_lift, lane)] < 0.0
            out[lane, CLOSED_AT_START] = 1.0 if rests else 0.0
            work[at(rows, rows.leaving, lane)] = work[at(rows, rows.store_pressure, lane)]
            work[at(rows, rows.leaving + 1, lane)] = work[at(rows, rows.store_pressure, lane)]
            work[at(rows, rows.leaving + 2, lane)] = work[at(rows, rows.return_pressure, lane)]
        for wave in range(3):
            for slot in range(ring):
                for lane in range(rows.lanes):
                    waves[at(rows, wave * ring + slot, lane)] = work[at(rows, rows.leaving + wave, lane)]
        alike = True
        for wave in range(3):
            row = rows.feed_delay if wave < 2 else rows.back_delay
            for lane in range(rows.lanes):
                delay = min(max(work[at(rows, row, lane)], 1.0), ring - 2.0)
                work[at(rows, rows.delays + 2 * wave, lane)] = float(int(delay))
                work[at(rows, rows.delays + 2 * wave + 1, lane)] = delay - int(delay)
                alike = alike and work[at(rows, row, lane)] == work[at(rows, row, 0)]
        return alike

    return begin  # type: ignore[no-any-return]


@physics
def longest_touch(c):  # type: ignore[no-untyped-def]
    """Longest time [s] for which needle or valve may touch its seat and yet leave it again: a period on its contact."""
    needle = c.plunger_needle.total_mass / c.needle_seat.contact_stiffness
    shutter = 1.0 / (c.valve.per_mass * c.valve.contact_stiffness)
    return 2.0 * math.pi * math.sqrt(max(needle, shutter))


@physics
def any_vectors():  # type: ignore[no-untyped-def]
    """In place of `compile.widest_vectors` where there are none."""


def make_advance(variant: Variant, rows: Rows, vectors: Callable[[], Any] = any_vectors) -> Callable[..., Any]:
    """Function that takes all lanes of a block one step on; the loop in it is what the compiler vectorises."""
    wired = wiring(variant)
    load_coefficients, load_state, store_state = wired.coefficients.load, wired.state.load, wired.state.store
    step, motion = wired.step, wired.body.motion

    @physics
    def advance(work, count, u, dt):  # type: ignore[no-untyped-def]
        vectors()
        for lane in range(rows.lanes):
            c = load_coefficients(work, 0, rows.lanes, lane)
            s = load_state(work, rows.state, rows.lanes, lane)
            arriving = Waves(arrived(work, rows, 0, lane), arrived(work, rows, 1, lane), arrived(work, rows, 2, lane))
            after, away = step(c, s, u, arriving, dt)
            old, new = motion(s.body).tip, motion(after.body).tip
            work[at(rows, rows.tip_before, lane)] = old
            work[at(rows, rows.greatest, lane)] = max(work[at(rows, rows.greatest, lane)], new)
            work[at(rows, rows.before, lane)] = s.nozzle.injected
            store_state(work, rows.state, rows.lanes, lane, after)
            work[at(rows, rows.leaving, lane)] = away.down
            work[at(rows, rows.leaving + 1, lane)] = away.up
            work[at(rows, rows.leaving + 2, lane)] = away.back
        if crossed(work, rows) > 0:  # rarely: the loop above stays free of it
            for lane in range(rows.lanes):
                note_crossing(work, rows, lane, count)

    return advance  # type: ignore[no-any-return]


@physics
def crossed(work, rows):  # type: ignore[no-untyped-def]
    """Lanes whose tip has passed the seat or `CLEAR_LIFT` in this step, upwards or downwards."""
    count = 0
    for lane in range(rows.lanes):
        old, new = work[at(rows, rows.tip_before, lane)], work[at(rows, rows.tip, lane)]
        count += int((old <= 0.0) != (new <= 0.0)) + int((old <= CLEAR_LIFT) != (new <= CLEAR_LIFT))
    return count


@physics
def note_crossing(work, rows, lane, count):  # type: ignore[no-untyped-def]
    """Keep the opening, the first and the last closing, in steps; zero is none.

    The needle is open once its tip has first risen by `CLEAR_LIFT`, and closes when it first meets the seat after
    that. It has reopened, and closes again, if it rises as far again or injects more than `REOPENED` meanwhile: the
    ringing of a closed needle and smaller bounces are neither.
    """
    old, new = work[at(rows, rows.tip_before, lane)], work[at(rows, rows.tip, lane)]
    injected = work[at(rows, rows.injected, lane)]
    if old <= 0.0 < new:
        work[at(rows, rows.lifted, lane)] = injected
    if old <= CLEAR_LIFT < new:
        if work[at(rows, rows.opened, lane)] == 0.0:
            work[at(rows, rows.opened, lane)] = count - (new - CLEAR_LIFT) / (new - old)
        work[at(rows, rows.clear, lane)] = 1.0
        work[at(rows, rows.shut, lane)] = 0.0  # it has not closed for the last time
    reopened = injected - work[at(rows, rows.lifted, lane)] > REOPENED * injected
    counts = work[at(rows, rows.clear, lane)] > 0.0 or reopened
    if new <= 0.0 < old and work[at(rows, rows.opened, lane)] > 0.0 and counts:
        work[at(rows, rows.shut, lane)] = count - new / (new - old)
        if work[at(rows, rows.first_shut, lane)] == 0.0:
            work[at(rows, rows.first_shut, lane)] = work[at(rows, rows.shut, lane)]
        work[at(rows, rows.clear, lane)] = 0.0


@physics
def arrived(work, rows, wave, lane):  # type: ignore[no-untyped-def]
    """A wave that arrives: between the two slots of its ring that `arrive` has put side by side."""
    part = work[at(rows, rows.delays + 2 * wave + 1, lane)]
    late, later = work[at(rows, rows.arriving + wave, lane)], work[at(rows, rows.arriving + 3 + wave, lane)]
    return (1.0 - part) * late + part * later


@physics
def copy_number(target, to, source, first):  # type: ignore[no-untyped-def]
    """A row of one lane."""
    target[to] = source[first]


def make_ferry(rows: Rows, copy: Callable[..., Any]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Functions that bring the waves that arrive in step k, and take those that leave, from and into their rings.

    Parameters
    ----------
    copy : function (target, to, source, first)
        Copies a row.
    """

    @physics
    def arrive(work, waves, ring, k, alike):  # type: ignore[no-untyped-def]
        # slots k − delay and k − delay − 1; lanes that differ in no delay find theirs in one row
        mask = ring - 1
        for wave in range(3):
            row = rows.delays + 2 * wave
            for slot in range(2):
                to = at(rows, rows.arriving + 3 * slot + wave, 0)
                if alike:
                    first = wave * ring + ((k - int(work[at(rows, row, 0)]) - slot) & mask)
                    copy(work, to, waves, at(rows, first, 0))
                else:
                    for lane in range(rows.lanes):
                        first = wave * ring + ((k - int(work[at(rows, row, lane)]) - slot) & mask)
                        work[to + lane] = waves[at(rows, first, lane)]

    @physics
    def leave(work, waves, ring, k):  # type: ignore[no-untyped-def]
        for wave in range(3):
            copy(waves, at(rows, wave * ring + (k & (ring - 1)), 0), work, at(rows, rows.leaving + wave, 0))

    return arrive, leave


@physics
def set_densities(work, rows, candidates, density, point):  # type: ignore[no-untyped-def]
    """Keep the density that makes a volume of each lane's samples; one row of `density` holds for all candidates."""
    for lane in range(rows.lanes):
        candidate = candidates[1 + lane] if density.shape[0] > 1 else 0
        work[at(rows, rows.density, lane)] = density[candidate, point]


@physics
def sample(work, rows, part, width, target, weight, first):  # type: ignore[no-untyped-def]
    """Take the sample that ends `part` of a step into the last one, and add up its misfit, by volume as the target."""
    for lane in range(rows.lanes):
        start = work[at(rows, rows.before, lane)]
        here = start + part * (work[at(rows, rows.injected, lane)] - start)
        # a division: the compiler contracts a product and a difference in some lanes and not in others
        error = (here - work[at(rows, rows.mark, lane)]) / (width * work[at(rows, rows.density, lane)]) - target
        counts = 0.0 if first else weight
        work[at(rows, rows.absolute, lane)] += counts * abs(error)
        work[at(rows, rows.squared, lane)] += counts * error * error
        work[at(rows, rows.mark, lane)] = here


@physics
def look(work, rows, cylinder, quiet, patience, every, out):  # type: ignore[no-untyped-def]
    """Take the figures of lanes that have ended; true once every lane has.

    A lane ends when it has failed or, where there is a `patience`, when needle and valve have rested for that many
    looks, one in `every` steps, and for longer than a bouncing one touches its seat: what its neighbours do after that
    does not touch its figures. A needle that has closed on a valve still in motion, or on a chamber that has not
    refilled, may open again.
    """
    ended = 0
    for lane in range(rows.lanes):
        if work[at(rows, rows.done, lane)] == 0.0:
            mass = work[at(rows, rows.injected, lane)]
            gain = mass - work[at(rows, rows.seen, lane)]
            work[at(rows, rows.seen, lane)] = mass
            shut = work[at(rows, rows.control_pressure, lane)] > RECOVERED * work[at(rows, rows.store_pressure, lane)]
            rests = needle_rests(work, rows, lane, cylinder) and work[at(rows, rows.valve_lift, lane)] <= 0.0 and shut
            still = quiet and rests and gain <= DRIBBLE[0] + DRIBBLE[1] * mass
            work[at(rows, rows.rested, lane)] = work[at(rows, rows.rested, lane)] + 1.0 if still else 0.0
            rested = work[at(rows, rows.rested, lane)]
            over = patience > 0 and rested > patience and rested * every > work[at(rows, rows.touch, lane)]
            if over or not is_sound(work, rows, lane):
                report(work, rows, lane, cylinder, out)
                work[at(rows, rows.done, lane)] = 1.0
        if work[at(rows, rows.done, lane)] != 0.0:
            ended += 1
    return ended == rows.lanes


@physics
def needle_rests(work, rows, lane, cylinder):  # type: ignore[no-untyped-def]
    """True for a needle on its seat and a SAC that has emptied."""
    return work[at(rows, rows.tip, lane)] <= 0.0 and work[at(rows, rows.sac_pressure, lane)] - cylinder < RELAXED


@physics
def is_sound(work, rows, lane):  # type: ignore[no-untyped-def]
    """True for a state that is finite and inside its stops."""
    return (
        abs(work[at(rows, rows.tip, lane)]) < RUNAWAY
        and abs(work[at(rows, rows.top, lane)]) < RUNAWAY
        and abs(work[at(rows, rows.injected, lane)]) < 1.0
        and abs(work[at(rows, rows.sac_pressure, lane)]) < 1e10
    )


@physics
def crossing(work, rows, row, lane):  # type: ignore[no-untyped-def]
    """Instant of a noted crossing in steps; NaN where there was none."""
    return work[at(rows, row, lane)] if work[at(rows, row, lane)] > 0.0 else np.nan


@physics
def report(work, rows, lane, cylinder, out):  # type: ignore[no-untyped-def]
    """Write the figures of a lane, (lanes, figures)."""
    out[lane, INJECTED] = work[at(rows, rows.injected, lane)]
    out[lane, RETURNED] = work[at(rows, rows.returned, lane)]
    out[lane, SUPPLIED] = work[at(rows, rows.supplied, lane)]
    out[lane, OPENING] = crossing(work, rows, rows.opened, lane)
    out[lane, CLOSING] = crossing(work, rows, rows.shut, lane)
    out[lane, FIRST_CLOSING] = crossing(work, rows, rows.first_shut, lane)
    out[lane, GREATEST_LIFT] = work[at(rows, rows.greatest, lane)]
    out[lane, ABSOLUTE] = work[at(rows, rows.absolute, lane)]
    out[lane, SQUARED] = work[at(rows, rows.squared, lane)]
    out[lane, SOUND] = 1.0 if is_sound(work, rows, lane) else 0.0
    out[lane, CLOSED] = 1.0 if needle_rests(work, rows, lane, cylinder) else 0.0


@physics
def report_rest(work, rows, cylinder, out):  # type: ignore[no-untyped-def]
    """Write the figures of the lanes that have run to the end of the simulated time."""
    for lane in range(rows.lanes):
        if work[at(rows, rows.done, lane)] == 0.0:
            report(work, rows, lane, cylinder, out)


@physics
def record(work, rows, trace):  # type: ignore[no-untyped-def]
    """Copy state and leaving waves into a trace, (rows, lanes that are kept)."""
    for row in range(trace.shape[0]):
        for lane in range(trace.shape[1]):
            trace[row, lane] = work[at(rows, rows.state + row, lane)]


def make_loop(variant: Variant, vector: Vector) -> Callable[..., Any]:
    """The loop over blocks [first, last) of a job; arguments are those of `lanes.Job`, `lanes.Misfit`, then outputs."""
    rows, real = make_rows(variant, vector.lanes), vector.real
    begin, advance = make_begin(variant, rows), make_advance(variant, rows, widest_vectors)
    arrive, leave = make_ferry(rows, row_copier(vector.lanes))
    parameters = len(PARAMETERS.paths) + len(FUEL.paths)
    memory = make_memory(vector)

    def loop(  # type: ignore[no-untyped-def]
        theta, settings, inputs, steps, quiet, blocks, dt, ring, look_every, patience,
        bound_count, bounds, target, weight, density, trace, out, first, last,
    ):  # fmt: skip
        widest_vectors()
        step_size = real(dt)
        mode = exchange_rounding(FLUSH_TINY, KEEP_ALL)
        work = memory(rows.end * rows.lanes)
        waves = memory(max(3 * ring, parameters) * rows.lanes)
        for block in range(first, last):
            point = blocks[block, 0]
            rail, cylinder, low = settings[point, 0], settings[point, 1], settings[point, 2]
            setting = Setting(real(rail), real(cylinder), real(low), step_size)
            alike = begin(work, waves, ring, theta, blocks[block], setting, out[block])
            set_densities(work, rows, blocks[block], density, point)
            if trace.shape[0] > 0:
                record(work, rows, trace[block, 0])
            bound = 0
            for k in range(steps[point]):
                x = inputs[point, k]
                u = Inputs(real(x[0]), real(x[1]), real(x[2]), real(x[3]), real(x[4]), real(x[5]))
                arrive(work, waves, ring, k, alike)
                advance(work, real(k + 1), u, step_size)
                leave(work, waves, ring, k)
                while bound < bound_count[point] and bounds[point, bound] <= k + 1.0:
                    width = dt * (bounds[point, bound] - bounds[point, max(bound - 1, 0)]) if bound > 0 else 1.0
                    sample(
                        work,
                        rows,
                        real(bounds[point, bound] - k),
                        real(width),
                        real(target[point, bound]),
                        real(weight[point, bound]),
                        bound == 0,
                    )
                    bound += 1
                if trace.shape[0] > 0:
                    record(work, rows, trace[block, k + 1])
                if k % look_every == look_every - 1:  # noqa: SIM102
                    if look(work, rows, u.cylinder, k >= quiet[point], patience, look_every, out[block]):
                        break
            report_rest(work, rows, real(inputs[point, steps[point] - 1, 1]), out[block])
        exchange_rounding(mode, KEEP_NONE)

    return loop
