"""One fixed processor for kernels whose bits shall not depend on the machine: x86-64 with AVX2 and FMA.

The machine code of a kernel is a function of its source, of LLVM and of the processor that it is compiled for. Here
that processor is x86-64-v3 on every machine, in place of the machine's own: vectors of 256 bits, the same choice of
fused multiply-adds, the same instruction order. The elementary functions of the C library, which has several versions
of each and takes one by processor, are replaced by those of this module, which the kernels inline.

Import it only where such a kernel is wanted: see `commonrail.compile.kernel`.
"""

from __future__ import annotations

import functools
import math
import platform
import threading
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core import codegen, cpu, target_extension
from numba.core.registry import CPUDispatcher, CPUTarget
from numba.extending import overload

from commonrail.compile import INLINED, in_single, is_single, offer_laws
from commonrail.errors import ConfigurationError

__all__ = ["PROCESSOR", "TARGET", "cosine", "exponential", "missing", "open_target", "sine"]

TARGET = "commonrail-x86-64-v3"
PROCESSOR, FEATURES = "x86-64-v3", ""  # the features are those of this level, and nothing is added
_NEEDED = ("avx2", "fma", "bmi", "bmi2", "lzcnt", "f16c", "movbe")

# ln 2 in two parts; the first has so few digits that its product with a whole number of a kernel's range is exact
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(12))  # Taylor: to π/2 exact to rounding
_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(14))  # to 0.35 exact to rounding
_SMALLEST = -708.0  # the exponential below is no normal number: zero


def missing() -> str | None:
    """Sentence on the feature that this processor lacks; None if kernels of the fixed target run here."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return (
            f"The same bits are promised for x86-64 processors with AVX2, and this machine is of kind "
            f"{platform.machine()}; omit same_bits."
        )
    has = llvm.get_host_cpu_features()
    lacking = [name for name in _NEEDED if not has.get(name, False)]
    if lacking:
        return (
            f"The same bits are promised for x86-64 processors with AVX2 and FMA, and this one lacks "
            f"{', '.join(lacking)}; omit same_bits."
        )
    return None


def open_target() -> str:
    """Let kernels be compiled for the fixed processor, with all laws; return the target's name for Numba.

    Raises
    ------
    ConfigurationError
        If this machine cannot run them.
    """
    fault = missing()
    if fault is not None:
        raise ConfigurationError(fault)
    with _OPENING:
        _register()
    return TARGET


@functools.cache
def _register() -> None:
    target_extension.target_registry[TARGET] = _Fixed
    target_extension.dispatcher_registry[_Fixed] = _FixedDispatcher
    target_extension.jit_registry[_Fixed] = functools.partial(numba.jit, _target=TARGET)
    offer = functools.partial(overload, jit_options=INLINED, strict=False, target=TARGET)
    for function, law in ((math.sin, sine), (sine, sine), (math.cos, cosine), (math.exp, exponential)):
        offer(function)(_by_precision(law))
    offer_laws(offer)


def _by_precision(law: Callable[..., Any]) -> Callable[..., Any]:
    """Function that chooses a law, or its twin in single precision, by the type of its argument `x`."""

    def choose(x: Any) -> Callable[..., Any]:
        return in_single(law) if is_single(x) else law

    return choose


def sine(x: float) -> float:
    """Return sin x by its Taylor series, for the angles of seats and cones.

    Parameters
    ----------
    x : float
        Angle [rad], from −π/2 to 3π/2; beyond, accuracy is lost.
    """
    y = x if x <= 0.5 * math.pi else math.pi - x
    square = y * y
    total = _SINE[11]
    for k in range(10, -1, -1):
        total = _SINE[k] + square * total
    return y * total


def cosine(x: float) -> float:
    """Return cos x, of an angle from −π to π [rad]."""
    return sine(0.5 * math.pi - abs(x))


def exponential(x: float) -> float:
    """Return exp x of a decay, 0 where it is no normal number.

    Parameters
    ----------
    x : float
        Exponent [1], not above 0; the series takes what ln 2 leaves, halvings the rest.
    """
    if x < _SMALLEST:
        return 0.0
    halvings = int(0.5 - x / _LN2_HIGH)
    rest = (x + halvings * _LN2_HIGH) + halvings * _LN2_LOW
    total = _EXPONENTIAL[13]
    for k in range(12, -1, -1):
        total = _EXPONENTIAL[k] + rest * total
    factor = 0.5
    while halvings > 0:
        if halvings & 1:
            total *= factor
        factor *= factor
        halvings >>= 1
    return total


_OPENING = threading.Lock()


class _Fixed(target_extension.CPU):  # type: ignore[misc]
    """Numba's name for the fixed processor: all that a processor can do, and overloads of its own first."""


class _FixedCodegen(codegen.JITCPUCodegen):  # type: ignore[misc]
    """Machine code for the fixed processor, whatever this machine or Numba's settings say."""

    def _get_host_cpu_name(self) -> str:
        return PROCESSOR

    def _get_host_cpu_features(self) -> str:
        return FEATURES


class _FixedContext(cpu.CPUContext):  # type: ignore[misc]
    """As Numba's own context, with the generator of machine code above."""

    def init(self) -> None:
        super().init()
        self._internal_codegen = _FixedCodegen("commonrail.fixed")


class _FixedTarget(CPUTarget):  # type: ignore[misc]
    @functools.cached_property
    def _toplevel_target_context(self) -> _FixedContext:
        return _FixedContext(self.typing_context, self._target_name)


class _FixedDispatcher(CPUDispatcher):  # type: ignore[misc]
    targetdescr = _FixedTarget(TARGET)

    def compile(self, sig: Any) -> Any:
        """Compile for one signature, with the overloads of the fixed target."""
        with target_extension.target_override(TARGET):
            return super().compile(sig)
