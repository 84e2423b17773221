"""The fast engine: candidates side by side in SIMD lanes, blocks of lanes on threads.

A block is one operating point and as many candidates as it has lanes. They live behind one pointer,
rows × lanes; the loop over lanes calls the step of `commonrail.injector.step` on NamedTuples and is
vectorised by the compiler. Travelling waves wait in ring buffers behind the other rows. Samples and their
misfit are taken inside the loop, so a population leaves no traces in memory. A block depends on nothing
but its own candidates: results are the same bits for any number of threads.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.choices import Precision
from commonrail.compile import kernel
from commonrail.engine.block import Vector, make_loop
from commonrail.engine.threads import side_by_side
from commonrail.injector.model import Waves
from commonrail.injector.variants import Variant, wiring

Floats = NDArray[np.float64]


# One register of 512 bits: docs/decisions/0011-the-widest-registers.md.
VECTORS = {
    Precision.F64: Vector(8, np.float64),
    Precision.F32: Vector(16, np.float32),
}


class Misfit(NamedTuple):
    """Samples to compare with, per operating point.

    Attributes
    ----------
    bound_count : (points,) int
        Sample bounds used, 0 where there are none.
    bounds : (points, bounds)
        Sample bounds in steps after time zero; a sample is the mean flow between two bounds.
    target, weight : (points, bounds)
        Measured mean flow by volume [m³/s] and weight of the sample that ends at a bound.
    density : (1 or candidates, points)
        Density that makes a volume of a simulated mass [kg/m³]; NaN for the candidate's own, see `own_where_open`.
        With ones the targets are masses [kg/s].
    """

    bound_count: NDArray[np.int64]
    bounds: Floats
    target: Floats
    weight: Floats
    density: Floats

    @classmethod
    def none(cls, points: int) -> Misfit:
        """Nothing to compare with."""
        empty = np.zeros((points, 0))
        return cls(np.zeros(points, np.int64), empty, empty, empty, np.ones((1, points)))

    def own_where_open(self, own: Floats) -> Misfit:
        """The same samples with each candidate's own density, (1 or candidates, points), where none is given."""
        return self._replace(density=np.where(np.isnan(self.density), own, self.density))


class Outcome(NamedTuple):
    """Per lane figures of a run; shapes (blocks, lanes).

    `opening`, `closing` and `first_closing` are in steps (NaN where there is none); masses in kg; `absolute` and
    `squared` are the weighted sums of the samples' errors [m³/s], [(m³/s)²]; `sound` is 1 for a run that stayed
    finite and inside its stops, `closed_at_start` for needle and valve at rest before energising, `closed_at_end` for
    a needle on its seat and a SAC that had emptied when the simulation ended.
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
    first_closing: Floats


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
        First step at which an injection may have ended.
    blocks : (blocks, 1 + lanes) int
        Operating point, then the candidates of the lanes.
    dt : float
    ring : int
        Slots of a ring buffer, a power of two above the longest delay.
    look_every : int
        Steps between looks at health and rest.
    patience : int
        Looks for which needle and valve must have rested before a simulation ends; 0: it runs to its horizon.
    """

    theta: Floats
    settings: Floats
    inputs: Floats
    steps: NDArray[np.int64]
    quiet: NDArray[np.int64]
    blocks: NDArray[np.int64]
    dt: float
    ring: int
    look_every: int
    patience: int


@functools.cache
def compiled(variant: Variant, precision: Precision) -> Callable[..., None]:
    """The block loop of a variant, compiled (or loaded from the cache) at its first call."""
    vector = VECTORS[precision]
    name = f"{vector.lanes} lanes {precision.value}: {variant.label}"
    return kernel(make_loop(variant, vector), name, real=vector.real)  # type: ignore[no-any-return]


def trace_paths(variant: Variant) -> tuple[str, ...]:
    """Names of the rows that a trace records: the state, then the waves that leave."""
    return wiring(variant).state.paths + tuple(f"waves.{name}" for name in Waves._fields)


def run(
    job: Job,
    variant: Variant,
    misfit: Misfit | None = None,
    threads: int = 1,
    precision: Precision = Precision.F64,
) -> Outcome:
    """Run all blocks of a job."""
    out = _run(job, compiled(variant, precision), misfit, np.empty((0, 0, 0, 0)), threads)
    return Outcome(*np.moveaxis(out, 2, 0))


def run_traced(
    job: Job, variant: Variant, threads: int = 1, precision: Precision = Precision.F64
) -> tuple[Outcome, Floats]:
    """Run all blocks and keep the state after every step: (blocks, steps + 1, rows, lanes).

    Of a block that there are not enough candidates for, only their lanes are kept.
    """
    kept = min(job.blocks.shape[1] - 1, len(job.theta))
    trace = np.full((len(job.blocks), int(job.steps.max()) + 1, len(trace_paths(variant)), kept), np.nan)
    return Outcome(*np.moveaxis(_run(job, compiled(variant, precision), None, trace, threads), 2, 0)), trace


def _run(job: Job, loop: Callable[..., None], misfit: Misfit | None, trace: Floats, threads: int) -> Floats:
    n = len(job.blocks)
    out = np.empty((n, job.blocks.shape[1] - 1, len(Outcome._fields)))
    samples = misfit or Misfit.none(len(job.settings))
    share = max(1, -(-n // threads))

    def work(first: int) -> None:
        loop(*job, *samples, trace, out, first, min(first + share, n))

    side_by_side(work, range(0, n, share))
    return out
