"""Compilation of the physics to machine code by Numba: the only file that names Numba flags.

Import it where something is compiled: loading Numba takes longer than a simulation. `kernel` compiles an outer loop and
keeps its machine code on disk (`jit_cache`); the lanes' loops are compiled by `commonrail.compiler.lower`.
"""

from __future__ import annotations

import contextlib
import functools
import platform
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numpy as np
from llvmlite import ir as llvm_ir
from numba.core import cgutils, types
from numba.extending import intrinsic, overload

from commonrail.compiler.numba_cache import KernelCache
from commonrail.physics.law import CACHE_LINE, in_single, offer_laws

# No "nnan"/"ninf": a candidate that blows up must be seen to be non-finite.
FASTMATH = {"nsz", "arcp", "contract", "reassoc"}
# Without "arcp": a reciprocal of single numbers would be the processor's estimate, and makers differ in it.
SINGLE_FASTMATH = FASTMATH - {"arcp"}
INLINED = {
    "forceinline": True,
    "fastmath": FASTMATH,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


def is_single(kind: Any) -> bool:
    """Return whether a type is of single precision, or holds one that is."""
    if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]
        return any(map(is_single, kind))
    return (kind.dtype if isinstance(kind, types.Array) else kind) == types.float32


def by_precision(law: Callable[..., Any]) -> Callable[..., Any]:
    """Function that chooses a law, or its twin in single precision, by the types of the arguments.

    Called with numbers of single precision, a law is compiled with constants of single precision: those of its text
    would be double, and draw everything that they touch along.
    """

    def choose(*arguments: Any, **named: Any) -> Callable[..., Any]:
        return in_single(law) if any(map(is_single, (*arguments, *named.values()))) else law

    return choose


def offer_overloads(declare: Callable[[Callable[..., Any]], Callable[..., Any]]) -> None:
    """Let one more target of Numba inline all laws, those to come too.

    Parameters
    ----------
    declare : function (law) -> decorator
        Numba's `overload` of that target, with its options.
    """
    offer_laws(lambda law: declare(law)(by_precision(law)) and None)


offer_overloads(functools.partial(overload, jit_options=INLINED, strict=False, target="cpu"))


@intrinsic
def exchange_rounding(typing: Any, bits: Any, kept: Any) -> Any:
    """Set the processor's register of floating-point modes to (mode & kept) | bits; returns the mode before.

    Elsewhere than on x86 it does nothing.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = cgutils.alloca_once_value(builder, context.get_constant(types.int32, 0))
        if platform.machine() not in ("x86_64", "AMD64"):
            return builder.load(place)
        kind = llvm_ir.FunctionType(llvm_ir.VoidType(), [cgutils.voidptr_t])
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
def widest_vectors(typing: Any) -> Any:
    """Ask LLVM for 512-bit vectors in the calling function, where it would prefer 256.

    Each function is optimised by itself before it is put into its caller: call it where the loop over lanes is, and
    around it.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # vectors that do not fit into registers are kept on the stack: unaligned they would straddle cache lines
        builder.function.attributes.alignstack = CACHE_LINE
        # llvmlite admits only attributes that it knows; LLVM takes any text
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.none(), generate


def kernel(
    loop: Callable[..., Any],
    name: str,
    laws: tuple[Callable[..., Any], ...] = (),
    real: type = np.float64,
) -> Any:
    """Compile an outer loop, releasing the GIL, with its machine code cached on disk.

    Parameters
    ----------
    loop : function
        The loop; it may be a closure over physics functions.
    name : str
        What distinguishes this closure from others of the same source line.
    laws : tuple of functions
        Functions from outside the package that `loop` calls: their source joins the cache stamp.
    real : type
        `numpy.float32` for a loop that computes in single precision.
    """
    if numba.config.DISABLE_JIT:
        return loop
    source = loop if real is np.float64 else in_single(loop)
    compiled = numba.njit(source, nogil=True, fastmath=FASTMATH, error_model="numpy")
    compiled._cache = KernelCache(name, laws)

    @functools.wraps(loop)
    def run(*arguments: Any) -> Any:
        if compiled.signatures:
            return compiled(*arguments)
        with _FIRST_CALL, compiler_choices(), contextlib.ExitStack() as waiting:
            compiled._cache.waiting = waiting
            return compiled(*arguments)

    run.compiled = compiled  # type: ignore[attr-defined]
    return run


_FIRST_CALL = threading.Lock()


@contextlib.contextmanager
def compiler_choices(plenty: bool | None = None) -> Iterator[None]:
    """Have the compiler order instructions so that few registers are needed at once.

    A step is a thousand instructions in one piece, and most of what the usual scheduler does to them ends on the
    stack; the older one, which works before registers are given out, leaves a tenth of the instructions out. It is
    measured with 32 vector registers and done only there. LLVM offers it as process-wide options only, so they are
    taken back.

    Parameters
    ----------
    plenty : bool, optional
        Whether there are 32 vector registers; by default, whether this machine's processor has them.
    """
    import llvmlite.binding as llvm

    if plenty is None:
        plenty = has_registers_of_512_bits()
    if plenty:
        llvm.set_option("", "-enable-misched=0")
        llvm.set_option("", "-pre-RA-sched=list-ilp")
    try:
        yield
    finally:
        if plenty:
            llvm.set_option("", "-enable-misched=1")
            llvm.set_option("", "-pre-RA-sched=default")


def has_registers_of_512_bits() -> bool:
    """Return whether the processor that is compiled for has 32 vector registers of 512 bits.

    It is this machine's unless Numba is told of other features, by ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES``.
    """
    import llvmlite.binding as llvm

    named = numba.config.CPU_FEATURES
    if named is None:
        return bool(llvm.get_host_cpu_features().get("avx512vl", False))
    return "+avx512vl" in named.split(",")
