"""Find the injections of a trace: start and end in the averaged course, instants, ramps and plateau."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.engine.operating_point import Energising
from commonrail.plugins.features.levels import Levels
from commonrail.plugins.features.rate_trace import RateTrace
from commonrail.plugins.features.settings import FeatureSettings

# Division of a trace into injections: runs above the threshold with hysteresis, split where injections fuse.

SAME = 1e-6  # share of the averaging time, below which two knots coincide
DEEP = 6.0  # standard deviations by which the rate must fall to divide injections


class Course(NamedTuple):
    """Averaged rate, linear between its knots: times [s] and rates (knots,)."""

    time: Floats
    rate: Floats

    def crossing(self, first: int, level: float) -> float:
        """Time at which the rate passes a level between a knot and the next [s]."""
        (t0, t1), (r0, r1) = self.time[first : first + 2], self.rate[first : first + 2]
        return float(t0 + (level - r0) / (r1 - r0) * (t1 - t0))

    def rises(self, level: float, first: int, last: int) -> IndexArray:
        """Knots between two others after which the rate rises above a level."""
        rate = self.rate[first : last + 1]
        return first + np.flatnonzero((rate[:-1] <= level) & (rate[1:] > level))

    def falls(self, level: float, first: int, last: int) -> IndexArray:
        """Knots between two others after which the rate falls to a level or below."""
        rate = self.rate[first : last + 1]
        return first + np.flatnonzero((rate[:-1] > level) & (rate[1:] <= level))


class Segment(NamedTuple):
    """Injection in a curve: first and last knot, and whether it is fused with a neighbour there."""

    first: int
    last: int
    fused_before: bool = False
    fused_after: bool = False


def average(trace: RateTrace, width: float) -> Course:
    """Rate averaged over a width [s], exact for samples that are means."""
    knots = np.sort(np.concatenate([trace.bounds - 0.5 * width, trace.bounds + 0.5 * width]))
    knots = knots[np.concatenate(([True], np.diff(knots) > SAME * width))]
    slack = SAME * width
    inside = (knots >= trace.bounds[0] + 0.5 * width - slack) & (knots <= trace.bounds[-1] - 0.5 * width + slack)
    time = knots[inside]
    return Course(time, trace.means(time, width))


def find_segments(course: Course, levels: Levels, split: float) -> list[Segment]:
    """Find injections, in the order of time.

    `split`: share of the smaller neighbouring peak below which the rate must fall between two injections.
    """
    above = np.concatenate(([False], course.rate > levels.release, [False]))
    edges = np.flatnonzero(np.diff(above.astype(np.int8)))
    runs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    segments: list[Segment] = []
    for begin, end in runs:
        if course.rate[begin:end].max() > levels.trigger:
            first, last = max(begin - 1, 0), min(end, len(course.rate) - 1)
            segments += _split_segment(course.rate, Segment(first, last), levels, split)
    return segments


def _split_segment(rate: Floats, segment: Segment, levels: Levels, split: float) -> Iterator[Segment]:
    """Yield the segment, or both sides of its deepest valley, divided further."""
    values = rate[segment.first : segment.last + 1]
    beside = np.minimum(np.maximum.accumulate(values), np.maximum.accumulate(values[::-1])[::-1])
    deep = (beside > levels.trigger) & (values < split * beside) & (beside - values > DEEP * levels.noise)
    if not deep.any():
        yield segment
        return
    ratio = np.where(deep, values / np.where(deep, beside, 1.0), np.inf)
    valley = segment.first + int(np.argmin(ratio))
    yield from _split_segment(rate, segment._replace(last=valley, fused_after=True), levels, split)
    yield from _split_segment(rate, segment._replace(first=valley, fused_before=True), levels, split)


# Reasons for missing features of a trace, each with a sentence that says what to do.


class FeatureStatus(StrEnum):
    """Outcome of the search for the features of a trace, or of one injection in it."""

    OK = "ok"
    NO_INJECTION = "no injection"
    HIDDEN_IN_NOISE = "hidden in noise"
    CUT_AT_START = "cut at start"
    CUT_AT_END = "cut at end"
    FUSED = "fused"
    NO_PLATEAU = "no plateau"
    NO_ENERGISING = "no energising"
    REOPENED = "reopened"

    @property
    def sentence(self) -> str:
        """Meaning and cure in one sentence."""
        return _SENTENCES[self]


_SENTENCES = {
    FeatureStatus.OK: "All features were found.",
    FeatureStatus.NO_INJECTION: "The rate does not rise above the threshold; lower the threshold if something is seen.",
    FeatureStatus.HIDDEN_IN_NOISE: (
        "The noise is too large for the threshold: four standard deviations exceed its hysteresis; raise the "
        "threshold or average over a longer time."
    ),
    FeatureStatus.CUT_AT_START: "The trace begins while fuel is injected; it has no opening.",
    FeatureStatus.CUT_AT_END: "The trace ends while fuel is injected; it has no closing.",
    FeatureStatus.FUSED: (
        "The rate does not fall below the threshold between this injection and the next or the previous one; they are "
        "divided where the rate is smallest."
    ),
    FeatureStatus.NO_PLATEAU: "The rate is near its largest value for less than half of the duration; none is steady.",
    FeatureStatus.NO_ENERGISING: "No energising starts before this injection; it has no delays.",
    FeatureStatus.REOPENED: "The injector opened again after the same energising.",
}


PLATEAU = 0.5  # least share of the duration near the largest rate for an injection with a steady rate
ROUNDS = 3  # iterations of slope and averaging width at an instant: the first mean is wide and underestimates the slope
# A mean over w has an error of w²/24 times the second derivative: 4/24 of the second difference over w/2. A second
# difference over w would extend farther beyond the mean.
BEND = 4.0 / 24.0
MIDDLE = 0.25  # share omitted at both ends of the plateau


class Instant(NamedTuple):
    """Time at which the rate passes the threshold and its standard error [s]; NaN if it does not."""

    time: float = math.nan
    error: float = math.nan


class Instants(NamedTuple):
    """Opening and closing, and the dividing times [s] that replace them between fused injections."""

    opening: Instant
    closing: Instant
    begin: float
    end: float


def find_instants(trace: RateTrace, course: Course, segment: Segment, levels: Levels) -> Instants:
    """Find the last rise above the threshold before the trigger, and the first fall below it after the trigger."""
    rate = course.rate[segment.first : segment.last + 1]
    high = segment.first + np.flatnonzero(rate > levels.trigger)
    rises = course.rises(levels.threshold, segment.first, int(high[0]))
    falls = course.falls(levels.threshold, int(high[-1]), segment.last)
    margin = min(levels.threshold, float(rate.max()) - levels.threshold)
    opening, closing = Instant(), Instant()
    if len(rises):
        opening = _passing(trace, course.crossing(int(rises[-1]), levels.threshold), 1, margin, levels)
    if len(falls):
        closing = _passing(trace, course.crossing(int(falls[0]), levels.threshold), -1, margin, levels)
    begin = opening.time if len(rises) else float(course.time[segment.first])
    end = closing.time if len(falls) else float(course.time[segment.last])
    return Instants(opening, closing, begin, end)


def _passing(trace: RateTrace, time: float, sign: int, margin: float, levels: Levels) -> Instant:
    """Find a passing of the threshold with an averaging that stays on the straight part of the ramp.

    A mean over more than twice the distance to the foot or the top of the ramp would move the passing. The slope
    between the passing and a mean within the injection gives that distance.

    `time`: passing of the rate averaged over `levels.width` [s]. `sign`: 1 for a rise, -1 for a fall. `margin`: from
    the threshold to zero or to the largest rate, whichever is nearer [m³/s or kg/s].
    """
    first, level = time, levels.threshold
    narrowest = max(levels.narrowest, trace.interval)
    width = max(levels.width, trace.interval)
    inner = width = max(width, narrowest)
    slope = 0.0
    for _ in range(ROUNDS):
        slope = 2.0 * (float(trace.means(time + 0.5 * sign * inner, inner)) - level) / inner
        if not slope > 0.0:
            break
        width = min(max(2.0 * margin / slope, narrowest), width)
        time = _nearest_passing(trace, first, sign, width, levels)
    if not slope > 0.0:
        return Instant(time, math.inf)
    bend = second_difference(trace, time, width)
    noise = levels.noise * math.sqrt(max(levels.width / width, 1.0))
    return Instant(time, math.hypot(noise, bend) / slope)


def second_difference(trace: RateTrace, time: float, width: float) -> float:
    """Difference between the mean over a width [s] around a time [s] and the rate there, from its second difference."""
    before, here, after = trace.means([time - 0.5 * width, time, time + 0.5 * width], 0.5 * width)
    return abs(float(before - 2.0 * here + after)) * BEND


def _nearest_passing(trace: RateTrace, time: float, sign: int, width: float, levels: Levels) -> float:
    """Find the passing of the averaged rate nearest to a time [s]; without one return the time itself."""
    reach = levels.width + trace.interval
    inside = (trace.bounds > time - reach - width) & (trace.bounds < time + reach + width)
    knots = np.unique(np.concatenate([trace.bounds[inside] - 0.5 * width, trace.bounds[inside] + 0.5 * width]))
    course = Course(knots, trace.means(knots, width))
    passes = (course.rises if sign > 0 else course.falls)(levels.threshold, 0, len(knots) - 1)
    times = [course.crossing(int(knot), levels.threshold) for knot in passes]
    return min(times, key=lambda candidate: abs(candidate - time), default=time)


class Ramps(NamedTuple):
    """Times of the opening and closing ramps, and instants between which the rate is above both shares [s]."""

    rise: float
    fall: float
    begin: float
    end: float


@dataclass(frozen=True)
class TracedInjection:
    """One injection of a trace, with all data that its features need.

    Attributes
    ----------
    trace : RateTrace
    course : Course
        The averaged trace.
    segment : Segment
        The injection in the course.
    levels : Levels
    settings : FeatureSettings
    at : Instants
        Opening and closing.
    window : (float, float)
        Times between which its quantity counts [s].
    windows : tuple of (float, float)
        Windows of all injections after its energising; its own window if the energising is unknown; empty for a
        reopening.
    pulse : Energising or None
        None if it is unknown, and for a reopening.
    before : Instant
        Closing of the previous injection.
    """

    trace: RateTrace
    course: Course
    segment: Segment
    levels: Levels
    settings: FeatureSettings
    at: Instants
    window: tuple[float, float]
    windows: tuple[tuple[float, float], ...]
    pulse: Energising | None
    before: Instant

    @cached_property
    def peak(self) -> float:
        """Largest mean over the peak averaging within the injection [m³/s or kg/s]."""
        trace, course = self.trace, self.course
        segment, at = self.segment, self.at
        width = max(self.settings.peak_averaging, trace.interval)
        low = at.begin + (0.5 * width if segment.fused_before else 0.0)
        high = at.end - (0.5 * width if segment.fused_after else 0.0)
        inside = course.time[(course.time >= low) & (course.time <= high)]
        return float(
            trace.means(inside, width).max() if len(inside) else course.rate[segment.first : segment.last + 1].max()
        )

    @cached_property
    def ramps(self) -> Ramps:
        """Ramps between the shares of the largest rate in the settings; NaN if one is missing."""
        course, segment = self.course, self.segment
        low, high = (share * self.peak for share in self.settings.ramp)
        rises = course.rises(high, segment.first, segment.last)
        falls = course.falls(high, segment.first, segment.last)
        up = course.crossing(int(rises[0]), high) if len(rises) else math.nan
        down = course.crossing(int(falls[-1]), high) if len(falls) else math.nan
        before = course.rises(low, segment.first, int(rises[0]) + 1) if len(rises) else rises
        after = course.falls(low, int(falls[-1]), segment.last) if len(falls) else falls
        rise = up - course.crossing(int(before[-1]), low) if len(before) else math.nan
        fall = course.crossing(int(after[0]), low) - down if len(after) else math.nan
        return Ramps(rise, fall, up, down)

    @cached_property
    def steady(self) -> float:
        """Mean of the middle half of the plateau [m³/s or kg/s]; NaN if the plateau is too short."""
        begin, end = self.ramps.begin, self.ramps.end
        if not end - begin > PLATEAU * (self.at.end - self.at.begin):
            return math.nan
        left_out = MIDDLE * (end - begin)
        begin, end = begin + left_out, end - left_out
        return self.trace.quantity(begin, end) / (end - begin)

    @property
    def statuses(self) -> tuple[FeatureStatus, ...]:
        """Reasons for missing features of the injection."""
        no_opening, no_closing = math.isnan(self.at.opening.time), math.isnan(self.at.closing.time)
        segment = self.segment
        reasons = {
            FeatureStatus.FUSED: (no_opening and segment.fused_before) or (no_closing and segment.fused_after),
            FeatureStatus.CUT_AT_START: no_opening and not segment.fused_before,
            FeatureStatus.CUT_AT_END: no_closing and not segment.fused_after,
            FeatureStatus.NO_PLATEAU: math.isnan(self.steady),
        }
        return tuple(status for status, applies in reasons.items() if applies)
