"""Arrays that a run of the fast engines is given: operating points, candidates, samples to compare with."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arrays import Floats, Ints
from commonrail.base.choices import Precision
from commonrail.physics.law import CACHE_LINE
from commonrail.physics.model import Inputs


class Vector(NamedTuple):
    """Width of a block in candidates, and the type of its numbers."""

    lanes: int
    real: Any

    @property
    def precision(self) -> Precision:
        """Name of the type."""
        return Precision.F64 if self.real is np.float64 else Precision.F32


class Courses(NamedTuple):
    """Boundary conditions at each operating point.

    The clocks of `Inputs`, times since the current energising has begun and has ended, are the time less two origins.
    These turn to those of the next energising in the step in which that one begins.
    """

    # (points, 3): rail, cylinder and return pressure at time zero [Pa], and throughout where a point has no trace
    settings: Floats
    steps: Ints  # (points,) int
    earliest_end: Ints  # (points,) int: first step at which an injection may have ended
    times: Floats  # (clocks, steps): starts of the steps [s]
    clock: Ints  # (points,) int: row of a point's `times`
    first: Ints  # (points,) int: place of a point's first turn, which is in step 0
    turns: Ints  # (turns,) int: steps of the turns; behind those of each point one that is never reached
    origins: Floats  # (turns, 4): origins from a turn on, and the two clocks in its own step [s]
    # (points,) int: row of a point's `traces`, −1 where all its pressures are constant and no trace drives it
    trace: Ints
    # (traces, steps, 4): means over each step of rail, cylinder and return pressure [Pa] and of the drive's trace
    traces: Floats

    @property
    def inputs(self) -> Floats:
        """Fields of `Inputs` in every step, (points, steps, 6), for what reads them from a table."""
        inputs = np.zeros((len(self.steps), self.times.shape[1], len(Inputs._fields)))
        for point, steps in enumerate(self.steps.tolist()):
            own, times = inputs[point, :steps], self.times[self.clock[point]]
            own[:, :3] = self.settings[point]
            if self.trace[point] >= 0:
                own[:, :4] = self.traces[self.trace[point], :steps]
            turn = int(self.first[point])
            while self.turns[turn] < steps:
                here, following = int(self.turns[turn]), min(int(self.turns[turn + 1]), steps)
                own[here:following, 4:] = times[here:following, None] - self.origins[turn, :2]
                own[here, 4:] = self.origins[turn, 2:]
                turn += 1
        return inputs


class Job(NamedTuple):
    """All that a run needs, as arrays.

    Attributes
    ----------
    theta : (candidates, parameters + fuel coefficients)
    courses : Courses
        Or those of another machine, such as `cuda_kernel.Table`.
    points, candidates : (blocks, lanes) int
        Operating point and candidate of each lane. All lanes of a block have the same `times`.
    dt : float
        [s].
    ring : int
        Slots of a ring buffer, a power of two above the longest delay.
    check_every : int
        Steps between checks of health and rest.
    checks_at_rest : int
        Checks for which needle and valve must have rested before a simulation ends; 0: it runs to its horizon.
    """

    theta: Floats
    courses: Any
    points: Ints
    candidates: Ints
    dt: float
    ring: int
    check_every: int
    checks_at_rest: int


class Samples(NamedTuple):
    """Samples of a rate to compare with, at each operating point."""

    bound_count: Ints  # (points,) int
    due: Ints  # (points, bounds) int: step in which a sample ends
    samples: Floats  # (points, bounds, 4): fields of `Sample`
    density: Floats  # (1 or candidates, points): as in `lanes.Misfit`


# Table of addresses and numbers through which a loop over blocks is called, the same from a library and from Numba.
#
# Every entry is a whole number of 64 bits, in the order of the fields of `Given`: of an array its address and its
# lengths, in C order; a real number as its bits.


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

    `ring`: slots of a ring.
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
    """Table of arguments, and arrays that must outlive it; `real`: that the loop computes in."""
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
