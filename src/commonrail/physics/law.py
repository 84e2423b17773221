"""Laws of the physics as plain functions, and where compilers find them; nothing here needs Numba.

`physics` marks every small scalar law and returns the plain Python function, so debuggers, coverage and dimensional
tests see ordinary code. Whatever compiles the laws (`commonrail.compiler.numba`, the CUDA kernels) is told of them by
`offer_laws`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import CellType, FunctionType
from typing import Any, TypeVar

import numpy as np

# Numbers too small for their format are zero: the processor takes a hundred cycles for each. In f32 there are many of
# them, in f64 where what has died away is simulated on.
FLUSH_TINY = np.int32(0x8040)
KEEP_ALL, KEEP_NONE = np.int32(-1), np.int32(0)
CACHE_LINE = 64  # [bytes]

_Law = TypeVar("_Law", bound=Callable[..., Any])
_LAWS: list[Callable[..., Any]] = []
_MACHINES: list[Callable[[Callable[..., Any]], None]] = []


def physics(law: _Law) -> _Law:
    """Let kernels inline a scalar law; from Python it stays the plain function that it is."""
    _LAWS.append(law)
    for offer in _MACHINES:
        offer(law)
    return law


def offer_laws(offer: Callable[[Callable[..., Any]], None]) -> None:
    """Let one more kind of machine inline all laws, those to come too.

    `offer` (function (law) -> None): called with every law.
    """
    _MACHINES.append(offer)
    for law in _LAWS:
        offer(law)


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
