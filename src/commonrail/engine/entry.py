"""The loop over blocks as one function of a table, see `engine.job`, and its operations on whole vector registers.

It loads Numba. A vector that is loaded from where its numbers were stored one by one waits until they have left the
processor: a row that the step reads is stored as one vector.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np
from llvmlite import ir as llvm_ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from commonrail.compiler.numba import exchange_rounding, widest_vectors
from commonrail.engine.block import ClockedMemory, Law, Machine, keep_if_asked, make_clocks, make_simulate
from commonrail.engine.job import GIVEN, Array, Vector
from commonrail.engine.recorder import Outcome, make_rows, shape_of
from commonrail.physics.law import FLUSH_TINY, KEEP_ALL, KEEP_NONE
from commonrail.physics.variants import Variant


def row_copier(lanes: int) -> Callable[..., None]:
    """Function (target, to, source, first) that copies `lanes` numbers as one vector."""

    @intrinsic
    def copy(typing: Any, target: Any, to: Any, source: Any, first: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            number = context.get_value_type(target.dtype)
            vector, size = llvm_ir.VectorType(number, lanes), context.get_abi_sizeof(number)

            def place(kind: Any, array: Any, index: Any) -> Any:
                data = context.make_array(kind)(context, builder, array).data
                return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())

            row = builder.load(place(source, arguments[2], arguments[3]), align=size)
            builder.store(row, place(target, arguments[0], arguments[1]), align=size)
            return context.get_dummy_value()

        return types.none(target, types.intp, source, types.intp), generate

    return copy  # type: ignore[no-any-return]


def row_gatherer(lanes: int) -> Callable[..., None]:
    """Function (target, to, source, where) that gathers a row as one vector, each lane from a row of its own.

    With `where` = (place, first, now, mask) lane i is read from row `first` + ((`now` − delay) & `mask`) of the source,
    its delay being number `place` + i of the target, a whole one.
    """

    @intrinsic
    def gather(typing: Any, target: Any, to: Any, source: Any, where: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            number, whole = context.get_value_type(target.dtype), context.get_value_type(types.intp)
            vector, size = llvm_ir.VectorType(number, lanes), context.get_abi_sizeof(number)
            into, drawn = (
                context.make_array(kind)(context, builder, value).data
                for kind, value in ((target, arguments[0]), (source, arguments[2]))
            )
            place, first, now, mask = cgutils.unpack_tuple(builder, arguments[3], 4)
            row = llvm_ir.Constant(vector, llvm_ir.Undefined)
            for lane in range(lanes):
                delay = builder.fptosi(builder.load(builder.gep(into, [builder.add(place, whole(lane))])), whole)
                slot = builder.add(builder.and_(builder.sub(now, delay), mask), first)
                found = builder.load(builder.gep(drawn, [builder.add(builder.mul(slot, whole(lanes)), whole(lane))]))
                row = builder.insert_element(row, found, llvm_ir.IntType(32)(lane))
            there = builder.bitcast(builder.gep(into, [arguments[1]]), vector.as_pointer())
            builder.store(row, there, align=size)
            return context.get_dummy_value()

        return types.none(target, types.intp, source, types.UniTuple(types.intp, 4)), generate  # type: ignore[attr-defined]

    return gather  # type: ignore[no-any-return]


def clock_reader(lanes: int) -> Callable[..., None]:
    """Function (target, to, origins, first, now) that stores the time `now` less the origins of `lanes` as one vector.

    The difference is taken in double precision, and then put into the precision of the target.
    """

    @intrinsic
    def read(typing: Any, target: Any, to: Any, origins: Any, first: Any, now: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            double, number = (context.get_value_type(kind.dtype) for kind in (origins, target))
            given, kept = (llvm_ir.VectorType(kind, lanes) for kind in (double, number))
            into, begun = (
                context.make_array(kind)(context, builder, value).data
                for kind, value in ((target, arguments[0]), (origins, arguments[2]))
            )
            place = builder.bitcast(builder.gep(begun, [arguments[3]]), given.as_pointer())
            all_now = llvm_ir.Constant(given, llvm_ir.Undefined)
            for lane in range(lanes):
                all_now = builder.insert_element(all_now, arguments[4], llvm_ir.IntType(32)(lane))
            since = builder.fsub(all_now, builder.load(place, align=context.get_abi_sizeof(double)))
            row = since if number == double else builder.fptrunc(since, kept)
            there = builder.bitcast(builder.gep(into, [arguments[1]]), kept.as_pointer())
            builder.store(row, there, align=context.get_abi_sizeof(number))
            return context.get_dummy_value()

        return types.none(target, types.intp, origins, types.intp, types.float64), generate

    return read  # type: ignore[no-any-return]


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
        return types.NamedTuple([_type_of(inner, real) for inner in described], type(described))  # type: ignore[attr-defined]
    return types.float64 if described == "real" else types.int64


def _value_of(context: Any, builder: Any, kind: Any, entries: Iterator[Any]) -> Any:
    """Value of a type from the next entries of the table; `entries`: it gives each entry once, in order."""
    if isinstance(kind, types.Array):
        return _array(context, builder, kind, entries)
    if isinstance(kind, types.NamedTuple):  # type: ignore[attr-defined]
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


def make_blocks(variant: Variant, vector: Vector) -> Law:
    """Function (memory, job, samples, block, trace, out) of `make_simulate` for lanes that are vectors."""
    rows, lanes = make_rows(variant, vector.lanes), vector.lanes
    clocks = partial(make_clocks, read=clock_reader(lanes))
    copy, gather = row_copier(lanes), row_gatherer(lanes)
    return make_simulate(variant, rows, Machine(vector.real, copy, gather, clocks, keep_if_asked, widest_vectors))


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
