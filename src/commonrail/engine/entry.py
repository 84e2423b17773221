"""The loop over blocks as one function of a table: see `engine.job`. It loads Numba."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from commonrail.compiler.numba import exchange_rounding, widest_vectors
from commonrail.engine.block import make_blocks, shape_of
from commonrail.engine.feed import ClockedMemory
from commonrail.engine.job import GIVEN, Array, Vector
from commonrail.engine.recorder import Outcome
from commonrail.physics.law import FLUSH_TINY, KEEP_ALL, KEEP_NONE
from commonrail.physics.variants import Variant

REFUSED = 1


def table_reader(real: Any) -> Any:
    """Intrinsic (table) → `Given`: arrays as views of the memory that the table names."""
    kind = _type_of(GIVEN, real)

    @intrinsic
    def read(typing: Any, table: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            def entries() -> Iterator[Any]:
                place = 0
                while True:
                    yield builder.load(builder.gep(arguments[0], [cgutils.intp_t(place)]))
                    place += 1

            return _value_of(context, builder, kind, entries())

        return kind(table), generate

    return read


def _type_of(described: Any, real: Any) -> Any:
    """Numba's type of what `GIVEN` describes."""
    if isinstance(described, Array):
        number = real if described.kind == "real" else described.kind
        return types.Array(getattr(types, np.dtype(number).name), described.dimensions, "C")
    if isinstance(described, tuple):
        return types.NamedTuple([_type_of(inner, real) for inner in described], type(described))
    return types.float64 if described == "real" else types.int64


def _value_of(context: Any, builder: Any, kind: Any, entries: Iterator[Any]) -> Any:
    """Value of a type from the next entries of the table; `entries`: it gives each entry once, in order."""
    if isinstance(kind, types.Array):
        return _array(context, builder, kind, entries)
    if isinstance(kind, types.NamedTuple):
        return context.make_tuple(builder, kind, [_value_of(context, builder, inner, entries) for inner in kind])
    entry = next(entries)
    return builder.bitcast(entry, context.get_value_type(kind)) if kind == types.float64 else entry


def _array(context: Any, builder: Any, kind: Any, entries: Iterator[Any]) -> Any:
    """Array whose address and lengths are the next entries."""
    array, number = make_array(kind)(context, builder), context.get_data_type(kind.dtype)
    size = cgutils.intp_t(context.get_abi_sizeof(number))
    data = builder.inttoptr(next(entries), number.as_pointer())
    lengths = [next(entries) for _ in range(kind.ndim)]
    strides: list[Any] = []
    stride = size
    for length in reversed(lengths):
        strides.insert(0, stride)
        stride = builder.mul(stride, length)
    populate_array(array, data=data, shape=lengths, strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()


@cache
def make_entry(variant: Variant, vector: Vector) -> Callable[..., int]:
    """Function (table) that simulates the blocks of a table; `REFUSED` if the table was made for another kernel.

    One for all who ask, so that it is typed once for several processors.
    """
    read, simulate, figures = table_reader(vector.real), make_blocks(variant, vector), len(Outcome._fields)
    rows, lanes, columns, size = shape_of(variant, vector)

    def entry(table):  # type: ignore[no-untyped-def]
        widest_vectors()
        shape, job, samples, trace, out, scratch, first, stride = read(table)
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

    return entry
