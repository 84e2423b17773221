"""The engine for NVIDIA GPUs: one thread for each candidate at each operating point.

It compiles the laws and the loop of the lanes with numba-cuda. Populations go to the device in parts
that fit its memory. CUDA is imported on first use.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.engine.job import FUEL, VECTORS, Job, Outcome
from commonrail.engine.lanes import Misfit, tabulate, trace_paths
from commonrail.physics.variants import Variant, wiring

# A thread takes nearly all registers available to it, and a multiprocessor holds 8 warps with any group size: small
# groups of threads end sooner if their needles close early.
GROUP = 64
SHARE = 0.5  # share of the device's free memory used for ring buffers and traces
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
    """First missing library of NVIDIA's compiler."""
    from cuda.pathfinder import DynamicLibNotFoundError, load_nvidia_dynamic_lib

    for name in ("nvvm", "nvrtc"):
        try:
            load_nvidia_dynamic_lib(name)
        except DynamicLibNotFoundError:
            return name
    return None


def require_device() -> None:
    """Refuse a machine on which this engine cannot run.

    `ConfigurationError` names the missing part.
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

    Arguments as in `lanes.run`. `ConfigurationError` if the device failed. The caller checks beforehand that there is
    a device.
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

    from commonrail.engine import cuda_kernel

    kernel = cuda_kernel.compile_kernel(variant, precision, traced)
    real = VECTORS[precision].real
    steps = job.courses.steps
    samples = _to_device(cuda, (misfit or Misfit.none(len(steps))).samples(job.dt, steps), real)
    courses = cuda_kernel.Table(job.courses.settings, steps, job.courses.earliest_end, job.courses.inputs)
    device_job = _to_device(
        cuda, job._replace(courses=courses, points=job.points[:0], candidates=job.candidates[:0]), real
    )
    slots = max(3 * job.ring, len(wiring(variant).parameters.paths) + len(FUEL.paths))
    paths, n = len(trace_paths(variant)), len(job.points)
    stored = (int(steps.max()) + 1, paths, 1) if traced else (0, 0, 0)
    many = _at_a_time(cuda, n, (slots + int(np.prod(stored))) * np.dtype(real).itemsize)
    rings = cuda.device_array((slots, many), real)
    out, trace = np.empty((n, len(Outcome._fields)), real), np.full((n if traced else 0, *stored), np.nan, real)
    for first in range(0, n, many):
        launch = slice(first, first + many)
        points, candidates = (cuda.to_device(np.ascontiguousarray(a[launch])) for a in (job.points, job.candidates))
        states, figures = cuda.to_device(trace[launch]), cuda.device_array((len(points), out.shape[1]), real)
        launch_job = device_job._replace(points=points, candidates=candidates)
        kernel[-(-len(points) // GROUP), GROUP](launch_job, samples, rings, states, figures)
        out[launch], trace[launch] = figures.copy_to_host(), states.copy_to_host()
    return Outcome(*np.moveaxis(tabulate(out[:, None], job), 2, 0)), trace.astype(float)


def _to_device(cuda: Any, value: Any, real: Any) -> Any:
    """Move the arrays of a named tuple to the device, with all floats in the precision of the kernel."""
    if isinstance(value, tuple):
        return value._make(_to_device(cuda, item, real) for item in value)  # type: ignore[attr-defined]
    if isinstance(value, np.ndarray):
        return cuda.to_device(np.ascontiguousarray(value, real if value.dtype == np.float64 else np.int64))
    return real(value) if isinstance(value, float) else value


def _at_a_time(cuda: Any, count: int, size: int) -> int:
    """Threads of a launch: whole groups, as many as the device's memory can hold."""
    free, _ = cuda.current_context().get_memory_info()
    return GROUP * int(max(min(-(-count // GROUP), SHARE * free / (size * GROUP)), 1))
