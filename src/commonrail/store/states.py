"""States of optimisers, which nobody looks into, as JSON and the bytes of their arrays."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.reading.guarded_file import sha256

__all__ = ["digest", "number_bytes", "pack", "unpack"]

_ARRAY = "array"  # key of what stands for an array in the JSON: its type, and its shape


def pack(state: Mapping[str, Any]) -> tuple[str, bytes]:
    """JSON of a mapping, and its arrays as the bytes of little-endian numbers, in the order in which it has them.

    Raises
    ------
    TypeError
        If it holds anything but texts, numbers, arrays, None, and mappings and lists of these.
    """
    arrays: list[bytes] = []

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
            little = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
            arrays.append(little.tobytes())
            return {_ARRAY: [little.dtype.str, list(value.shape)]}
        if isinstance(value, np.generic):
            return value.item()
        raise TypeError(f"{type(value).__name__} cannot be kept")

    return json.dumps(dict(state), default=plain), b"".join(arrays)


def unpack(text: str, content: bytes) -> dict[str, Any]:
    """A state from what `pack` made of it.

    Raises
    ------
    ValueError, TypeError, KeyError
        If it is not whole.
    """
    left = memoryview(content)

    def whole(table: dict[str, Any]) -> Any:
        nonlocal left
        if set(table) != {_ARRAY}:
            return table
        kind, shape = table[_ARRAY]
        dtype = np.dtype(kind)
        size = math.prod(shape) * dtype.itemsize
        array: NDArray[Any] = np.frombuffer(left[:size], dtype).reshape(shape)
        left = left[size:]
        return array.astype(dtype.newbyteorder("="))

    state = json.loads(text, object_hook=whole)
    if not isinstance(state, dict) or len(left):
        raise ValueError("a state is not whole")
    return state


def digest(text: str, arrays: bytes, history: Sequence[tuple[int, float, float]]) -> str:
    """SHA-256 of what a search goes on from; SQLite does not notice a bit that has flipped on the disk.

    Parameters
    ----------
    text, arrays : str, bytes
        A state, as `pack` returns it.
    history : sequence of tuple
        Number, best and mean of each generation.
    """
    return sha256(b"".join((text.encode(), arrays, number_bytes(history))))


def number_bytes(numbers: Any) -> bytes:
    """Numbers as journals keep them: 64 bits, little-endian."""
    return np.ascontiguousarray(numbers, "<f8").tobytes()
