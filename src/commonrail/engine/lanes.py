"""The fast engine: candidates side by side in SIMD lanes, blocks of lanes on threads.

A block is one operating point and up to `LANES` candidates. Its lanes live behind one pointer,
rows × lanes; the loop over lanes calls the step of `commonrail.injector.step` on NamedTuples and is
vectorised by the compiler. Travelling waves wait in ring buffers behind the other rows. Samples and their
misfit are taken inside the loop, so a population leaves no traces in memory. A block depends on nothing
but its own candidates: results are the same bits for any number of threads.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.compile import kernel
from commonrail.fuel.kernel import FuelCoefficients
from commonrail.injector import setup
from commonrail.injector.layout import LANES, layout_of
from commonrail.injector.model import Inputs, Parameters, Setting, Waves
from commonrail.injector.step import RELAXED
from commonrail.injector.variants import Variant, wiring

Floats = NDArray[np.float64]

PARAMETERS = layout_of(Parameters)
FUEL = layout_of(FuelCoefficients)
CHECK_EVERY = 32  # steps between looks at health and closing
RUNAWAY = 2e-3  # a tip or top this far off [m] has left the injector


class Misfit(NamedTuple):
    """Samples to compare with, per operating point.

    Attributes
    ----------
    count : (points,) int
        Sample bounds used, 0 where there are none.
    bounds : (points, bounds)
        Sample bounds in steps after time zero; a sample is the mean flow between two bounds.
    target, weight : (points, bounds)
        Measured mean mass flow [kg/s] and weight of the sample that ends at a bound.
    """

    count: NDArray[np.int64]
    bounds: Floats
    target: Floats
    weight: Floats


class Outcome(NamedTuple):
    """Per lane figures of a run; shapes (blocks, LANES).

    `opening` and `closing` are in steps (NaN where there is none); masses in kg; `absolute` and `squared`
    are the weighted sums of the samples' errors [kg/s], [(kg/s)²]; `finite` is 1 for a run that stayed
    finite and inside its stops.
    """

    injected: Floats
    returned: Floats
    supplied: Floats
    opening: Floats
    closing: Floats
    greatest_lift: Floats
    absolute: Floats
    squared: Floats
    sound: Floats
    closed_at_start: Floats
    closed_at_end: Floats


class Job(NamedTuple):
    """All that a run needs, as arrays.

    Attributes
    ----------
    theta : (candidates, parameters + fuel coefficients)
    settings : (points, 3)
        Rail, cylinder and return pressure at time zero [Pa].
    inputs : (points, steps, 6)
        Fields of `Inputs`, means over each step.
    steps : (points,) int
    quiet : (points,) int
        First step after which nothing is energised any more.
    blocks : (blocks, 1 + LANES) int
        Operating point, then the candidates of the lanes.
    dt : float
    ring : int
        Slots of a ring buffer, a power of two above the longest delay.
    stop_when_closed : bool
    """

    theta: Floats
    settings: Floats
    inputs: Floats
    steps: NDArray[np.int64]
    quiet: NDArray[np.int64]
    blocks: NDArray[np.int64]
    dt: float
    ring: int
    stop_when_closed: bool


@functools.cache
def compiled(variant: Variant) -> Callable[..., None]:
    """The block loop of a variant, compiled (or loaded from the cache) at its first call."""
    return kernel(_block_loop(variant), f"lanes: {variant.label}")  # type: ignore[no-any-return]


def trace_paths(variant: Variant) -> tuple[str, ...]:
    """Names of the rows that a trace records: the state, then the waves that leave."""
    return wiring(variant).state.paths + tuple(f"waves.{name}" for name in Waves._fields)


def run(job: Job, variant: Variant, misfit: Misfit | None = None, threads: int = 1) -> Outcome:
    """Run all blocks of a job."""
    out = _run(job, variant, misfit, np.empty((0, 0, 0, 0)), threads)
    return Outcome(*np.moveaxis(out, 2, 0))


def run_traced(job: Job, variant: Variant, threads: int = 1) -> tuple[Outcome, Floats]:
    """Run all blocks and keep the state after every step: (blocks, steps + 1, rows, LANES)."""
    rows = len(trace_paths(variant))
    trace = np.full((len(job.blocks), int(job.steps.max()) + 1, rows, LANES), np.nan)
    return Outcome(*np.moveaxis(_run(job, variant, None, trace, threads), 2, 0)), trace


def _run(job: Job, variant: Variant, misfit: Misfit | None, trace: Floats, threads: int) -> Floats:
    n = len(job.blocks)
    out = np.empty((n, LANES, len(Outcome._fields)))
    points = len(job.settings)
    none = np.zeros((points, 0))
    samples = misfit or Misfit(np.zeros(points, np.int64), none, none, none)
    loop = compiled(variant)
    share = max(1, -(-n // threads))

    def work(first: int) -> None:
        loop(*job, *samples, trace, out, first, min(first + share, n))

    if threads == 1 or n == 1:
        loop(*job, *samples, trace, out, 0, n)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, range(0, n, share)))
    return out


def _block_loop(variant: Variant) -> Callable[..., None]:
    """The loop over blocks, steps and lanes, closed over one variant's laws and layouts."""
    wired = wiring(variant)
    load_parameters, load_fuel = PARAMETERS.load, FUEL.load
    load_coefficients, store_coefficients = wired.coefficients.load, wired.coefficients.store
    load_state, store_state = wired.state.load, wired.state.store
    at_rest, motion = wired.body.at_rest, wired.body.motion
    step = wired.step
    make_coefficients, static_loads = setup.coefficients, setup.static_loads
    seat_contact, state_at_rest = setup.seat_contact, setup.state_at_rest
    parameters, fuel_rows = len(PARAMETERS.paths), len(FUEL.paths)
    states, constants = len(wired.state.paths), len(wired.coefficients.paths)

    # Rows of the working array. Parameters and fuel are read at the start only: rings overwrite them.
    constant = 0
    state = constants
    leaving = state + states  # three waves
    arriving = leaving + 3
    note = arriving + 3  # before, mark, absolute, squared, greatest lift, opening (3), closing (3)
    before, mark, absolute, squared, greatest = note, note + 1, note + 2, note + 3, note + 4
    opened, shut = note + 5, note + 8
    final = note + 11  # injected, returned, supplied, sound, done
    delays = final + 5  # whole steps and the rest, for each wave
    rings = delays + 6
    injected = state + wired.state.row("nozzle.injected")
    returned = state + wired.state.row("books.returned")
    supplied = state + wired.state.row("books.supplied")
    sac_pressure = state + wired.state.row("sac.pressure")
    flexible = "body.z.i9" in wired.state.paths
    tip = state + wired.state.row("body.z.i9" if flexible else "body.z")
    top = state + wired.state.row("body.z.i1" if flexible else "body.z")
    feed_delay = wired.coefficients.row("delays.feed")
    back_delay = wired.coefficients.row("delays.back")
    rest_wave = wired.state.row("accumulation.fuel.pressure") + state
    low_wave = wired.state.row("return_line.pressure") + state

    def loop(
        theta, settings, inputs, steps, quiet, blocks, dt, ring, stop_when_closed,
        count, bounds, target, weight, trace, out, first, last,
    ):  # fmt: skip
        mask = ring - 1
        work = np.empty((rings + max(3 * ring, parameters + fuel_rows)) * LANES)
        for block in range(first, last):
            point = blocks[block, 0]
            n = steps[point]
            at = Setting(settings[point, 0], settings[point, 1], settings[point, 2], dt)
            for lane in range(LANES):
                candidate = blocks[block, 1 + lane]
                for row in range(parameters + fuel_rows):
                    work[(rings + row) * LANES + lane] = theta[candidate, row]
            for lane in range(LANES):
                p = load_parameters(work, rings, lane)
                c = make_coefficients(p, load_fuel(work, rings + parameters, lane), at)
                body = at_rest(c.plunger_needle, seat_contact(c), static_loads(c, at))
                store_coefficients(work, constant, lane, c)
                store_state(work, state, lane, state_at_rest(c, at, body, motion(body)))
                for row in range(note, rings):
                    work[row * LANES + lane] = 0.0
                closed = work[tip * LANES + lane] < 0.0
                out[block, lane, 9] = 1.0 if closed else 0.0
                work[(leaving + 0) * LANES + lane] = work[rest_wave * LANES + lane]
                work[(leaving + 1) * LANES + lane] = work[rest_wave * LANES + lane]
                work[(leaving + 2) * LANES + lane] = work[low_wave * LANES + lane]
            for slot in range(ring):
                for wave in range(3):
                    for lane in range(LANES):
                        work[(rings + wave * ring + slot) * LANES + lane] = work[(leaving + wave) * LANES + lane]
            if trace.shape[0] > 0:
                for row in range(trace.shape[2]):
                    for lane in range(LANES):
                        trace[block, 0, row, lane] = work[(state + row) * LANES + lane]
            alike = True
            for wave in range(3):
                row = (feed_delay if wave < 2 else back_delay) * LANES
                for lane in range(LANES):
                    delay = min(max(work[row + lane], 1.0), mask - 1.0)
                    work[(delays + 2 * wave) * LANES + lane] = float(int(delay))
                    work[(delays + 2 * wave + 1) * LANES + lane] = delay - int(delay)
                    alike = alike and work[row + lane] == work[row]
            sample = 0
            for k in range(n):
                # Waves that arrive: slots k − delay and k − delay − 1, interpolated.
                for wave in range(3):
                    base = rings + wave * ring
                    if alike:
                        row = (delays + 2 * wave) * LANES
                        whole, part = int(work[row]), work[row + LANES]
                        a = (base + ((k - whole) & mask)) * LANES
                        b = (base + ((k - whole - 1) & mask)) * LANES
                        for lane in range(LANES):
                            work[(arriving + wave) * LANES + lane] = (1.0 - part) * work[a + lane] + part * work[b + lane]
                    else:
                        for lane in range(LANES):
                            row = (delays + 2 * wave) * LANES + lane
                            whole, part = int(work[row]), work[row + LANES]
                            a = (base + ((k - whole) & mask)) * LANES + lane
                            b = (base + ((k - whole - 1) & mask)) * LANES + lane
                            work[(arriving + wave) * LANES + lane] = (1.0 - part) * work[a] + part * work[b]
                for lane in range(LANES):
                    work[before * LANES + lane] = work[injected * LANES + lane]
                u = Inputs(
                    inputs[point, k, 0], inputs[point, k, 1], inputs[point, k, 2],
                    inputs[point, k, 3], inputs[point, k, 4], inputs[point, k, 5],
                )  # fmt: skip
                for lane in range(LANES):
                    c = load_coefficients(work, constant, lane)
                    s = load_state(work, state, lane)
                    waves = Waves(
                        work[arriving * LANES + lane], work[(arriving + 1) * LANES + lane],
                        work[(arriving + 2) * LANES + lane],
                    )  # fmt: skip
                    after, away = step(c, s, u, waves, dt)
                    old, new = motion(s.body).tip, motion(after.body).tip
                    rises, falls = old <= 0.0 < new, new <= 0.0 < old
                    fresh = rises and work[opened * LANES + lane] == 0.0
                    for i, value in enumerate((k + 1.0, old, new)):
                        here = (opened + i) * LANES + lane
                        work[here] = value if fresh else work[here]
                        here = (shut + i) * LANES + lane
                        work[here] = value if falls else work[here]
                    work[greatest * LANES + lane] = max(work[greatest * LANES + lane], new)
                    store_state(work, state, lane, after)
                    work[leaving * LANES + lane] = away.down
                    work[(leaving + 1) * LANES + lane] = away.up
                    work[(leaving + 2) * LANES + lane] = away.back
                slot = rings + (k & mask)
                for lane in range(LANES):
                    work[slot * LANES + lane] = work[leaving * LANES + lane]
                    work[(slot + ring) * LANES + lane] = work[(leaving + 1) * LANES + lane]
                    work[(slot + 2 * ring) * LANES + lane] = work[(leaving + 2) * LANES + lane]
                while sample < count[point] and bounds[point, sample] <= k + 1.0:
                    part = bounds[point, sample] - k
                    width = dt * (bounds[point, sample] - bounds[point, max(sample - 1, 0)])
                    for lane in range(LANES):
                        start = work[before * LANES + lane]
                        here = start + part * (work[injected * LANES + lane] - start)
                        if sample > 0:
                            error = (here - work[mark * LANES + lane]) / width - target[point, sample]
                            work[absolute * LANES + lane] += weight[point, sample] * abs(error)
                            work[squared * LANES + lane] += weight[point, sample] * error * error
                        work[mark * LANES + lane] = here
                    sample += 1
                if trace.shape[0] > 0:
                    for row in range(trace.shape[2]):
                        for lane in range(LANES):
                            trace[block, k + 1, row, lane] = work[(state + row) * LANES + lane]
                if k % CHECK_EVERY == CHECK_EVERY - 1 or k == n - 1:
                    settled = 0
                    for lane in range(LANES):
                        lift, way = work[tip * LANES + lane], work[top * LANES + lane]
                        sane = abs(lift) < RUNAWAY and abs(way) < RUNAWAY
                        mass = work[injected * LANES + lane]
                        sane = sane and abs(mass) < 1.0 and abs(work[sac_pressure * LANES + lane]) < 1e10
                        relaxed = work[sac_pressure * LANES + lane] - u.cylinder < RELAXED
                        seated = lift <= 0.0 and relaxed and k >= quiet[point]
                        if work[(final + 4) * LANES + lane] == 0.0:
                            work[final * LANES + lane] = mass
                            work[(final + 1) * LANES + lane] = work[returned * LANES + lane]
                            work[(final + 2) * LANES + lane] = work[supplied * LANES + lane]
                            work[(final + 3) * LANES + lane] = 1.0 if sane else 0.0
                            if (stop_when_closed and seated) or not sane:
                                work[(final + 4) * LANES + lane] = 1.0
                            out[block, lane, 10] = 1.0 if seated else 0.0
                        if work[(final + 4) * LANES + lane] != 0.0:
                            settled += 1
                    if settled == LANES:
                        break
            for lane in range(LANES):
                out[block, lane, 0] = work[final * LANES + lane]
                out[block, lane, 1] = work[(final + 1) * LANES + lane]
                out[block, lane, 2] = work[(final + 2) * LANES + lane]
                for i in range(2):
                    at_ = (opened if i == 0 else shut) * LANES + lane
                    index, old_, new_ = work[at_], work[at_ + LANES], work[at_ + 2 * LANES]
                    out[block, lane, 3 + i] = index - new_ / (new_ - old_) if index > 0.0 else np.nan
                out[block, lane, 5] = work[greatest * LANES + lane]
                out[block, lane, 6] = work[absolute * LANES + lane]
                out[block, lane, 7] = work[squared * LANES + lane]
                out[block, lane, 8] = work[(final + 3) * LANES + lane]

    return loop
