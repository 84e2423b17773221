"""The fast engine: candidates side by side in SIMD lanes, blocks of lanes on threads.

Each lane of a block holds one candidate at one operating point. They are stored at one pointer, rows × lanes; the loop
over lanes calls the step of `commonrail.physics.step` on NamedTuples and is vectorised by the compiler. Travelling
waves are stored in ring buffers after the other rows. Samples and their misfit are taken inside the loop, and a
population leaves no traces in memory. A lane depends only on its own candidate and point: results have the same
bits for any neighbours and any number of threads.
"""

from __future__ import annotations

import functools
import threading
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, Ints
from commonrail.base.choices import Precision
from commonrail.base.errors import SimulationError
from commonrail.compiler.table import address, fill
from commonrail.engine.job import LOOP_ARGUMENTS, VECTORS, Job, LoopArguments, Outcome, Samples, scratch_for, shape_of
from commonrail.engine.machine_code import MachineCode, machine_code
from commonrail.engine.threads import side_by_side
from commonrail.physics.model import Waves
from commonrail.physics.variants import Variant, wiring

_FIRST_CALL = threading.Lock()


class Misfit(NamedTuple):
    """Samples to compare with, per operating point."""

    bound_count: Ints  # (points,) int: sample bounds used, 0 if absent
    # (points, bounds): sample bounds in steps after time zero; a sample is the mean flow between two bounds
    bounds: Floats
    # (points, bounds): measured mean flow by volume [m³/s] and weight of the sample that ends at a bound
    target: Floats
    weight: Floats
    # (1 or candidates, points): density that converts a simulated mass to a volume [kg/m³]; NaN for that of the
    # candidate, see `fill_density`. With ones the targets are masses [kg/s]
    density: Floats

    @classmethod
    def none(cls, points: int) -> Misfit:
        """No samples to compare with."""
        empty = np.zeros((points, 0))
        return cls(np.zeros(points, np.int64), empty, empty, empty, np.ones((1, points)))

    def samples(self, dt: float, steps: Ints) -> Samples:
        """Samples in the form that a loop over steps reads.

        `steps` (points,) int: of each point. A bound that rounding moves past the last step is taken at its end.
        """
        within = np.minimum(self.bounds, steps[:, None])
        # in the first step whose end reaches the bound, and in order
        due = np.maximum.accumulate(np.maximum(np.ceil(within) - 1.0, 0.0), axis=1)
        width = np.ones(self.bounds.shape)
        width[:, 1:] = dt * (self.bounds[:, 1:] - self.bounds[:, :-1])
        columns = np.stack([within - due, width, self.target, self.weight], axis=2)
        return Samples(self.bound_count, due.astype(np.int64), columns, self.density)

    def fill_density(self, candidate_density: Floats) -> Misfit:
        """Fill in each candidate's own density, (1 or candidates, points), where none is given."""
        return self._replace(density=np.where(np.isnan(self.density), candidate_density, self.density))


@functools.lru_cache(maxsize=4)
def _no_samples(points: int) -> Samples:
    """No samples to compare with at a number of points."""
    return Misfit.none(points).samples(1.0, np.zeros(points, np.int64))


@functools.cache
def load_loop(variant: Variant, precision: Precision, same_bits: bool) -> MachineCode:
    """Block loop of a variant.

    `same_bits`: exact code with equal bits on every processor, see `compiler.target.exact_processor`.
    `ConfigurationError` if equal bits are impossible on this machine, or compiling is disabled.
    """
    with _FIRST_CALL:
        return machine_code(variant, VECTORS[precision], same_bits)


def trace_paths(variant: Variant) -> tuple[str, ...]:
    """Names of the rows that a trace records: the state, then the waves that leave."""
    return wiring(variant).state.paths + tuple(f"waves.{name}" for name in Waves._fields)


def run(
    job: Job,
    variant: Variant,
    misfit: Misfit | None = None,
    precision: Precision = Precision.F64,
    traced: bool = False,
    threads: int = 1,
    *,
    injected_only: bool = False,
    same_bits: bool = False,
) -> tuple[Outcome, Floats]:
    """Run all blocks of a job.

    `misfit` (Misfit, optional): samples to compare with; `traced`: keep the state after every step; `threads`: the
    result does not depend on it; `injected_only`: a traced run keeps only the injected mass: one row, about a
    hundredth of the memory.

    Returns `outcome` Outcome; `trace` (blocks, steps + 1, rows, lanes), empty unless traced: the last block is
    truncated to its used lanes.
    """
    n, lanes = job.points.shape
    loop, vector, steps = load_loop(variant, precision, same_bits), VECTORS[precision], job.courses.steps
    samples = _no_samples(len(steps)) if misfit is None else misfit.samples(job.dt, steps)
    out = np.empty((n, lanes, len(Outcome._fields)))
    rows = 1 if injected_only else len(trace_paths(variant))
    trace_shape = (int(steps.max()) + 1, rows, min(lanes, len(job.theta) * len(steps)))
    trace = np.full((n, *trace_shape) if traced else (0, 0, 0, 0), np.nan)
    threads = min(threads, n)
    arguments = LoopArguments(
        shape=shape_of(variant, vector),
        job=job,
        samples=samples,
        trace=trace,
        out=out,
        scratch=(),
        first=0,
        stride=threads,
    )
    side_by_side(lambda first: _call(loop, arguments._replace(first=first), vector.real), range(threads))
    return Outcome(*np.moveaxis(tabulate(out, job), 2, 0)), trace


def _call(loop: MachineCode, arguments: LoopArguments, real: Any) -> None:
    """Run the loop of one thread, without Python's global lock."""
    table, referenced_arrays = fill(
        LOOP_ARGUMENTS, arguments._replace(scratch=scratch_for(arguments.shape, arguments.job.ring, real)), real
    )
    ended = np.zeros(2, np.int64)  # return value, and unused room for an exception
    result = address(ended)
    if loop.call(result, result + 8, address(table)) or ended[0]:
        raise SimulationError("The machine code of the fast engine was made for another injector; report this.")
    del referenced_arrays


def tabulate(figures: Floats, job: Job) -> Floats:
    """Reorder figures of lanes from (blocks, lanes, …) to (candidates, points, …)."""
    table = np.empty((len(job.theta), len(job.courses.steps), *figures.shape[2:]))
    table[job.candidates, job.points] = figures  # lanes that fill up a block repeat the figures of another
    return table
