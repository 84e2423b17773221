"""Division of a trace into injections: runs above the threshold with hysteresis, split where they fuse."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats, IndexArray
from commonrail.signals.rate_trace import RateTrace
from commonrail.signals.settings import Levels

__all__ = ["Course", "Part", "averaged", "parts_of"]


SAME = 1e-6  # of the averaging time, below which two knots are one
DEEP = 6.0  # standard deviations by which the rate must fall for injections to be divided


class Course(NamedTuple):
    """Averaged rate, linear between its knots: times [s] and rates (knots,)."""

    time: Floats
    rate: Floats

    def crossing(self, first: int, level: float) -> float:
        """Time at which the rate passes a level between a knot and the next [s]."""
        (t0, t1), (r0, r1) = self.time[first : first + 2], self.rate[first : first + 2]
        return float(t0 + (level - r0) / (r1 - r0) * (t1 - t0))

    def rises(self, level: float, first: int, last: int) -> IndexArray:
        """Knots between two after which the rate rises above a level."""
        rate = self.rate[first : last + 1]
        return first + np.flatnonzero((rate[:-1] <= level) & (rate[1:] > level))

    def falls(self, level: float, first: int, last: int) -> IndexArray:
        """Knots between two after which the rate falls to a level or below."""
        rate = self.rate[first : last + 1]
        return first + np.flatnonzero((rate[:-1] > level) & (rate[1:] <= level))


class Part(NamedTuple):
    """Injection in a course: its first and last knot, and whether it touches another one there."""

    first: int
    last: int
    fused_before: bool = False
    fused_after: bool = False


def averaged(trace: RateTrace, width: float) -> Course:
    """Rate averaged over a width [s], exact for samples that are means."""
    knots = np.sort(np.concatenate([trace.bounds - 0.5 * width, trace.bounds + 0.5 * width]))
    knots = knots[np.concatenate(([True], np.diff(knots) > SAME * width))]
    slack = SAME * width
    inside = (knots >= trace.bounds[0] + 0.5 * width - slack) & (knots <= trace.bounds[-1] - 0.5 * width + slack)
    time = knots[inside]
    return Course(time, trace.means(time, width))


def parts_of(course: Course, levels: Levels, split: float) -> list[Part]:
    """Injections in the order of time.

    Parameters
    ----------
    course : Course
    levels : Levels
    split : float
        Share of the smaller neighbouring peak below which the rate must fall between two injections.
    """
    above = np.concatenate(([False], course.rate > levels.release, [False]))
    edges = np.flatnonzero(np.diff(above.astype(np.int8)))
    runs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    found: list[Part] = []
    for begin, end in runs:
        if course.rate[begin:end].max() > levels.trigger:
            first, last = max(begin - 1, 0), min(end, len(course.rate) - 1)
            found += _divided(course.rate, Part(first, last), levels, split)
    return found


def _divided(rate: Floats, part: Part, levels: Levels, split: float) -> Iterator[Part]:
    """The part, or those on both sides of its deepest valley, each divided further."""
    values = rate[part.first : part.last + 1]
    beside = np.minimum(np.maximum.accumulate(values), np.maximum.accumulate(values[::-1])[::-1])
    deep = (beside > levels.trigger) & (values < split * beside) & (beside - values > DEEP * levels.noise)
    if not deep.any():
        yield part
        return
    ratio = np.where(deep, values / np.where(deep, beside, 1.0), np.inf)
    valley = part.first + int(np.argmin(ratio))
    yield from _divided(rate, part._replace(last=valley, fused_after=True), levels, split)
    yield from _divided(rate, part._replace(first=valley, fused_before=True), levels, split)
