"""The loop that one CUDA thread runs: one candidate at one operating point.

Functions of `block` for a block of one lane, with laws from the same source. Working rows are a
local array: every law is inlined and reads them at constant places, and the compiler splits the array into
registers. The rings of the waves lie in the device's memory, slot after slot with all threads side by
side: a warp reads neighbouring numbers. All data of the loop have the precision of the computation; with single
precision a step touches no double.

Import it only after `cuda.missing` has found Numba's CUDA target or its simulator.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import cuda

from commonrail.base.choices import Precision
from commonrail.compiler.laws import offer_overloads
from commonrail.engine.block import (
    INPUTS,
    Inlets,
    Machine,
    Memory,
    any_number,
    copy_number,
    gather_number,
    make_simulate,
)
from commonrail.engine.job import VECTORS, Job, Samples, make_rows
from commonrail.engine.recorder import at, record
from commonrail.physics.law import physics
from commonrail.physics.model import Inputs
from commonrail.physics.variants import Variant


class Table(NamedTuple):
    """`Courses` with all inputs: settings (points, 3), steps and earliest_end (points,), inputs (points, steps, 6)."""

    settings: Any
    steps: Any
    earliest_end: Any
    inputs: Any


@functools.cache
def compile_kernel(variant: Variant, precision: Precision, traced: bool) -> Any:
    """Kernel of a variant, compiled for the device of this process at its first call."""
    march = make_march(variant, precision, traced)
    if numba.config.ENABLE_CUDASIM:
        return cuda.jit(march)
    open_device()
    # lto: tests can inspect the PTX without a device
    return cuda.jit(signature(precision), lto=False)(march)


@functools.cache
def open_device() -> None:
    """Let CUDA kernels inline the laws; fast-math stays off, except "contract", which the compiler uses by itself."""
    from numba.cuda.extending import overload

    offer_overloads(functools.partial(overload, jit_options={"forceinline": True}, strict=False))


def signature(precision: Precision) -> Any:
    """Types of the kernel's arguments."""
    real, integer = numba.from_dtype(np.dtype(VECTORS[precision].real)), numba.int64
    named_tuple = numba.types.NamedTuple
    courses = named_tuple((real[:, ::1], integer[::1], integer[::1], real[:, :, ::1]), Table)
    job = named_tuple((real[:, ::1], courses, integer[:, ::1], integer[:, ::1], real, integer, integer, integer), Job)
    samples = named_tuple((integer[::1], integer[:, ::1], real[:, :, ::1], real[:, ::1]), Samples)
    return numba.void(job, samples, real[:, ::1], real[:, :, :, ::1], real[:, ::1])


def make_table_reader(rows: Any) -> Inlets:
    """Make inlets from a `Table`."""
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
    """No-op replacement for `keep_state` if no trace is recorded."""


@physics
def keep_state(work, rows, trace, thread, k):  # type: ignore[no-untyped-def]
    """Copy state and leaving waves of step k into the trace."""
    record(work, rows, trace[thread, k])


def make_march(variant: Variant, precision: Precision, traced: bool) -> Callable[..., Any]:
    """Make the loop over the steps; arguments as in `signature`. It has no constants of its own: see `physics`.

    `traced`: keep the state after every step.
    """
    rows, real = make_rows(variant, 1), VECTORS[precision].real
    keep = keep_state if traced else keep_nothing
    machine = Machine(real, copy_number, gather_number, any_number, make_table_reader, keep)
    simulate, count, kind = make_simulate(variant, rows, machine), rows.end, numba.from_dtype(np.dtype(real))

    def march(job, samples, rings, trace, out):  # type: ignore[no-untyped-def]
        thread = cuda.grid(1)
        if thread < job.points.shape[0]:
            memory = Memory(cuda.local.array(count, kind), rings[:, thread], job.ring, None)
            simulate(memory, job, samples, thread, trace, out[thread : thread + 1])

    return march
