"""One fixed processor for kernels whose bits shall not depend on the machine, and elementary functions for all kernels.

The machine code of a kernel is a function of its source, of LLVM and of the processor that it is compiled for. Here
that processor is x86-64-v3 (AVX2 and FMA) on every machine, in place of the machine's own: vectors of 256 bits, the
same choice of fused multiply-adds, the same instruction order. The elementary functions of the C library, which has
several versions of each and takes one by processor, are replaced by those of this module in every kernel of the lanes.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping

from commonrail.compile_target import LEVEL_3, OF_LEVEL_3, Processor, is_x86
from commonrail.errors import ConfigurationError

__all__ = ["cosine", "exponential", "fixed_processor", "missing", "sine"]

# ln 2 in two parts; the first has so few digits that its product with a whole number of a kernel's range is exact
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(12))  # Taylor: to π/2 exact to rounding
_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(14))  # to 0.35 exact to rounding
_SMALLEST = -708.0  # the exponential below is no normal number: zero


def missing(has: Mapping[str, bool] | None = None) -> str | None:
    """Sentence on the feature that this processor lacks; None if kernels of the fixed target run here.

    Parameters
    ----------
    has : mapping of str to bool, optional
        Features of the processor; by default LLVM is asked, which loads llvmlite.
    """
    if not is_x86():
        return (
            f"The same bits are promised for x86-64 processors with AVX2, and this machine is of kind "
            f"{platform.machine()}; omit same_bits."
        )
    if has is None:
        import llvmlite.binding as llvm

        has = llvm.get_host_cpu_features()
    lacking = [name for name in OF_LEVEL_3 if not has.get(name, False)]
    if lacking:
        return (
            f"The same bits are promised for x86-64 processors with AVX2 and FMA, and this one lacks "
            f"{', '.join(lacking)}; omit same_bits."
        )
    return None


def fixed_processor() -> Processor:
    """Processor of kernels whose bits shall not depend on the machine.

    Raises
    ------
    ConfigurationError
        If this machine cannot run them.
    """
    fault = missing()
    if fault is not None:
        raise ConfigurationError(fault)
    return LEVEL_3


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
