"""Laws for Numba: overloads by precision, arrays at given addresses, rows as vectors.

Only the child process that lowers laws (`lower`), CUDA kernels and tests import this module: loading Numba takes longer
than a simulation.
"""

from __future__ import annotations

import functools
import itertools
import platform
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from commonrail.compiler.table import REAL, Array
from commonrail.physics.law import CACHE_LINE, in_single, offer_laws, physics

# Freedoms of the compiler with sums and products, by kind of kernel. No "nnan"/"ninf": a diverging candidate must be
# recognised as non-finite. No "arcp" in single precision: a reciprocal would be the processor's estimate, which differs
# between makers. None in an exact kernel: processors round equally unless operations are fused or reordered.
FASTMATH: dict[str, set[str]] = {
    "f64": {"nsz", "arcp", "contract", "reassoc"},
    "f32": {"nsz", "contract", "reassoc"},
    "exact": set(),
}


def options(kind: str) -> dict[str, Any]:
    """Options of Numba for a kind of kernel: a key of `FASTMATH`."""
    return {"fastmath": FASTMATH[kind] or False, "error_model": "numpy"}


def is_single(kind: Any) -> bool:
    """Return whether a type is of single precision, or contains one."""
    if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]
        return any(map(is_single, kind))
    return (kind.dtype if isinstance(kind, types.Array) else kind) == types.float32


def by_precision(law: Callable[..., Any]) -> Callable[..., Any]:
    """Function that chooses a law, or its twin in single precision, by the types of the arguments.

    With single-precision arguments a law is compiled with single-precision constants: the constants of its text
    would be double, and promote everything they touch.
    """

    def choose(*arguments: Any, **keywords: Any) -> Callable[..., Any]:
        return in_single(law) if any(map(is_single, (*arguments, *keywords.values()))) else law

    return choose


def offer_overloads(declare: Callable[[Callable[..., Any]], Callable[..., Any]]) -> None:
    """Let a target of Numba inline all laws, including later ones.

    `declare` (function (law) -> decorator): Numba's `overload` of that target, with its options.
    """
    offer_laws(lambda law: declare(law)(by_precision(law)) and None)


@functools.cache
def declare_laws(kind: str) -> None:
    """Let kernels of this process inline all laws; `kind`: a key of `FASTMATH`, one for all kernels of a process."""
    inlined = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **options(kind)}
    offer_overloads(functools.partial(overload, jit_options=inlined, strict=False))


@intrinsic
def exchange_rounding(typing: Any, bits: Any, mask: Any) -> Any:
    """Set the processor's register of floating-point modes to (mode & kept) | bits; returns the mode before.

    Does nothing on processors other than x86.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = cgutils.alloca_once_value(builder, context.get_constant(types.int32, 0))
        place.align = CACHE_LINE  # also aligns the stack: an unaligned vector would straddle two cache lines
        if platform.machine() not in ("x86_64", "AMD64"):
            return builder.load(place)
        kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t])
        read, write = (
            cgutils.get_or_insert_function(builder.module, kind, f"llvm.x86.sse.{name}")
            for name in ("stmxcsr", "ldmxcsr")
        )
        builder.call(read, [builder.bitcast(place, cgutils.voidptr_t)])
        before = builder.load(place)
        builder.store(builder.or_(builder.and_(before, arguments[1]), arguments[0]), place)
        builder.call(write, [builder.bitcast(place, cgutils.voidptr_t)])
        return before

    return types.int32(types.int32, types.int32), generate


@intrinsic
def pointer(typing: Any, address: Any) -> Any:
    """Pointer of an address, for `numba.carray`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(address), generate  # type: ignore[attr-defined]


@intrinsic
def number(typing: Any, bits: Any) -> Any:
    """Real number of its 64 bits."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(bits), generate


# Operations on whole rows: loading a vector whose numbers were stored one by one waits until they have left the
# processor. Loops over lanes would cost 8 % in double and 30 % in single precision (Zen 3).


def _row(context: Any, builder: Any, kind: Any, at: Any, lanes: int, new: Any = None) -> Any:
    """Load a vector of `lanes` numbers; `at`: array and index of the first number. With `new`, store it there."""
    array, first = at
    data, number = context.make_array(kind)(context, builder, array).data, context.get_value_type(kind.dtype)
    place = builder.bitcast(builder.gep(data, [first]), ir.VectorType(number, lanes).as_pointer())
    size = context.get_abi_sizeof(number)
    if new is None:
        return builder.load(place, align=size)
    builder.store(new, place, align=size)
    return context.get_dummy_value()


def row_copier(lanes: int) -> Callable[..., None]:
    """Function (target, to, source, first) that copies `lanes` numbers as one vector."""

    @intrinsic
    def copy(typing: Any, target: Any, to: Any, source: Any, first: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            row = _row(context, builder, source, arguments[2:], lanes)
            return _row(context, builder, target, arguments[:2], lanes, row)

        return types.none(target, types.intp, source, types.intp), generate

    return copy  # type: ignore[no-any-return]


def row_tester(lanes: int) -> Callable[..., bool]:
    """Function (source, first) that is true if any of `lanes` numbers is not zero, as one vector."""

    @intrinsic
    def is_any(typing: Any, source: Any, first: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            row = _row(context, builder, source, arguments, lanes)
            bits = builder.bitcast(builder.fcmp_unordered("une", row, row.type(None)), ir.IntType(lanes))
            return builder.icmp_unsigned("!=", bits, bits.type(0))

        return types.boolean(source, types.intp), generate

    return is_any  # type: ignore[no-any-return]


def row_gatherer(lanes: int) -> Callable[..., None]:
    """Function (target, to, source, where) that gathers a row as one vector, each lane from a row of its own.

    With `where` = (place, first, now, mask), lane i is read from row `first` + ((`now` − delay) & `mask`) of the
    source. The delay is number `place` + i of the target, an integer.
    """

    @intrinsic
    def gather(typing: Any, target: Any, to: Any, source: Any, where: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            number, integer = context.get_value_type(target.dtype), context.get_value_type(types.intp)
            into = context.make_array(target)(context, builder, arguments[0]).data
            drawn = context.make_array(source)(context, builder, arguments[2]).data
            place, first, now, mask = cgutils.unpack_tuple(builder, arguments[3], 4)
            row = ir.Constant(ir.VectorType(number, lanes), ir.Undefined)
            for lane in range(lanes):
                delay = builder.fptosi(builder.load(builder.gep(into, [builder.add(place, integer(lane))])), integer)
                slot = builder.add(builder.and_(builder.sub(now, delay), mask), first)
                element = builder.load(
                    builder.gep(drawn, [builder.add(builder.mul(slot, integer(lanes)), integer(lane))])
                )
                row = builder.insert_element(row, element, ir.IntType(32)(lane))
            return _row(context, builder, target, arguments[:2], lanes, row)

        return types.none(target, types.intp, source, types.UniTuple(types.intp, 4)), generate  # type: ignore[attr-defined]

    return gather  # type: ignore[no-any-return]


def clock_reader(lanes: int) -> Callable[..., None]:
    """Function (target, to, origins, first, now) that stores the time `now` minus the origins of `lanes` as one vector.

    The difference is computed in double precision, and then converted to the precision of the target.
    """

    @intrinsic
    def read(typing: Any, target: Any, to: Any, origins: Any, first: Any, now: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            double, number = (context.get_value_type(kind.dtype) for kind in (origins, target))
            all_now = ir.Constant(ir.VectorType(double, lanes), ir.Undefined)
            for lane in range(lanes):
                all_now = builder.insert_element(all_now, arguments[4], ir.IntType(32)(lane))
            since = builder.fsub(all_now, _row(context, builder, origins, arguments[2:4], lanes))
            row = since if number == double else builder.fptrunc(since, ir.VectorType(number, lanes))
            return _row(context, builder, target, arguments[:2], lanes, row)

        return types.none(target, types.intp, origins, types.intp, types.float64), generate

    return read  # type: ignore[no-any-return]


TABLE = types.int64(types.CPointer(types.int64))  # type: ignore[attr-defined]


def of_table(function: Callable[..., Any], described: tuple[Any, ...], real: type = np.float64) -> Callable[..., Any]:
    """Function with one argument, a table that holds the described arguments; its signature is `TABLE`.

    `described`: description of each argument, see `load`; `real`: type of arrays of kind "real".
    """
    read, law = _reader(described, real), physics(function)

    def entry(table):  # type: ignore[no-untyped-def]
        return law(*read(table))

    return entry


def _reader(described: Any, real: type) -> Any:
    """Make the function (table) that returns the described arguments, arrays as views of the memory in the table."""
    names: dict[str, Any] = {"carray": numba.carray, "pointer": pointer, "number": number}
    text = _expression(described, np.dtype(real).name, names, itertools.count())
    exec(f"def read(table):\n    return {text}\n", names)
    return numba.njit(names["read"], error_model="numpy")


def _expression(described: Any, real: str, names: dict[str, Any], places: Iterator[int]) -> str:
    if isinstance(described, Array):
        kind = real if described.kind == REAL else described.kind
        names[kind] = getattr(np, kind)
        data, *lengths = (f"table[{next(places)}]" for _ in range(1 + described.dimensions))
        return f"carray(pointer({data}), ({', '.join(lengths)},), {kind})"
    if isinstance(described, tuple):
        parts = ", ".join(_expression(item, real, names, places) for item in described)
        if not hasattr(described, "_fields"):
            return f"({parts},)"
        names[type(described).__name__] = type(described)
        return f"{type(described).__name__}({parts})"
    entry = f"table[{next(places)}]"
    return f"number({entry})" if described == REAL else entry
