"""Variables of MAT files of version 5 to 7: numbers, texts and structures; all else is left out.

Read here and by no library, because a damaged file must be refused and not end the program. Format: MathWorks,
"MAT-File Format": elements of a type, a length and content, in which an array is flags, dimensions, name and values.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["TooLarge", "is_mat5", "most_content", "variables_of_mat5"]

# Of a compressed file when it is unpacked [bytes]: a small one may hold little, so that it is not unpacked for half a
# minute to be refused; measured values shrink to a half or a fifth.
LARGEST_CONTENT = 1_000_000_000
SMALLEST_LIMIT = 100_000_000
TIMES = 20
DEEPEST = 4  # structures in structures

_HEAD = 128  # bytes before the first variable
_PIECE = 1 << 20  # bytes that are unpacked at a time
_ARRAY, _COMPRESSED = 14, 15  # types of elements
_STRUCTURE, _TEXT, _NUMBERS = 2, 4, range(6, 16)  # classes of arrays
_COMPLEX = 0x0800  # flag of an array
_DTYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16"}

Variable = tuple[str, "NDArray[np.generic] | str"]


class TooLarge(Exception):
    """The file holds more than is read."""


def most_content(size: int) -> int:
    """Bytes that a file of a size [bytes] may hold unpacked."""
    return min(LARGEST_CONTENT, SMALLEST_LIMIT + TIMES * size)


class _Element(NamedTuple):
    """An element: its type and content; byte order "<" or ">"."""

    kind: int
    content: bytes
    order: str

    def numbers(self) -> NDArray[np.generic]:
        """Content as numbers."""
        return np.frombuffer(self.content, np.dtype(self.order + _DTYPES[self.kind]))

    def text(self) -> str:
        """Content as text."""
        encoding = _ENCODINGS[self.kind]
        order = {"<": "-le", ">": "-be"}[self.order] if encoding == "utf-16" else ""
        return self.content.decode(encoding + order)


def is_mat5(data: bytes) -> bool:
    """True for the head of a MAT file of version 5 to 7."""
    return len(data) >= _HEAD and data[124:128] in (b"\x00\x01IM", b"\x01\x00MI")


def variables_of_mat5(data: bytes) -> Iterator[Variable]:
    """Variables by name, fields of structures as ``name.field``.

    Parameters
    ----------
    data : bytes
        Of a file that `is_mat5`.

    Raises
    ------
    TooLarge
        If unpacked it is more than `most_content`.
    ValueError, KeyError, IndexError, zlib.error
        If it is damaged.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    left = most_content(len(data))
    for element in _elements(data[_HEAD:], order, padded=False):
        if element.kind == _COMPRESSED:
            unpacked = _unpacked(element.content, left)
            left -= len(unpacked)
            element = next(_elements(unpacked, order))
        if element.kind == _ARRAY:
            yield from _array(element, "", 0)


def _unpacked(packed: bytes, most: int) -> bytes:
    unpack, pieces, size = zlib.decompressobj(), [], 0
    piece = unpack.decompress(packed, _PIECE)
    while piece:
        size += len(piece)
        if size > most:
            raise TooLarge
        pieces.append(piece)
        piece = unpack.decompress(unpack.unconsumed_tail, _PIECE)
    return b"".join(pieces)


def _elements(data: bytes, order: str, *, padded: bool = True) -> Iterator[_Element]:
    """Elements one after the other; short ones have their content in the place of their length."""
    byteorder = "little" if order == "<" else "big"
    start = 0
    while start + 8 <= len(data):
        kind = int.from_bytes(data[start : start + 4], byteorder)  # type: ignore[arg-type]
        length = int.from_bytes(data[start + 4 : start + 8], byteorder)  # type: ignore[arg-type]
        begin, step = start + 8, 8 + length
        if kind >> 16:
            kind, length, begin, step = kind & 0xFFFF, kind >> 16, start + 4, 8
        elif padded or kind != _COMPRESSED:
            step = 8 + -(-length // 8) * 8
        if begin + length > len(data):
            raise ValueError("an element is cut off")
        yield _Element(kind, data[begin : begin + length], order)
        start += step


def _array(element: _Element, inside: str, depth: int, name: str | None = None) -> Iterator[Variable]:
    """Variables of an array: itself, or the fields of a structure."""
    parts = _elements(element.content, element.order)
    try:
        flags, dimensions, own = next(parts), next(parts).numbers(), next(parts)
    except StopIteration:
        return  # an empty field
    kind = int(flags.numbers()[0])
    shape = tuple(int(n) for n in dimensions)
    whole = inside + (own.content.decode("latin-1") if name is None else name)
    if min(shape, default=-1) < 0:
        raise ValueError("an array has no dimensions")
    count = math.prod(shape)
    if kind & 0xFF == _STRUCTURE:
        if depth < DEEPEST:
            yield from _structure(parts, whole, count, depth)
    elif kind & 0xFF == _TEXT:
        if count and shape[0] == 1:
            yield whole, next(parts).text()
    elif kind & 0xFF in _NUMBERS and not kind & _COMPLEX and count:
        values = next(parts).numbers()
        if len(values) != count:
            raise ValueError("an array has more or fewer numbers than it says")
        yield whole, values.reshape(shape, order="F")


def _structure(parts: Iterator[_Element], whole: str, count: int, depth: int) -> Iterator[Variable]:
    """Fields of a structure, or of each of a list of them."""
    width = int(next(parts).numbers()[0])
    names = next(parts).content
    if width < 1:
        raise ValueError("names of fields have no length")
    fields = [names[i : i + width].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), width)]
    for i in range(count if fields else 0):
        here = whole if count == 1 else f"{whole}({i + 1})"
        for field in fields:
            yield from _array(next(parts), f"{here}.", depth + 1, field)
