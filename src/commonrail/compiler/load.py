"""From a source to an object file, and from there to a function that Python calls."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from commonrail.compiler.cache import ENDING, Source, get_or_make
from commonrail.compiler.table import address, fill
from commonrail.compiler.target import Processor, System, may_compile, own_processor

# function (result, exception, table) -> int; the arguments are addresses. The function's value is written to result;
# the return value is 0, and exception is not used
Call = Callable[[int, int, int], int]


def object_of(source: Source, names: Mapping[str, str], processor: Processor) -> tuple[bytes, bool]:
    """Object file of a source for this system, from the cache or compiled, and whether it was compiled.

    `names`: see `lower.emit`. `ConfigurationError` as in `child.texts`.
    """
    compiled = []

    def make() -> bytes:
        from commonrail.compiler.child import texts  # slow to import, and rarely needed
        from commonrail.compiler.lower import emit

        compiled.append(True)
        return emit(texts(source), names, system)

    system = System.of(processor)
    key = repr((source.digest, sorted(names.items()), system))
    return get_or_make(hashlib.sha256(key.encode()).hexdigest()[:24] + ENDING, make), bool(compiled)


def load(content: bytes, symbol: str) -> tuple[Call, Any]:
    """Function of an object file, and the object that keeps it in memory."""
    llvm = _llvm()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    return callable_at(engine.get_function_address(symbol)), engine


def callable_at(place: int) -> Call:
    """Function at an address."""
    return ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)(place)


@functools.cache
def _llvm() -> Any:
    """LLVM, initialised for this machine."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


class Kernel:
    """Compiled function that is called with arrays and numbers, in double precision; compiled at its first call.

    Parameters
    ----------
    source : Source
    name : str
        Name of the function in the source; its argument is a table (`laws.of_table`).
    described : tuple
        The arguments, see `fill`.
    plain : function, optional
        The same in plain Python, for a process that may not compile.
    """

    def __init__(
        self, source: Source, name: str, described: tuple[Any, ...], plain: Callable[..., Any] | None = None
    ) -> None:
        self._source, self._name, self._described, self._plain = source, name, described, plain
        self._turn = threading.Lock()
        self._loaded: tuple[Call, Any] | None = None

    def __call__(self, *arguments: Any) -> int:
        """Return what the function returns."""
        return self.bound(*arguments)()

    def bound(self, *arguments: Any) -> Callable[[], int]:
        """Function without arguments that calls this one with the same memory each time."""
        plain = self._plain
        if plain and not may_compile():
            return lambda: int(plain(*arguments) or 0)
        call, _ = self._function()
        table, referenced_arrays = fill(self._described, arguments)
        ended = np.zeros(2, np.int64)
        places = address(ended), address(ended) + 8, address(table)

        def again() -> int:
            call(*places)
            return int(ended[0])

        again.kept = table, referenced_arrays  # type: ignore[attr-defined]
        return again

    def _function(self) -> tuple[Call, Any]:
        with self._turn:
            if self._loaded is None:
                content, _ = object_of(self._source, {self._name: self._name}, own_processor())
                self._loaded = load(content, self._name)
        return self._loaded
