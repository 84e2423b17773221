"""Compilation of the physics to machine code: the only file that names Numba flags.

`physics` decorates every small scalar law. With the JIT off (``NUMBA_DISABLE_JIT=1``) it returns the
plain Python function, so debuggers, coverage and dimensional tests see ordinary code.
`kernel` compiles an outer loop and keeps its machine code on disk (`kernel_cache`).
"""

from __future__ import annotations

import contextlib
import functools
import platform
import threading
from collections.abc import Callable, Iterator
from types import CellType, FunctionType
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir as llvm_ir
from numba.core import cgutils, types
from numba.extending import intrinsic, overload

from commonrail.kernel_cache import KernelCache

# No "nnan"/"ninf": a candidate that blows up must be seen to be non-finite.
_FASTMATH = {"nsz", "arcp", "contract", "reassoc"}
INLINED = {
    "forceinline": True,
    "fastmath": _FASTMATH,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


_Law = TypeVar("_Law", bound=Callable[..., Any])
_LAWS: list[tuple[Callable[..., Any], Callable[..., Any]]] = []
_MACHINES: list[Callable[..., Any]] = [functools.partial(overload, jit_options=INLINED, strict=False, target="cpu")]


def physics(law: _Law) -> _Law:
    """Let kernels inline a scalar law; from Python it stays the plain function that it is.

    Called with numbers of single precision, it is compiled with constants of single precision: those of its text would
    be double, and draw everything that they touch along.
    """

    def choose(*arguments: Any, **named: Any) -> Callable[..., Any]:
        return in_single(law) if any(map(is_single, (*arguments, *named.values()))) else law

    _LAWS.append((law, choose))
    for offer in _MACHINES:
        offer(law)(choose)
    return law


def offer_laws(offer: Callable[..., Any]) -> None:
    """Let one more kind of machine inline all laws, those to come too.

    Parameters
    ----------
    offer : function (law) -> decorator
        Numba's `overload` of that machine, with its options.
    """
    _MACHINES.append(offer)
    for law, choose in _LAWS:
        offer(law)(choose)


def is_single(kind: Any) -> bool:
    if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]
        return any(map(is_single, kind))
    return (kind.dtype if isinstance(kind, types.Array) else kind) == types.float32


def _single(value: Any) -> Any:
    """A constant in single precision; so are those in a tuple."""
    if isinstance(value, tuple):
        parts = map(_single, value)
        return value._make(parts) if hasattr(value, "_make") else tuple(parts)
    return np.float32(value) if type(value) is float else value


@functools.cache
def in_single(law: Callable[..., Any]) -> Callable[..., Any]:
    """The same law with its constants in single precision."""

    code = law.__code__.replace(co_consts=tuple(map(_single, law.__code__.co_consts)))
    names = {name: _single(law.__globals__[name]) for name in code.co_names if name in law.__globals__}
    names["__name__"] = law.__module__
    cells = tuple(CellType(_single(cell.cell_contents)) for cell in law.__closure__ or ())
    twin = FunctionType(code, names, law.__name__, law.__defaults__, cells)
    twin.__module__, twin.__qualname__ = law.__module__, law.__qualname__
    return twin


@physics
def reciprocals(a: float, b: float) -> tuple[float, float]:
    """(1/a, 1/b) with one division: divisions bound the speed of the step."""
    inverse = 1.0 / (a * b)
    return b * inverse, a * inverse


@physics
def three_reciprocals(a: float, b: float, c: float) -> tuple[float, float, float]:
    """(1/a, 1/b, 1/c) with one division."""
    ab = a * b
    inverse = 1.0 / (ab * c)
    per_ab = c * inverse
    return b * per_ab, a * per_ab, ab * inverse


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


# Numbers too small for their format are zero: the processor takes a hundred cycles for each. In f32 there are many of
# them, in f64 where what has died away is simulated on.
FLUSH_TINY = np.int32(0x8040)
KEEP_ALL, KEEP_NONE = np.int32(-1), np.int32(0)
CACHE_LINE = 64  # [bytes]


@intrinsic
def widest_vectors(typing: Any) -> Any:
    """Let the function that calls it be compiled to the widest vectors there are, where the compiler is shy of them.

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
    target: str = "cpu",
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
    target : str
        Numba's name of the processor to compile for: this machine's own, or that of `fixed_target`.
    """
    if numba.config.DISABLE_JIT:
        return loop
    source = loop if real is np.float64 else in_single(loop)
    compiled = numba.njit(source, nogil=True, fastmath=_FASTMATH, error_model="numpy", _target=target)
    compiled._cache = KernelCache(name, laws)

    @functools.wraps(loop)
    def run(*arguments: Any) -> Any:
        if compiled.signatures:
            return compiled(*arguments)
        with _FIRST_CALL, compiler_choices(target), contextlib.ExitStack() as waiting:
            compiled._cache.waiting = waiting
            return compiled(*arguments)

    run.compiled = compiled  # type: ignore[attr-defined]
    return run


_FIRST_CALL = threading.Lock()


@contextlib.contextmanager
def compiler_choices(target: str = "cpu") -> Iterator[None]:
    """Have the compiler order instructions so that few registers are needed at once.

    A step is a thousand instructions in one piece, and most of what the usual scheduler does to them ends on the
    stack; the older one, which works before registers are given out, leaves a tenth of the instructions out. It is
    measured with 32 vector registers and done only there. LLVM offers it as process-wide options only, so they are
    taken back.
    """
    import llvmlite.binding as llvm

    plenty = target == "cpu" and has_registers_of_512_bits()
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
