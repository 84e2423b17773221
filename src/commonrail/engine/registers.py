"""Operations on rows of lanes as whole vector registers.

A vector that is loaded from where its numbers were stored one by one waits until they have left the processor: a row
that the step reads is stored as one vector.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir as llvm_ir
from numba.core import cgutils, types
from numba.extending import intrinsic


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
