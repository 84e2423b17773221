"""The loop of the lanes for a single lane, whose caller owns the memory and the inputs of the next steps."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.compiler.cache import Source
from commonrail.compiler.load import Kernel
from commonrail.engine.block import MARCH
from commonrail.engine.courses import MAXIMUM_STEPS
from commonrail.engine.job import FUEL, make_rows
from commonrail.engine.operating_point import Course, OperatingPoint, Trace
from commonrail.engine.plan import Prepared, make_job, prepare
from commonrail.engine.status import check_inputs
from commonrail.physics.injector import Injector
from commonrail.physics.variants import DRIVE, Variant, kernel_name, unread_inputs, wiring


class CoursePlan:
    """Inputs planned by the operating point, for any step of `dt` [s], also beyond its horizon.

    `prepared` belongs to the point, with a trace of zeros if the caller supplies the drive's trace.
    """

    def __init__(self, injector: Injector, point: OperatingPoint, dt: float) -> None:
        check_inputs(injector, point)
        traced = DRIVE not in unread_inputs(injector.variant)
        if traced and point.drive is None:
            point = replace(point, drive=Trace((point.start, point.start + 1.0), (0.0, 0.0)))
        self.prepared: Prepared = prepare(injector, [point], dt)
        self._courses: tuple[Course | None, ...] = (
            point.rail_pressure,
            point.cylinder_pressure,
            point.return_pressure,
            point.drive if traced else None,
        )
        self._table: Floats = self.prepared.courses.inputs[0]

    @property
    def ring(self) -> int:
        """Slots of the rings of waves, enough for any number of steps."""
        courses = self.prepared.courses._replace(steps=np.array([MAXIMUM_STEPS]))
        return make_job(self.prepared._replace(courses=courses), self.prepared.row[None], False, 1).ring

    def instants(self, first: int, count: int) -> Floats:
        """Starts of steps [s]."""
        return np.asarray(self.prepared.begin[0] + self.prepared.dt * np.arange(first, first + count))

    def inputs(self, first: int, count: int) -> Floats:
        """Inputs of steps `first` to `first` + `count` − 1: (steps, 6)."""
        last = len(self._table) - 1
        steps = np.arange(first, first + count)
        rows: Floats = self._table[np.minimum(steps, last)]
        beyond = steps > last
        if beyond.any():
            dt, begin = self.prepared.dt, self.instants(first, count)[beyond]
            for column, course in enumerate(self._courses):
                if isinstance(course, Trace):
                    rows[beyond, column] = course.mean(begin, begin + dt)
            if self.prepared.points[0].pulses:
                rows[beyond, 4:] += (dt * (steps[beyond] - last))[:, None]
        return rows


class Loop(NamedTuple):
    """Compiled functions of a variant, and the layout of its memory."""

    # function (memory, ring, first, theta, settings, inputs): without `inputs` it puts the memory to rest, else it
    # takes one step for each row of them, the first of them with the number `first`
    march: Callable[..., Any]
    rows: Any
    # names of the rows of the state, which begin at `rows.state`; after them are the three leaving waves
    state: tuple[str, ...]
    parameters: int  # length of `theta`

    def size(self, ring: int) -> int:
        """Numbers in the memory of an injector for a number of slots in its rings."""
        return int(self.rows.end) + max(3 * ring, self.parameters)


@functools.cache
def make_loop(variant: Variant) -> Loop:
    """`Loop` of a variant, compiled (or loaded from the cache) at its first call."""
    wired, rows = wiring(variant), make_rows(variant, 1)
    source = Source("commonrail.engine.block:march_entries", variant.words, "f64", kernel_name(variant))
    march = Kernel(source, "march", MARCH)
    return Loop(
        lambda *arguments: march(*arguments, np.empty((1, 12))),
        rows,
        wired.state.paths,
        len(wired.parameters.paths) + len(FUEL.paths),
    )
