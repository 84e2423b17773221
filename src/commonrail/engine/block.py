"""Loop over blocks, steps and lanes of the fast engine.

Travelling waves are stored in three ring buffers at one pointer, the other rows of `job.Working` at another.
Parameters are read once, through the memory of the rings, before the first wave is written. The machine determines the
number of lanes and their precision: see `Vector`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple, TypeAlias

from commonrail.base.choices import Precision
from commonrail.compiler.table import WHOLE, floats
from commonrail.engine.end_of_run import StopRule, check, next_horizon, report_ended, set_horizons
from commonrail.engine.job import FIGURE, FUEL, LOOP_ARGUMENTS, NEVER, VECTORS, Outcome, make_rows, shape_of
from commonrail.engine.recorder import Sample, at, crossing, keep_if_asked, record_crossing, set_densities, take_sample
from commonrail.physics.components.feed_pipe import steady
from commonrail.physics.law import FLUSH_TINY, KEEP_ALL, KEEP_NONE, layout_of, physics
from commonrail.physics.model import Inputs, Setting, Waves
from commonrail.physics.variants import Variant, connections_of, wiring

Law: TypeAlias = Callable[..., Any]


class Memory(NamedTuple):
    """Memory of a block."""

    work: Any  # (rows × lanes,)
    waves: Any  # (3 × ring × lanes,): rings of the three waves
    ring: int  # slots of a ring
    origins: Any  # of the clocks [s], (2 × lanes,) in double precision; None if the inputs need none


@physics
def fill_rings(memory, rows, copy):  # type: ignore[no-untyped-def]
    """Fill the rings with the waves that leave at rest, and set the delays; true if all lanes have equal delays.

    Row by row by `copy` of `Machine`: the compiler turns nested loops into one over the slots, which scatters numbers.
    """
    work, waves, ring = memory.work, memory.waves, memory.ring
    alike = True
    for wave in range(3):
        rest = at(rows, rows.leaving + wave, 0)
        row = rows.feed_delay if wave < 2 else rows.back_delay
        copy(work, at(rows, rows.arriving + wave, 0), work, rest)
        for slot in range(ring):
            copy(waves, at(rows, wave * ring + slot, 0), work, rest)
        for lane in range(rows.lanes):
            delay = min(max(work[at(rows, row, lane)], 1.0), ring - 2.0)
            work[at(rows, rows.delay_steps + wave, lane)] = float(int(delay))
            work[at(rows, rows.delay_fraction + wave, lane)] = delay - int(delay)
            alike = alike and work[at(rows, row, lane)] == work[at(rows, row, 0)]
    return alike


@physics
def arriving_wave(work, rows, wave, lane):  # type: ignore[no-untyped-def]
    """Arriving wave, interpolated between the two ring-buffer slots that `arrive` copied."""
    fraction = work[at(rows, rows.delay_fraction + wave, lane)]
    late, later = work[at(rows, rows.arriving + wave, lane)], work[at(rows, rows.arriving_before + wave, lane)]
    return (1.0 - fraction) * late + fraction * later


@physics
def copy_number(target, to, source, first):  # type: ignore[no-untyped-def]
    """Copy a row of one lane."""
    target[to] = source[first]


@physics
def any_number(source, first):  # type: ignore[no-untyped-def]
    """True if a row of one lane is not zero."""
    return source[first] != 0.0


@physics
def gather_number(target, to, source, where):  # type: ignore[no-untyped-def]
    """Gather a row of one lane from a slot of its ring."""
    place, first, now, mask = where
    target[to] = source[first + ((now - int(target[place])) & mask)]


def make_wave_transport(rows: Any, copy: Law, gather: Law = gather_number) -> tuple[Law, Law]:
    """Make the functions that read arriving waves from their rings and write leaving waves into them.

    `copy`, `gather`: see `Machine`.
    """

    @physics
    def arrive(memory, k, alike):  # type: ignore[no-untyped-def]
        # slots k − delay and k − delay − 1, which was the first one a step ago; lanes with equal delays share
        # one row
        work, waves, ring = memory.work, memory.waves, memory.ring
        mask = ring - 1
        for wave in range(3):
            late, place = at(rows, rows.arriving + wave, 0), at(rows, rows.delay_steps + wave, 0)
            copy(work, at(rows, rows.arriving_before + wave, 0), work, late)
            if alike:
                copy(work, late, waves, at(rows, wave * ring + ((k - int(work[place])) & mask), 0))
            else:
                gather(work, late, waves, (place, wave * ring, k, mask))

    @physics
    def leave(memory, k):  # type: ignore[no-untyped-def]
        work, waves, ring = memory.work, memory.waves, memory.ring
        for wave in range(3):
            copy(waves, at(rows, wave * ring + (k & (ring - 1)), 0), work, at(rows, rows.leaving + wave, 0))

    return arrive, leave


class Inlets(NamedTuple):
    """Laws that set the inputs of a block, which are rows of `work`; most steps call only `every_step`."""

    row: Law  # function (courses, points) that gives the row of the table read by `every_step`
    every_step: Law  # function (memory, courses, row, k) that sets the inputs of step k
    # function (memory, courses, points, k) that turns clocks, and returns the step of the next turn of any lane
    turn: Law
    follow: Law  # function (memory, courses, points, k) that sets what follows a trace
    follows_trace: Law  # function (courses, points) that is true if any lane follows a trace
    first: int  # step of the first turn; negative if there is no turn


def make_clocks(rows: Any, read: Law) -> Inlets:
    """Make inlets from `Courses`; `read`: as `compiler.laws.clock_reader`."""

    @physics
    def clock_of(courses, points):  # type: ignore[no-untyped-def]
        return courses.clock[points[0]]

    @physics
    def tell_time(memory, courses, row, k):  # type: ignore[no-untyped-def]
        now = courses.times[row, k]
        read(memory.work, at(rows, rows.since_start, 0), memory.origins, 0, now)
        read(memory.work, at(rows, rows.since_end, 0), memory.origins, rows.lanes, now)

    @physics
    def turn(memory, courses, points, k):  # type: ignore[no-untyped-def]
        work, origins, due = memory.work, memory.origins, NEVER
        for lane in range(rows.lanes):
            here = courses.first[points[lane]] + int(work[at(rows, rows.clock_turns, lane)])
            if courses.turns[here] == k:
                origins[lane], origins[rows.lanes + lane] = courses.origins[here, 0], courses.origins[here, 1]
                work[at(rows, rows.since_start, lane)] = courses.origins[here, 2]
                work[at(rows, rows.since_end, lane)] = courses.origins[here, 3]
                work[at(rows, rows.clock_turns, lane)] += 1.0
                here += 1
            due = min(due, courses.turns[here])
        return due

    @physics
    def follow(memory, courses, points, k):  # type: ignore[no-untyped-def]
        work = memory.work
        for lane in range(rows.lanes):
            trace = courses.trace[points[lane]]
            if trace >= 0:
                for i in range(4):
                    work[at(rows, rows.inputs + i, lane)] = courses.traces[trace, k, i]

    @physics
    def traced(courses, points):  # type: ignore[no-untyped-def]
        any_trace = False
        for lane in range(rows.lanes):
            any_trace = any_trace or courses.trace[points[lane]] >= 0
        return any_trace

    return Inlets(clock_of, tell_time, turn, follow, traced, 0)


INPUTS = layout_of(Inputs)


class Machine(NamedTuple):
    """Operations on rows that depend on the machine."""

    real: Any  # floating-point type of the computation
    copy: Law  # function (target, to, source, first) that copies a row
    gather: Law  # as `compiler.laws.row_gatherer`
    any_of: Law  # as `compiler.laws.row_tester`
    inlets: Callable[[Any], Inlets]  # function (rows) -> Inlets
    keep: Law  # function (work, rows, trace, block, k) that copies a state into a trace


@physics
def one_setting(setting, lane):  # type: ignore[no-untyped-def]
    """Setting of all lanes."""
    return setting


def make_settings(real: Any) -> Law:
    """Make the function (shared, lane) that gives the setting of a lane."""

    @physics
    def setting_of(shared, lane):  # type: ignore[no-untyped-def]
        settings, points, dt = shared
        at_rest = settings[points[lane]]
        return Setting(real(at_rest[0]), real(at_rest[1]), real(at_rest[2]), dt)

    return setting_of  # type: ignore[no-any-return]


def make_begin(variant: Variant, rows: Any, setting_of: Law = one_setting, copy: Law = copy_number) -> Law:
    """Make the function (memory, theta, candidates, setting_data, out) that puts lanes to rest; true for equal delays.

    `setting_of`: function (setting_data, lane) that gives the `Setting` of a lane; `copy`: see `Machine`.
    """
    wired = wiring(variant)
    load_parameters, load_fuel, store_inputs = wired.parameters.load, FUEL.load, INPUTS.store
    store_coefficients, store_state = wired.coefficients.store, wired.state.store
    coefficients, longest_contact, farthest_lift = wired.setup, wired.longest_contact, wired.farthest
    rest = connections_of(variant).rest
    parameter_count, fuel_count = len(wired.parameters.paths), len(FUEL.paths)

    @physics
    def begin(memory, theta, candidates, setting_data, out):  # type: ignore[no-untyped-def]
        work, waves = memory.work, memory.waves
        for lane in range(rows.lanes):
            for row in range(parameter_count + fuel_count):
                waves[at(rows, row, lane)] = theta[candidates[lane], row]
        for lane in range(rows.lanes):
            setting = setting_of(setting_data, lane)
            parameters = load_parameters(waves, lane, rows.lanes)
            c = coefficients(parameters, load_fuel(waves, at(rows, parameter_count, lane), rows.lanes), setting)
            store_coefficients(work, lane, rows.lanes, c)
            s = rest(c, setting)
            store_state(work, at(rows, rows.state, lane), rows.lanes, s)
            for row in range(rows.leaving, rows.end):
                work[at(rows, row, lane)] = 0.0
            waves_at_rest = steady(c.feed_pipe, s.feed_pipe.end_flow, s.accumulation.fuel.pressure)
            work[at(rows, rows.leaving, lane)] = waves_at_rest.down
            work[at(rows, rows.leaving + 1, lane)] = waves_at_rest.up
            work[at(rows, rows.leaving + 2, lane)] = work[at(rows, rows.return_pressure, lane)]
            zero = 0.0 * setting.dt
            at_rest = Inputs(setting.rail, setting.cylinder, setting.low, zero, zero, zero)
            store_inputs(work, at(rows, rows.inputs, lane), rows.lanes, at_rest)
            work[at(rows, rows.longest_contact, lane)] = longest_contact(c) / setting.dt
            work[at(rows, rows.farthest_lift, lane)] = farthest_lift(c)
            rests = work[at(rows, rows.tip, lane)] < 0.0 and work[at(rows, rows.valve_lift, lane)] < 0.0
            out[lane, FIGURE.closed_at_start] = 1.0 if rests else 0.0
        return fill_rings(memory, rows, copy)

    return begin  # type: ignore[no-any-return]


@physics
def same_inputs(inputs, work, rows, lane):  # type: ignore[no-untyped-def]
    """Inputs shared by all lanes."""
    return inputs


@cache
def make_own_inputs() -> Law:
    """Make the function (inputs, work, rows, lane) that gives the inputs of a lane, from its rows."""
    load_inputs = INPUTS.load

    @physics
    def own_inputs(inputs, work, rows, lane):  # type: ignore[no-untyped-def]
        return load_inputs(work, at(rows, rows.inputs, lane), rows.lanes)

    return own_inputs  # type: ignore[no-any-return]


def make_advance(variant: Variant, rows: Any, inputs_of: Law = same_inputs, any_of: Law = any_number) -> Law:
    """Make the function (work, count, inputs, dt) that advances all lanes by a step; the compiler vectorises it.

    `inputs_of`: function (inputs, work, rows, lane) that gives the `Inputs` of a lane; `any_of`: see `Machine`.
    """
    wired = wiring(variant)
    load_coefficients, load_state, store_state = wired.coefficients.load, wired.state.load, wired.state.store
    step, lifts = connections_of(variant).step, wired.body.lifts

    @physics
    def advance(work, count, inputs, dt):  # type: ignore[no-untyped-def]
        for lane in range(rows.lanes):
            c = load_coefficients(work, lane, rows.lanes)
            u = inputs_of(inputs, work, rows, lane)
            s = load_state(work, at(rows, rows.state, lane), rows.lanes)
            arriving = Waves(
                arriving_wave(work, rows, 0, lane),
                arriving_wave(work, rows, 1, lane),
                arriving_wave(work, rows, 2, lane),
            )
            after, away = step(c, s, u, arriving, dt)
            old, new = lifts(s.body.z).tip, lifts(after.body.z).tip
            work[at(rows, rows.tip_before, lane)], work[at(rows, rows.crossing, lane)] = old, crossing(old, new)
            work[at(rows, rows.greatest_lift, lane)] = max(work[at(rows, rows.greatest_lift, lane)], new)
            work[at(rows, rows.injected_before, lane)] = s.nozzle.injected
            store_state(work, at(rows, rows.state, lane), rows.lanes, after)
            work[at(rows, rows.leaving, lane)] = away.down
            work[at(rows, rows.leaving + 1, lane)] = away.up
            work[at(rows, rows.leaving + 2, lane)] = away.back
        if any_of(work, at(rows, rows.crossing, 0)):  # rare: kept out of the loop above
            for lane in range(rows.lanes):
                record_crossing(work, rows, lane, count)

    return advance  # type: ignore[no-any-return]


def make_simulate(variant: Variant, rows: Any, machine: Machine) -> Law:
    """Make the function (memory, job, samples, block, trace, out) that simulates one block."""
    real, keep = machine.real, machine.keep
    begin = make_begin(variant, rows, make_settings(real), machine.copy)
    advance = make_advance(variant, rows, make_own_inputs(), machine.any_of)
    arrive, leave = make_wave_transport(rows, machine.copy, machine.gather)
    row_of, set_inputs, turn, follow, is_traced, first = machine.inlets(rows)

    @physics
    def simulate(memory, job, samples, block, trace, out):  # type: ignore[no-untyped-def]
        work, points, candidates, dt = memory.work, job.points[block], job.candidates[block], real(job.dt)
        alike = begin(memory, job.theta, candidates, (job.courses.settings, points, dt), out) or rows.lanes == 1
        horizon = set_horizons(work, rows, points, job.courses.steps, job.courses.earliest_end)
        set_densities(work, rows, candidates, points, samples.density)
        keep(work, rows, trace, block, 0)
        row, traced = row_of(job.courses, points), is_traced(job.courses, points)
        next_end, due, bound = next_horizon(work, rows, real(0)), first, 0
        for k in range(horizon):
            set_inputs(memory, job.courses, row, k)
            if k == due:
                due = turn(memory, job.courses, points, k)
            if traced:
                follow(memory, job.courses, points, k)
            arrive(memory, k, alike)
            advance(work, real(k + 1), k, dt)
            leave(memory, k)
            while bound < samples.bound_count[points[0]] and samples.due[points[0], bound] <= k:
                s = samples.samples[points[0], bound]
                take_sample(work, rows, Sample(real(s[0]), real(s[1]), real(s[2]), real(s[3])), bound == 0)
                bound += 1
            keep(work, rows, trace, block, k + 1)
            rule = StopRule(real(k), real(job.checks_at_rest), real(job.check_every))
            if k % job.check_every == job.check_every - 1 and check(work, rows, rule, out):
                break
            if real(k + 1) >= next_end:
                report_ended(work, rows, real(k + 1), out)
                next_end = next_horizon(work, rows, real(k + 1))

    return simulate  # type: ignore[no-any-return]


def entries(precision: str, width: str, *words: str) -> dict[str, tuple[Callable[..., Any], Any]]:
    """Function of a table that simulates its blocks, for a number of lanes and the `Variant` of the `words`.

    It returns 1 if the table was made for another kernel. For `cache.Source`.
    """
    from commonrail.compiler import laws

    variant, vector = Variant(*words), VECTORS[Precision(precision)]._replace(lanes=int(width))
    rows, lanes, columns, size = shape_of(variant, vector)
    copy, gather, any_of = laws.row_copier(lanes), laws.row_gatherer(lanes), laws.row_tester(lanes)
    clocks = partial(make_clocks, read=laws.clock_reader(lanes))
    machine = Machine(vector.real, copy, gather, any_of, clocks, keep_if_asked)
    simulate = make_simulate(variant, make_rows(variant, lanes), machine)
    figures, exchange = len(Outcome._fields), laws.exchange_rounding

    def blocks(shape, job, samples, trace, out, scratch, first, stride):  # type: ignore[no-untyped-def]
        if shape.rows != rows or shape.lanes != lanes or shape.columns != columns or shape.size != size:
            return 1
        if job.theta.shape[1] != columns or out.shape[1] != lanes or out.shape[2] != figures:
            return 1
        mode = exchange(FLUSH_TINY, KEEP_ALL)
        memory = Memory(scratch.work, scratch.waves, job.ring, scratch.origins)
        for block in range(first, job.points.shape[0], stride):
            simulate(memory, job, samples, block, trace, out[block])
        exchange(mode, KEEP_NONE)
        return 0

    return {"lanes": (laws.of_table(blocks, tuple(LOOP_ARGUMENTS), vector.real), laws.TABLE)}


# memory, ring, first, theta, settings, inputs, out: of `loop.Loop.march`, then unused figures
MARCH = (floats(1), WHOLE, WHOLE, floats(2), floats(1), floats(2), floats(2))


def march_entries(*words: str) -> dict[str, Any]:
    """The loop over steps of one lane, for the `Variant` of the `words`; for `cache.Source`."""
    from commonrail.compiler.laws import TABLE, exchange_rounding, of_table

    variant = Variant(*words)
    rows = make_rows(variant, 1)
    begin, advance = make_begin(variant, rows), make_advance(variant, rows)
    arrive, leave = make_wave_transport(rows, copy_number)
    size, order = rows.end, (0, 0)  # point and candidate of the single lane

    def march(memory, ring, first, theta, settings, inputs, out):  # type: ignore[no-untyped-def]
        mode = exchange_rounding(FLUSH_TINY, KEEP_ALL)
        views, dt = Memory(memory[:size], memory[size:], ring, None), settings[3]
        if inputs.shape[0] == 0:
            begin(views, theta, order, Setting(settings[0], settings[1], settings[2], dt), out)
        for i in range(inputs.shape[0]):
            u = inputs[i]
            arrive(views, first + i, True)
            advance(views.work, float(first + i + 1), Inputs(u[0], u[1], u[2], u[3], u[4], u[5]), dt)
            leave(views, first + i)
        exchange_rounding(mode, KEEP_NONE)
        return 0

    return {"march": (of_table(march, MARCH), TABLE)}
