"""Machine code of the lanes' loops: from a library that came with the package, from the cache, or compiled now."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.choices import Precision
from commonrail.compile_target import Processor, lane_settings, may_compile, own_processor
from commonrail.engine import library
from commonrail.engine.job import Vector
from commonrail.errors import ConfigurationError
from commonrail.exact import exact_processor
from commonrail.injector.variants import Variant
from commonrail.kernel_cache import ENDING, kept_or_made


class MachineCode(NamedTuple):
    """A loop that can be called.

    Attributes
    ----------
    call : function (result, exception, table) -> int
        Of ctypes, with addresses as arguments; see `targets.compile_object`.
    origin : str
        "library", "cache" or "compiled".
    processor : str
        That it was compiled for.
    holder : object
        Keeps the code in memory.
    """

    call: Callable[[int, int, int], int]
    origin: str
    processor: str
    holder: Any


def symbol_of(variant: Variant, precision: Precision, exact: bool = False) -> str:
    """Name of a loop in an object or a library.

    Parameters
    ----------
    variant : Variant
    precision : Precision
    exact : bool
        Of one that is compiled for a `Processor` that is exact.
    """
    words = "_".join(choice.value for choice in variant)
    return f"cr_{'exact_' if exact else ''}{precision.value}_{re.sub('[^a-z]+', '_', words)}"


def machine_code(variant: Variant, vector: Vector, same_bits: bool) -> MachineCode:
    """Machine code of a loop.

    Parameters
    ----------
    variant : Variant
    vector : Vector
    same_bits : bool
        Exact, so that its bits are those of any processor: see `commonrail.exact`.

    Raises
    ------
    ConfigurationError
        If no bits are promised on this machine, or it may not compile.
    """
    symbol = symbol_of(variant, vector.precision, same_bits)
    shared = library.find(symbol)
    if shared is not None:
        return MachineCode(_callable(shared.address), "library", shared.processor, shared.holder)
    processor = exact_processor() if same_bits else own_processor()
    found, made = object_of(variant, vector, processor)
    address, holder = _load(found, symbol)
    return MachineCode(_callable(address), "compiled" if made else "cache", processor.name, holder)


def object_of(variant: Variant, vector: Vector, processor: Processor) -> tuple[bytes, bool]:
    """Object file of a loop, from the cache or compiled, and whether it was compiled.

    Parameters
    ----------
    variant : Variant
    vector : Vector
    processor : Processor

    Raises
    ------
    ConfigurationError
        If it is not in the cache and ``NUMBA_DISABLE_JIT`` forbids to compile.
    """
    made = []

    def make() -> bytes:
        if not may_compile():
            raise ConfigurationError(
                "The fast engine needs its compiler, which NUMBA_DISABLE_JIT switches off; unset it, or use the engine "
                '"reference".'
            )
        from commonrail.engine.entry import make_entry
        from commonrail.targets import compile_object

        made.append(True)
        return compile_object(make_entry(variant, vector), symbol, processor, vector.real)

    symbol = symbol_of(variant, vector.precision, processor.exact)
    key = repr((symbol, vector.lanes, processor, lane_settings()))
    return kept_or_made(hashlib.sha256(key.encode()).hexdigest()[:24] + ENDING, make), bool(made)


@functools.cache
def _llvm() -> Any:
    """LLVM, made ready for this machine."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


def _load(content: bytes, symbol: str) -> tuple[int, Any]:
    """Address of a function of an object file, and what keeps it in memory."""
    llvm = _llvm()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    return engine.get_function_address(symbol), engine


def _callable(address: int) -> Callable[[int, int, int], int]:
    return ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)(address)
