"""Table of addresses and numbers by which compiled functions are called from Python.

Every entry is a 64-bit integer: for an array its address and lengths, in C order; for a real number its
bits. Nested tuples of `Array`, "whole" and "real" describe the arguments of a function.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arrays import Ints

WHOLE: Any = "whole"
REAL: Any = "real"


class Array(NamedTuple):
    """Kind of an array's numbers, "float64", "int64" or "real" (precision of the function), and dimensions."""

    kind: str
    dimensions: int


def floats(dimensions: int) -> Any:
    """Array of double-precision numbers."""
    return Array("float64", dimensions)


def wholes(dimensions: int) -> Any:
    """Array of whole numbers."""
    return Array("int64", dimensions)


def address(array: NDArray[Any]) -> int:
    """Address of an array's first number."""
    return int(array.__array_interface__["data"][0])


def fill(described: Any, values: Any, real: type = np.float64) -> tuple[Ints, list[NDArray[Any]]]:
    """Table of the values, and arrays that must outlive it; `real`: precision of the function."""
    entries: list[int] = []
    arrays: list[NDArray[Any]] = []
    for kind, value in _leaves(described, values):
        if isinstance(kind, Array):
            # an array that the function writes is not copied: it is contiguous and of this kind already
            array = np.ascontiguousarray(value, real if kind.kind == REAL else kind.kind)
            if array.ndim != kind.dimensions:
                raise TypeError(f"an array of {array.ndim} dimensions in place of {kind.dimensions}")
            arrays.append(array)
            entries += (address(array), *array.shape)
        elif kind == REAL:
            entries.append(int(np.float64(value).view(np.int64)))
        else:
            entries.append(int(value))
    return np.array(entries, np.int64), arrays


def _leaves(described: Any, values: Any) -> Iterator[tuple[Any, Any]]:
    if isinstance(described, (Array, str)):
        yield described, values
    else:
        for kind, value in zip(described, values, strict=True):
            yield from _leaves(kind, value)
