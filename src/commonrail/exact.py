"""Kernels whose bits do not depend on the processor, and the elementary functions of all kernels.

Additions, products, divisions and roots are rounded alike by every processor (IEEE 754). Processors give other bits
where the compiler fuses a product and a sum, or reorders operations, as it finds best for each. A kernel of
`exact_processor` is compiled without either. The elementary functions of the C library, which has several versions of
each and takes one by processor, are replaced by those of this module in every kernel of the lanes and of exports.
"""

from __future__ import annotations

import math
import platform

from commonrail.compile_target import Processor, is_x86, own_processor
from commonrail.errors import ConfigurationError

__all__ = ["cosine", "exact_processor", "exponential", "missing", "sine"]

# ln 2 in two parts; the first has so few digits that its product with a whole number of a kernel's range is exact
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(12))  # Taylor: to π/2 exact to rounding
_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(14))  # to 0.35 exact to rounding
_SMALLEST = -708.0  # the exponential below is no normal number: zero


def missing() -> str | None:
    """Sentence on why no bits are promised on this machine; None where they are."""
    if is_x86():
        return None
    return (
        f"The same bits are promised for x86-64 processors, and this machine is of kind {platform.machine()}; "
        "omit same_bits."
    )


def exact_processor() -> Processor:
    """This machine's processor, for kernels whose bits are those of every other; loads llvmlite.

    Raises
    ------
    ConfigurationError
        If this machine is of another kind.
    """
    fault = missing()
    if fault is not None:
        raise ConfigurationError(fault)
    return own_processor()._replace(exact=True)


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
