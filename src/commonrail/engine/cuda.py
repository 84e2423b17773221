"""The engine for NVIDIA GPUs: a thread for each candidate at each operating point.

The same laws and the same loop as those of the lanes, compiled by numba-cuda; populations go to the device in parts
that its memory holds. Nothing of CUDA is imported before it is asked for.
"""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import cuda

from commonrail.base.arrays import Floats
from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.compiler.numba import offer_overloads
from commonrail.engine.block import FUEL, INPUTS, Machine, any_vectors, make_simulate
from commonrail.engine.feed import Inlets, Memory, copy_number, gather_number
from commonrail.engine.job import Job, Samples
from commonrail.engine.lanes import VECTORS, Misfit, tabled, trace_paths
from commonrail.engine.recorder import Outcome, at, make_rows, record
from commonrail.physics.law import physics
from commonrail.physics.model import Inputs
from commonrail.physics.variants import Variant, wiring

# A thread takes nearly all the registers that one may have, so that a multiprocessor holds 8 warps in any case:
# small groups of threads end sooner where their needles close early.
GROUP = 64
SHARE = 0.5  # of the device's free memory for rings and traces
INSTALL = "install it with: pip install 'commonrail[cuda]'"


def missing() -> str | None:
    """Sentence on the requirement of this engine that this machine lacks; None if it can be used."""
    import numba

    if numba.config.ENABLE_CUDASIM:
        return None
    if importlib.util.find_spec("numba_cuda") is None:
        return f'The engine "cuda" needs the package numba-cuda; {INSTALL}.'
    library = _missing_library()
    if library is not None:
        return f'The engine "cuda" needs NVIDIA\'s library {library}, which was not found; {INSTALL}.'
    from numba import cuda

    if not cuda.is_available():
        return 'The engine "cuda" needs an NVIDIA GPU with its driver, and none was found; use the engine "lanes".'
    return None


def _missing_library() -> str | None:
    """The first library of NVIDIA's compiler that is not to be found."""
    from cuda.pathfinder import DynamicLibNotFoundError, load_nvidia_dynamic_lib

    for name in ("nvvm", "nvrtc"):
        try:
            load_nvidia_dynamic_lib(name)
        except DynamicLibNotFoundError:
            return name
    return None


def require_device() -> None:
    """Refuse a machine on which this engine cannot run.

    Raises
    ------
    ConfigurationError
        That says what is missing.
    """
    sentence = missing()
    if sentence is not None:
        raise ConfigurationError(sentence)


def run(
    job: Job,
    variant: Variant,
    misfit: Misfit | None = None,
    precision: Precision = Precision.F64,
    traced: bool = False,
) -> tuple[Outcome, Floats]:
    """Run all blocks of a job, each of one lane.

    Parameters
    ----------
    job, variant, misfit, precision, traced
        As of `lanes.run`.

    Raises
    ------
    ConfigurationError
        If the device failed. Whether there is one is for the caller to ask, before any other work.
    """
    from numba.cuda.cudadrv.driver import CudaAPIError

    try:
        return _launch(job, variant, misfit, precision, traced)
    except CudaAPIError as error:
        raise ConfigurationError(f'The GPU failed ({error}); use the engine "lanes".') from None


def _launch(
    job: Job, variant: Variant, misfit: Misfit | None, precision: Precision, traced: bool
) -> tuple[Outcome, Floats]:
    from numba import cuda

    kernel = compiled(variant, precision, traced)
    real = VECTORS[precision].real
    steps = job.courses.steps
    samples = _to_device(cuda, (misfit or Misfit.none(len(steps))).samples(job.dt, steps), real)
    courses = Table(job.courses.settings, steps, job.courses.earliest_end, job.courses.inputs)
    given = _to_device(cuda, job._replace(courses=courses, points=job.points[:0], candidates=job.candidates[:0]), real)
    slots = max(3 * job.ring, len(wiring(variant).parameters.paths) + len(FUEL.paths))
    paths, n = len(trace_paths(variant)), len(job.points)
    stored = (int(steps.max()) + 1, paths, 1) if traced else (0, 0, 0)
    many = _at_a_time(cuda, n, (slots + int(np.prod(stored))) * np.dtype(real).itemsize)
    rings = cuda.device_array((slots, many), real)
    out, trace = np.empty((n, len(Outcome._fields)), real), np.full((n if traced else 0, *stored), np.nan, real)
    for first in range(0, n, many):
        part = slice(first, first + many)
        points, candidates = (cuda.to_device(np.ascontiguousarray(a[part])) for a in (job.points, job.candidates))
        states, figures = cuda.to_device(trace[part]), cuda.device_array((len(points), out.shape[1]), real)
        own = given._replace(points=points, candidates=candidates)
        kernel[-(-len(points) // GROUP), GROUP](own, samples, rings, states, figures)
        out[part], trace[part] = figures.copy_to_host(), states.copy_to_host()
    return Outcome(*np.moveaxis(tabled(out[:, None], job), 2, 0)), trace.astype(float)


def _to_device(cuda: Any, given: Any, real: Any) -> Any:
    """A named tuple with its arrays on the device, and all floats in the numbers of the kernel."""
    if isinstance(given, tuple):
        return given._make(_to_device(cuda, part, real) for part in given)  # type: ignore[attr-defined]
    if isinstance(given, np.ndarray):
        return cuda.to_device(np.ascontiguousarray(given, real if given.dtype == np.float64 else np.int64))
    return real(given) if isinstance(given, float) else given


def _at_a_time(cuda: Any, count: int, size: int) -> int:
    """Threads of a launch: whole groups, as many as the device's memory holds."""
    free, _ = cuda.current_context().get_memory_info()
    return GROUP * int(max(min(-(-count // GROUP), SHARE * free / (size * GROUP)), 1))


# The loop that one CUDA thread runs: one candidate at one operating point.
#
# The functions are those of `block`, for a block of one lane, and the laws are the same source. Working rows are a
# local array: every law is inlined and reads them at constant places, so that the compiler takes the array apart and
# keeps it in registers. The rings of the waves lie in the device's memory, slot after slot with all threads side by
# side: a warp reads neighbouring numbers. Whatever the loop reads is in the numbers that it computes in; with single
# precision no double is touched in a step.
#
# Import it only where Numba's CUDA target or its simulator is known to be there: see `cuda.missing`.


class Table(NamedTuple):
    """`Courses` with all inputs: settings (points, 3), steps and earliest_end (points,), inputs (points, steps, 6)."""

    settings: Any
    steps: Any
    earliest_end: Any
    inputs: Any


@functools.cache
def compiled(variant: Variant, precision: Precision, traced: bool) -> Any:
    """The kernel of a variant, compiled for the device of this process at its first call.

    Parameters
    ----------
    variant, precision, traced
        As of `make_march`.
    """
    march = make_march(variant, precision, traced)
    if numba.config.ENABLE_CUDASIM:
        return cuda.jit(march)
    open_device()
    # lto: PTX is what the tests can look at without a device
    return cuda.jit(signature(precision), lto=False)(march)


@functools.cache
def open_device() -> None:
    """Let CUDA kernels inline the laws; fast-math stays off: of its parts the compiler uses "contract" by itself."""
    from numba.cuda.extending import overload

    offer_overloads(functools.partial(overload, jit_options={"forceinline": True}, strict=False))


def signature(precision: Precision) -> Any:
    """Types of the kernel's arguments."""
    real, whole = numba.from_dtype(np.dtype(VECTORS[precision].real)), numba.int64
    named = numba.types.NamedTuple
    courses = named((real[:, ::1], whole[::1], whole[::1], real[:, :, ::1]), Table)
    job = named((real[:, ::1], courses, whole[:, ::1], whole[:, ::1], real, whole, whole, whole), Job)
    samples = named((whole[::1], whole[:, ::1], real[:, :, ::1], real[:, ::1]), Samples)
    return numba.void(job, samples, real[:, ::1], real[:, :, :, ::1], real[:, ::1])


def make_table_reader(rows: Any) -> Inlets:
    """Inlets from a `Table`."""
    store = INPUTS.store

    @physics
    def point_of(courses, points):  # type: ignore[no-untyped-def]
        return points[0]

    @physics
    def read(memory, courses, row, k):  # type: ignore[no-untyped-def]
        x = courses.inputs[row, k]
        store(memory.work, at(rows, rows.inputs, 0), rows.lanes, Inputs(x[0], x[1], x[2], x[3], x[4], x[5]))

    @physics
    def turn_nothing(memory, courses, points, k):  # type: ignore[no-untyped-def]
        return k

    @physics
    def follow_nothing(memory, courses, points, k):  # type: ignore[no-untyped-def]
        return

    @physics
    def is_traced(courses, points):  # type: ignore[no-untyped-def]
        return False

    return Inlets(point_of, read, turn_nothing, follow_nothing, is_traced, -1)


@physics
def keep_nothing(work, rows, trace, thread, k):  # type: ignore[no-untyped-def]
    """In place of `keep_state`."""


@physics
def keep_state(work, rows, trace, thread, k):  # type: ignore[no-untyped-def]
    """Copy state and leaving waves of step k into the trace."""
    record(work, rows, trace[thread, k])


def make_march(variant: Variant, precision: Precision, traced: bool) -> Callable[..., Any]:
    """The loop over the steps; arguments as in `signature`. It has no constants of its own: see `physics`.

    Parameters
    ----------
    variant : Variant
    precision : Precision
    traced : bool
        Keep the state after every step.
    """
    rows, real = make_rows(variant, 1), VECTORS[precision].real
    keep = keep_state if traced else keep_nothing
    machine = Machine(real, copy_number, gather_number, make_table_reader, keep, any_vectors)
    simulate, count, kind = make_simulate(variant, rows, machine), rows.end, numba.from_dtype(np.dtype(real))

    def march(job, samples, rings, trace, out):  # type: ignore[no-untyped-def]
        thread = cuda.grid(1)
        if thread < job.points.shape[0]:
            memory = Memory(cuda.local.array(count, kind), rings[:, thread], job.ring)
            simulate(memory, job, samples, thread, trace, out[thread : thread + 1])

    return march
