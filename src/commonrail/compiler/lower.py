"""Targets of Numba's for the kernels of the lanes: one processor each, position-independent code, no C library.

Numba compiles for the machine that it runs on. Here it compiles for a processor that is named, so that the code is the
same whether it is compiled now or was put into a library elsewhere, and inlines the elementary functions of
`elementary`. What comes out is an object file.
"""

from __future__ import annotations

import functools
import math
import re
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import cgutils, codegen, cpu, target_extension, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher, CPUTarget, cpu_target
from numba.core.runtime import rtsys
from numba.extending import overload

from commonrail.compiler.numba import (
    FASTMATH,
    INLINED,
    SINGLE_FASTMATH,
    by_precision,
    compiler_choices,
    offer_overloads,
)
from commonrail.compiler.target import Processor
from commonrail.physics.elementary import cosine, exponential, quarter_sine, sine
from commonrail.physics.law import in_single


def compile_object(entry: Callable[..., Any], symbol: str, processor: Processor, real: type = np.float64) -> bytes:
    """Object file of a function of a table: ``int32_t symbol(int64_t *result, void **exception, int64_t *table)``.

    It returns 0 and does not write `exception`; `result` receives what the function returns.

    Parameters
    ----------
    entry : function (table) -> int
        It allocates nothing.
    symbol : str
        Name of the function in the object.
    processor : Processor
    real : type
        `numpy.float32` for a function that computes in single precision.
    """
    return _built(entry, symbol, processor, real, lambda machine, module: bytes(machine.emit_object(module)))


def assembly(entry: Callable[..., Any], symbol: str, processor: Processor, real: type = np.float64) -> str:
    """Assembly text of what `compile_object` makes of the same arguments.

    Parameters
    ----------
    entry, symbol, processor, real
        As of `compile_object`.
    """
    return _built(entry, symbol, processor, real, lambda machine, module: str(machine.emit_assembly(module)))


def module_text(entry: Callable[..., Any], symbol: str, signature: Any, processor: Processor) -> str:
    """LLVM text of a function and of what it calls, optimised.

    Parameters
    ----------
    entry : function
        It allocates nothing.
    symbol : str
        Name of the function in the text.
    signature : Numba's signature
    processor : Processor
    """
    with _ONE_AT_A_TIME, compiler_choices(processor.is_wide):
        return str(_optimised(entry, symbol, signature, processor, False)[1])


def _built(
    entry: Callable[..., Any],
    symbol: str,
    processor: Processor,
    real: type,
    emit: Callable[[Any, Any], _Emitted],
) -> _Emitted:
    with _ONE_AT_A_TIME, compiler_choices(processor.is_wide):
        single = real is not np.float64
        return emit(*_optimised(in_single(entry) if single else entry, symbol, _OF_A_TABLE, processor, single))


def _optimised(
    entry: Callable[..., Any], symbol: str, signature: Any, processor: Processor, single: bool
) -> tuple[Any, Any]:
    """LLVM's machine of a processor, and an optimised module of a function with what it calls alone."""
    recorded, own = _recorded(entry, signature, single)
    machine = _machine(processor)
    with global_compiler_lock:
        module = machine.replayed(recorded)._final_module
    for other in (*module.functions, *module.global_variables):
        if not other.is_declaration:
            other.linkage = "external" if other.name == own else "internal"
    module.get_function(own).name = symbol
    builder = llvm.create_pass_builder(machine._tm, llvm.create_pipeline_tuning_options(speed_level=0))
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, builder)
    return machine._tm, module


_Emitted = TypeVar("_Emitted")
_OF_A_TABLE = types.int64(types.CPointer(types.int64))  # type: ignore[attr-defined]
_ONE_AT_A_TIME = threading.Lock()


@functools.lru_cache(maxsize=8)
def _recorded(entry: Callable[..., Any], signature: Any, single: bool) -> tuple[_Recorded, str]:
    """Texts of a function for any processor, and the function's name in them.

    Parameters
    ----------
    entry : function
    signature : Numba's signature
    single : bool
        Of a function that computes in single precision.
    """
    name, options = _open(single)
    options = {option: value for option, value in options.items() if option != "forceinline"}
    compiled = numba.njit(entry, nogil=True, _nrt=False, _target=name, **options)
    compiled.compile(signature)  # type: ignore[attr-defined]
    (overloaded,) = compiled.overloads.values()
    return overloaded.library, overloaded.fndesc.llvm_func_name


@functools.cache
def _open(single: bool) -> tuple[str, dict[str, Any]]:
    """Let kernels be compiled with all laws; return the target's name for Numba, and its options.

    Parameters
    ----------
    single : bool
        For kernels that compute in single precision.
    """
    name = f"commonrail {'f32' if single else 'f64'}"
    kind = type("LanesCPU", (target_extension.CPU,), {})
    target_extension.target_registry[name] = kind
    target_extension.dispatcher_registry[kind] = _dispatcher(name)
    target_extension.jit_registry[kind] = functools.partial(numba.jit, _target=name)
    options = INLINED | {"fastmath": SINGLE_FASTMATH if single else FASTMATH}
    declare = functools.partial(overload, jit_options=options, strict=False, target=name)
    for function, law in ((math.sin, sine), (quarter_sine, quarter_sine), (math.cos, cosine), (math.exp, exponential)):
        declare(function)(_by_argument(law))
    offer_overloads(declare)
    return name, options


def _by_argument(law: Callable[..., Any]) -> Callable[..., Any]:
    """As `by_precision`, of a law of one argument `x`: Numba compares the names of arguments."""
    choose = by_precision(law)

    def choose_by(x: Any) -> Callable[..., Any]:
        return choose(x)

    return choose_by


class _Recorded(codegen.JITCodeLibrary):  # type: ignore[misc]
    """Texts of a function that Numba has typed, not optimised yet, and the libraries of those that it calls.

    Types and texts are two thirds of the work, and the same for every processor.

    Attributes
    ----------
    texts : list of (str, str)
        Names and texts of modules.
    """

    def __init__(self, own: Any, name: str) -> None:
        super().__init__(own, name)
        self.texts: list[tuple[str, str]] = []

    def add_ir_module(self, ir_module: Any) -> None:
        """Keep the text of a module."""
        self.texts.append((ir_module.name, cgutils.normalize_ir_text(str(ir_module))))

    def finalize(self) -> None:
        """Nothing is optimised before the processor is known."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Zero, as of a function that the library does not define."""
        self._ensure_finalized()
        return 0


class _Generic(codegen.JITCPUCodegen):  # type: ignore[misc]
    """Generator that makes no machine code."""

    _library_class = _Recorded

    def _get_host_cpu_name(self) -> str:
        return "generic"

    def _get_host_cpu_features(self) -> str:
        return ""

    def set_env(self, env_name: str, env: Any) -> None:
        """Nothing to set: nothing is called from Python."""


class _Unloaded(codegen.JITCodeLibrary):  # type: ignore[misc]
    """Library whose machine code is not made: of the laws, which are inlined, and of a kernel until it is emitted."""

    def _finalize_specific(self) -> None:
        pass


class _Machine(codegen.JITCPUCodegen):  # type: ignore[misc]
    """Generator of machine code for a processor."""

    _library_class = _Unloaded

    def __init__(self, processor: Processor) -> None:
        self._processor = processor
        self._made: dict[_Recorded, _Unloaded] = {}
        super().__init__("commonrail.compiler.lower")

    def _get_host_cpu_name(self) -> str:
        return self._processor.name

    def _get_host_cpu_features(self) -> str:
        return self._processor.features

    def _customize_tm_options(self, options: dict[str, Any]) -> None:
        super()._customize_tm_options(options)
        options |= {"reloc": "pic", "codemodel": "default", "jit": False}

    def _add_module(self, module: Any) -> None:
        pass

    def replayed(self, recorded: _Recorded) -> _Unloaded:
        """The library that Numba would have made for the processor, optimised in the same steps.

        Those of what it calls are kept, as laws that others call too; a kernel's own is not.
        """
        library = self.create_library(recorded.name)
        for name, text in recorded.texts:
            module = llvm.parse_assembly(without_liberties(text) if self._processor.exact else text)
            module.name = name
            module.verify()
            library.add_llvm_module(module)
        for other in recorded._linking_libraries:  # Numba's run-time functions among them, which nothing here calls
            library.add_linking_library(self._kept(other) if isinstance(other, _Recorded) else other)
        library.finalize()
        return library

    def _kept(self, recorded: _Recorded) -> _Unloaded:
        if recorded not in self._made:
            self._made[recorded] = self.replayed(recorded)
        return self._made[recorded]


_machine = functools.cache(_Machine)
_NAMES = "|".join(sorted(FASTMATH))
_LIBERTIES = re.compile(rf"(?:(?<= f[a-z]{{3}})|(?<= call))(?: (?:{_NAMES}))+(?= )")


def without_liberties(text: str) -> str:
    """LLVM's text without leave to fuse or to reorder operations: as Numba writes it without `fastmath`."""
    return _LIBERTIES.sub("", text)


def _dispatcher(name: str) -> type:
    """Class of Numba's dispatchers of a target."""

    class Context(cpu.CPUContext):  # type: ignore[misc]
        def init(self) -> None:
            # Numba's run-time functions, which other kernels share, are made by whatever target comes first
            rtsys.initialize(cpu_target.target_context)
            super().init()
            self._internal_codegen = _Generic("commonrail.compiler.lower")

    class Target(CPUTarget):  # type: ignore[misc]
        @functools.cached_property
        def _toplevel_target_context(self) -> Context:
            return Context(self.typing_context, self._target_name)

    class Dispatcher(CPUDispatcher):  # type: ignore[misc]
        targetdescr = Target(name)

        def compile(self, sig: Any) -> Any:
            """Compile for one signature, with the overloads of the target."""
            with target_extension.target_override(name):
                return super().compile(sig)

    return Dispatcher
