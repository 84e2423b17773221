"""Table of addresses and numbers through which a loop over blocks is called, the same from a library and from Numba.

Every entry is a whole number of 64 bits, in the order of the fields of `Given`: of an array its address and its
lengths, in C order; a real number as its bits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.arrays import Ints
from commonrail.compile import CACHE_LINE
from commonrail.engine.job import Courses, Job, Samples


class Array(NamedTuple):
    """Kind of an array's numbers, "float64", "int64" or "real" (those that the loop computes in), and dimensions."""

    kind: str
    dimensions: int


class Shape(NamedTuple):
    """Sizes that a kernel was made for; one that is given others refuses.

    Attributes
    ----------
    rows, lanes : int
        Of the working memory.
    columns : int
        Of theta.
    size : int
        Bytes of a number.
    """

    rows: Any
    lanes: Any
    columns: Any
    size: Any


class Scratch(NamedTuple):
    """Memory of one thread: working rows, rings of the waves, origins of the clocks."""

    work: Any
    waves: Any
    origins: Any


class Given(NamedTuple):
    """All that the loop is given; it does every `stride`th block from `first` on.

    Attributes
    ----------
    shape : Shape
    job : Job
    samples : Samples
    trace : (blocks or 0, steps + 1, rows, lanes)
    out : (blocks, lanes, figures)
    scratch : Scratch
    first, stride : int
    """

    shape: Any
    job: Any
    samples: Any
    trace: Any
    out: Any
    scratch: Any
    first: Any
    stride: Any


_NUMBER: Any = "whole"
_REAL: Any = "real"


def _floats(dimensions: int) -> Any:
    return Array("float64", dimensions)


def _wholes(dimensions: int) -> Any:
    return Array("int64", dimensions)


GIVEN = Given(
    shape=Shape(*[_NUMBER] * 4),
    job=Job(
        theta=_floats(2),
        courses=Courses(
            settings=_floats(2),
            steps=_wholes(1),
            earliest_end=_wholes(1),
            times=_floats(2),
            clock=_wholes(1),
            first=_wholes(1),
            turns=_wholes(1),
            origins=_floats(2),
            trace=_wholes(1),
            traces=_floats(3),
        ),
        points=_wholes(2),
        candidates=_wholes(2),
        dt=_REAL,
        ring=_NUMBER,
        check_every=_NUMBER,
        checks_at_rest=_NUMBER,
    ),
    samples=Samples(_wholes(1), _wholes(2), _floats(3), _floats(2)),
    trace=_floats(4),
    out=_floats(3),
    scratch=Scratch(Array("real", 1), Array("real", 1), _floats(1)),
    first=_NUMBER,
    stride=_NUMBER,
)


def address(array: NDArray[Any]) -> int:
    """Address of an array's first number."""
    return int(array.__array_interface__["data"][0])


def scratch_for(shape: Shape, ring: int, real: Any) -> Scratch:
    """Memory of one thread, each part from the start of a cache line: a vector as long as one would straddle two.

    Parameters
    ----------
    shape : Shape
    ring : int
        Slots of a ring.
    real : type
    """
    lanes = shape.lanes
    return Scratch(
        _aligned(shape.rows * lanes, real),
        _aligned(max(3 * ring, shape.columns) * lanes, real),
        _aligned(2 * lanes, np.float64),
    )


def _aligned(count: int, real: Any) -> NDArray[Any]:
    size = np.dtype(real).itemsize
    whole = np.empty(count + CACHE_LINE // size, real)
    first = -(address(whole) // size) % (CACHE_LINE // size)
    return whole[first : first + count]


def fill(given: Given, real: Any) -> tuple[Ints, list[NDArray[Any]]]:
    """Table of arguments, and arrays that must outlive it.

    Parameters
    ----------
    given : Given
    real : type
        That the loop computes in.
    """
    entries: list[int] = []
    kept: list[NDArray[Any]] = []
    for described, value in zip(_LEAVES, _flat(given), strict=True):
        if isinstance(described, Array):
            kind = real if described.kind == "real" else described.kind
            # in place where the loop writes: those arrays are contiguous and of that kind
            array = np.ascontiguousarray(value, kind)
            if array.ndim != described.dimensions:
                raise TypeError(f"an array of {array.ndim} dimensions in place of {described.dimensions}")
            kept.append(array)
            entries += (address(array), *array.shape)
        elif described == _REAL:
            entries.append(int(np.float64(value).view(np.int64)))
        else:
            entries.append(int(value))
    return np.array(entries, np.int64), kept


def _flat(given: Given) -> tuple[Any, ...]:
    """All that is no tuple in it, in order; the same of its description."""
    job = given.job
    whole = (*given.shape, job.theta, *job.courses, *job[2:], *given.samples, given.trace, given.out)
    return *whole, *given.scratch, given.first, given.stride


_LEAVES = _flat(GIVEN)
