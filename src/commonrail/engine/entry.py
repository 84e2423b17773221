"""The loop over blocks as one function of a table, see `engine.job`. It loads Numba."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from commonrail.base.choices import Precision
from commonrail.compiler.laws import TABLE, clock_reader, exchange_rounding, of_table, row_copier, row_gatherer
from commonrail.engine.block import ClockedMemory, Machine, keep_if_asked, make_clocks, make_simulate
from commonrail.engine.job import GIVEN, VECTORS, Outcome, make_rows, shape_of
from commonrail.physics.law import FLUSH_TINY, KEEP_ALL, KEEP_NONE
from commonrail.physics.variants import Variant


def entries(precision: str, width: str, *words: str) -> dict[str, tuple[Callable[..., Any], Any]]:
    """Function of a table that simulates its blocks, of so many lanes and the `Variant` of the `words`.

    It returns 1 if the table was made for another kernel.
    """
    variant, vector = Variant(*words), VECTORS[Precision(precision)]._replace(lanes=int(width))
    rows, lanes, columns, size = shape_of(variant, vector)
    clocks = partial(make_clocks, read=clock_reader(lanes))
    machine = Machine(vector.real, row_copier(lanes), row_gatherer(lanes), clocks, keep_if_asked)
    simulate = make_simulate(variant, make_rows(variant, lanes), machine)
    figures = len(Outcome._fields)

    def blocks(shape, job, samples, trace, out, scratch, first, stride):  # type: ignore[no-untyped-def]
        if shape.rows != rows or shape.lanes != lanes or shape.columns != columns or shape.size != size:
            return 1
        if job.theta.shape[1] != columns or out.shape[1] != lanes or out.shape[2] != figures:
            return 1
        mode = exchange_rounding(FLUSH_TINY, KEEP_ALL)
        memory = ClockedMemory(scratch.work, scratch.waves, job.ring, scratch.origins)
        for block in range(first, job.points.shape[0], stride):
            simulate(memory, job, samples, block, trace, out[block])
        exchange_rounding(mode, KEEP_NONE)
        return 0

    return {"lanes": (of_table(blocks, tuple(GIVEN), vector.real), TABLE)}
