"""The loop that one CUDA thread runs: one candidate at one operating point.

The functions are those of `block`, for a block of one lane, and the laws are the same source. Working rows are a
local array: every law is inlined and reads them at constant places, so that the compiler takes the array apart and
keeps it in registers. The rings of the waves lie in the device's memory, slot after slot with all threads side by
side: a warp reads neighbouring numbers. Whatever the loop reads is in the numbers that it computes in; with single
precision no double is touched in a step.

Import it only where Numba's CUDA target or its simulator is known to be there: see `cuda.missing`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba import cuda

from commonrail.choices import Precision
from commonrail.compile import offer_laws, physics
from commonrail.engine.block import (
    copy_number,
    look,
    make_advance,
    make_begin,
    make_ferry,
    make_rows,
    record,
    report_rest,
    sample,
    set_densities,
)
from commonrail.engine.lanes import VECTORS
from commonrail.injector.model import Inputs, Setting
from commonrail.injector.variants import Variant


@functools.cache
def compiled(variant: Variant, precision: Precision, traced: bool) -> Any:
    """The kernel of a variant, compiled for the device of this process at its first call."""
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

    offer_laws(functools.partial(overload, jit_options={"forceinline": True}, strict=False))


def signature(precision: Precision) -> Any:
    """Types of the kernel's arguments."""
    real, whole = numba.from_dtype(np.dtype(VECTORS[precision].real)), numba.int64
    job = (real[:, ::1], real[:, ::1], real[:, :, ::1], whole[::1], whole[::1], whole[:, ::1])
    samples = (whole[::1], whole[:, ::1], real[:, :, ::1], real[:, ::1])
    return numba.void(*job, real, whole, whole, whole, *samples, real[:, ::1], real[:, :, :, ::1], real[:, ::1])


@physics
def keep_nothing(work, rows, trace, thread, k):  # type: ignore[no-untyped-def]
    """In place of `keep_state`."""


@physics
def keep_state(work, rows, trace, thread, k):  # type: ignore[no-untyped-def]
    """Copy state and leaving waves of step k into the trace."""
    record(work, rows, trace[thread, k])


def make_march(variant: Variant, precision: Precision, traced: bool) -> Callable[..., Any]:
    """The loop over the steps; arguments as in `signature`. It has no constants of its own: see `physics`."""
    rows, real = make_rows(variant, 1), VECTORS[precision].real
    begin, advance = make_begin(variant, rows), make_advance(variant, rows)
    arrive, leave = make_ferry(rows, copy_number)
    keep = keep_state if traced else keep_nothing
    count, kind = rows.end, numba.from_dtype(np.dtype(real))

    def march(  # type: ignore[no-untyped-def]
        theta, settings, inputs, steps, quiet, blocks, step_size, ring, look_every, patience,
        bound_count, due, samples, density, rings, trace, out,
    ):  # fmt: skip
        thread = cuda.grid(1)
        if thread >= blocks.shape[0]:
            return
        work = cuda.local.array(count, kind)
        waves, figures = rings[:, thread], out[thread : thread + 1]
        point = blocks[thread, 0]
        setting = Setting(settings[point, 0], settings[point, 1], settings[point, 2], step_size)
        begin(work, waves, ring, theta, blocks[thread], setting, figures)
        set_densities(work, rows, blocks[thread], density, point)
        keep(work, rows, trace, thread, 0)
        bound = 0
        for k in range(steps[point]):
            x = inputs[point, k]
            u = Inputs(x[0], x[1], x[2], x[3], x[4], x[5])
            arrive(work, waves, ring, k, True)
            advance(work, real(k + 1), u, step_size)
            leave(work, waves, ring, k)
            while bound < bound_count[point] and due[point, bound] <= k:
                s = samples[point, bound]
                sample(work, rows, s[0], s[1], s[2], s[3], bound == 0)
                bound += 1
            keep(work, rows, trace, thread, k + 1)
            if k % look_every == look_every - 1:  # noqa: SIM102
                if look(work, rows, u.cylinder, k >= quiet[point], patience, look_every, figures):
                    break
        report_rest(work, rows, inputs[point, steps[point] - 1, 1], figures)

    return march
