"""The loop over blocks, steps and lanes that `lanes` compiles.

Travelling waves wait in three ring buffers behind one pointer, the other rows of `rows.Working` behind another.
Parameters are read once, through the rings' memory, before the first wave is written. How many lanes there are, and in
which precision, is a choice of the machine: see `Vector`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from commonrail.engine.notes import (
    FIGURE,
    Rest,
    Sample,
    crossed,
    look,
    note_crossing,
    record,
    report_rest,
    sample,
    set_densities,
)
from commonrail.engine.rows import at, make_rows
from commonrail.fuel.kernel import FuelCoefficients
from commonrail.injector.layout import layout_of
from commonrail.injector.model import Inputs, Setting, Waves
from commonrail.injector.variants import Variant, wiring

Floats = NDArray[np.float64]
Law = Callable[..., Any]

FUEL = layout_of(FuelCoefficients)


class Vector(NamedTuple):
    """Width of a block in candidates, and the type of its numbers."""

    lanes: int
    real: Any


class Courses(NamedTuple):
    """Boundary conditions at each operating point.

    Attributes
    ----------
    settings : (points, 3)
        Rail, cylinder and return pressure at time zero [Pa].
    inputs : (points, steps, 6)
        Fields of `Inputs`, means over each step.
    steps : (points,) int
    quiet : (points,) int
        First step at which an injection may have ended.
    """

    settings: Floats
    inputs: Floats
    steps: NDArray[np.int64]
    quiet: NDArray[np.int64]


class Job(NamedTuple):
    """All that a run needs, as arrays.

    Attributes
    ----------
    theta : (candidates, parameters + fuel coefficients)
    courses : Courses
    blocks : (blocks, 1 + lanes) int
        Operating point, then the candidates of the lanes.
    dt : float
        [s].
    ring : int
        Slots of a ring buffer, a power of two above the longest delay.
    look_every : int
        Steps between looks at health and rest.
    patience : int
        Looks for which needle and valve must have rested before a simulation ends; 0: it runs to its horizon.
    """

    theta: Floats
    courses: Courses
    blocks: NDArray[np.int64]
    dt: float
    ring: int
    look_every: int
    patience: int


class Samples(NamedTuple):
    """Samples of a rate to compare with, at each operating point.

    Attributes
    ----------
    bound_count : (points,) int
    due : (points, bounds) int
        Step in which a sample ends.
    samples : (points, bounds, 4)
        Fields of `Sample`.
    density : (1 or candidates, points)
        As in `lanes.Misfit`.
    """

    bound_count: NDArray[np.int64]
    due: NDArray[np.int64]
    samples: Floats
    density: Floats


class Memory(NamedTuple):
    """Memory of a block: its working rows, and its rings of so many slots."""

    work: Any
    waves: Any
    ring: int


def make_memory(vector: Vector) -> Law:
    """Function that allocates numbers from the start of a cache line: a vector as long as one would straddle two."""
    real, spare = vector.real, CACHE_LINE // np.dtype(vector.real).itemsize

    @physics
    def memory(count):  # type: ignore[no-untyped-def]
        whole = np.empty(count + spare, real)
        first = (-(whole.ctypes.data // whole.itemsize)) % spare
        return whole[first : first + count]

    return memory


def make_begin(variant: Variant, rows: Any) -> Law:
    """Function that puts the candidates of a block to rest; true if all their delays are alike."""
    wired = wiring(variant)
    load_parameters, load_fuel = wired.parameters.load, FUEL.load
    store_coefficients, store_state = wired.coefficients.store, wired.state.store
    coefficients, rest, longest_touch = wired.setup, wired.rest, wired.touch
    known, fuel_known = len(wired.parameters.paths), len(FUEL.paths)

    @physics
    def begin(memory, theta, candidates, setting, out):  # type: ignore[no-untyped-def]
        work, waves, ring = memory
        for lane in range(rows.lanes):
            for row in range(known + fuel_known):
                waves[at(rows, row, lane)] = theta[candidates[1 + lane], row]
        for lane in range(rows.lanes):
            parameters = load_parameters(waves, lane, rows.lanes)
            c = coefficients(parameters, load_fuel(waves, at(rows, known, lane), rows.lanes), setting)
            store_coefficients(work, lane, rows.lanes, c)
            store_state(work, at(rows, rows.state, lane), rows.lanes, rest(c, setting))
            for row in range(rows.leaving, rows.end):
                work[at(rows, row, lane)] = 0.0
            work[at(rows, rows.touch, lane)] = longest_touch(c) / setting.dt
            rests = work[at(rows, rows.tip, lane)] < 0.0 and work[at(rows, rows.valve_lift, lane)] < 0.0
            out[lane, FIGURE.closed_at_start] = 1.0 if rests else 0.0
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
                work[at(rows, rows.whole + wave, lane)] = float(int(delay))
                work[at(rows, rows.part + wave, lane)] = delay - int(delay)
                alike = alike and work[at(rows, row, lane)] == work[at(rows, row, 0)]
        return alike

    return begin  # type: ignore[no-any-return]


@physics
def any_vectors():  # type: ignore[no-untyped-def]
    """In place of `compile.widest_vectors` where there are none."""


def make_advance(variant: Variant, rows: Any, vectors: Law = any_vectors) -> Law:
    """Function that takes all lanes of a block one step on; the loop in it is what the compiler vectorises.

    Parameters
    ----------
    variant : Variant
    rows : Rows
    vectors : function
        `compile.widest_vectors` where lanes are vectors.
    """
    wired = wiring(variant)
    load_coefficients, load_state, store_state = wired.coefficients.load, wired.state.load, wired.state.store
    step, lifts = wired.step, wired.body.lifts

    @physics
    def advance(work, count, u, dt):  # type: ignore[no-untyped-def]
        vectors()
        for lane in range(rows.lanes):
            c = load_coefficients(work, lane, rows.lanes)
            s = load_state(work, at(rows, rows.state, lane), rows.lanes)
            arriving = Waves(arrived(work, rows, 0, lane), arrived(work, rows, 1, lane), arrived(work, rows, 2, lane))
            after, away = step(c, s, u, arriving, dt)
            old, new = lifts(s.body.z).tip, lifts(after.body.z).tip
            work[at(rows, rows.tip_before, lane)] = old
            work[at(rows, rows.greatest, lane)] = max(work[at(rows, rows.greatest, lane)], new)
            work[at(rows, rows.before, lane)] = s.nozzle.injected
            store_state(work, at(rows, rows.state, lane), rows.lanes, after)
            work[at(rows, rows.leaving, lane)] = away.down
            work[at(rows, rows.leaving + 1, lane)] = away.up
            work[at(rows, rows.leaving + 2, lane)] = away.back
        if crossed(work, rows) > 0:  # rarely: the loop above stays free of it
            for lane in range(rows.lanes):
                note_crossing(work, rows, lane, count)

    return advance  # type: ignore[no-any-return]


@physics
def arrived(work, rows, wave, lane):  # type: ignore[no-untyped-def]
    """A wave that arrives: between the two slots of its ring that `arrive` has put side by side."""
    part = work[at(rows, rows.part + wave, lane)]
    late, later = work[at(rows, rows.late + wave, lane)], work[at(rows, rows.later + wave, lane)]
    return (1.0 - part) * late + part * later


@physics
def copy_number(target, to, source, first):  # type: ignore[no-untyped-def]
    """A row of one lane."""
    target[to] = source[first]


def make_ferry(rows: Any, copy: Law) -> tuple[Law, Law]:
    """Functions that bring the waves that arrive in step k, and take those that leave, from and into their rings.

    Parameters
    ----------
    copy : function (target, to, source, first)
        Copies a row.
    """

    @physics
    def arrive(memory, k, alike):  # type: ignore[no-untyped-def]
        # slots k − delay and k − delay − 1; lanes that differ in no delay find theirs in one row
        work, waves, ring = memory
        mask = ring - 1
        for wave in range(3):
            row = rows.whole + wave
            for slot in range(2):
                to = at(rows, (rows.later if slot else rows.late) + wave, 0)
                if alike:
                    first = wave * ring + ((k - int(work[at(rows, row, 0)]) - slot) & mask)
                    copy(work, to, waves, at(rows, first, 0))
                else:
                    for lane in range(rows.lanes):
                        first = wave * ring + ((k - int(work[at(rows, row, lane)]) - slot) & mask)
                        work[to + lane] = waves[at(rows, first, lane)]

    @physics
    def leave(memory, k):  # type: ignore[no-untyped-def]
        work, waves, ring = memory
        for wave in range(3):
            copy(waves, at(rows, wave * ring + (k & (ring - 1)), 0), work, at(rows, rows.leaving + wave, 0))

    return arrive, leave


@physics
def keep_if_asked(work, rows, trace, block, k):  # type: ignore[no-untyped-def]
    """Copy state and leaving waves of step k into a trace that is not empty."""
    if trace.shape[0] > 0:
        record(work, rows, trace[block, k])


def make_simulate(variant: Variant, rows: Any, real: Any, copy: Law, keep: Law, vectors: Law = any_vectors) -> Law:
    """Function (memory, job, samples, block, trace, out) that simulates one block.

    Parameters
    ----------
    variant : Variant
    rows : Rows
    real : type
        Of the numbers that it computes in.
    copy : law
        Copies a row, see `make_ferry`.
    keep : law
        Function (work, rows, trace, block, k) that copies a state into a trace.
    vectors : law
        See `make_advance`.
    """
    begin, advance = make_begin(variant, rows), make_advance(variant, rows, vectors)
    arrive, leave = make_ferry(rows, copy)

    @physics
    def simulate(memory, job, samples, block, trace, out):  # type: ignore[no-untyped-def]
        vectors()
        settings, inputs, steps, quiet = job.courses
        work, candidates, dt = memory.work, job.blocks[block], real(job.dt)
        point = candidates[0]
        rail, cylinder, low = settings[point, 0], settings[point, 1], settings[point, 2]
        setting = Setting(real(rail), real(cylinder), real(low), dt)
        alike = begin(memory, job.theta, candidates, setting, out) or rows.lanes == 1
        set_densities(work, rows, candidates, samples.density, point)
        keep(work, rows, trace, block, 0)
        bound = 0
        for k in range(steps[point]):
            x = inputs[point, k]
            u = Inputs(real(x[0]), real(x[1]), real(x[2]), real(x[3]), real(x[4]), real(x[5]))
            arrive(memory, k, alike)
            advance(work, real(k + 1), u, dt)
            leave(memory, k)
            while bound < samples.bound_count[point] and samples.due[point, bound] <= k:
                s = samples.samples[point, bound]
                sample(work, rows, Sample(real(s[0]), real(s[1]), real(s[2]), real(s[3])), bound == 0)
                bound += 1
            keep(work, rows, trace, block, k + 1)
            if k % job.look_every == job.look_every - 1:
                rest = Rest(k >= quiet[point], job.patience, job.look_every)
                if look(work, rows, u.cylinder, rest, out):
                    break
        report_rest(work, rows, real(inputs[point, steps[point] - 1, 1]), out)

    return simulate  # type: ignore[no-any-return]


def make_loop(variant: Variant, vector: Vector) -> Law:
    """The loop over blocks [first, last): function (job, samples, trace, out, first, last)."""
    rows, allocate = make_rows(variant, vector.lanes), make_memory(vector)
    simulate = make_simulate(variant, rows, vector.real, row_copier(vector.lanes), keep_if_asked, widest_vectors)
    parameters = len(wiring(variant).parameters.paths) + len(FUEL.paths)

    def loop(job, samples, trace, out, first, last):  # type: ignore[no-untyped-def]
        widest_vectors()
        mode = exchange_rounding(FLUSH_TINY, KEEP_ALL)
        work = allocate(rows.end * rows.lanes)
        memory = Memory(work, allocate(max(3 * job.ring, parameters) * rows.lanes), job.ring)
        for block in range(first, last):
            simulate(memory, job, samples, block, trace, out[block])
        exchange_rounding(mode, KEEP_NONE)

    return loop
