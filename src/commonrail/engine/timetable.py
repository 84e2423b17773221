"""Boundary courses and the drive's schedule against time, for the reference."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.engine.operating_point import Course, OperatingPoint, Trace


class Segment(NamedTuple):
    """A stretch of time [s] in which the schedule does not change: energised, and in the peak phase (1 or 0)."""

    start: float
    stop: float
    on: float
    peak: float


def courses(point: OperatingPoint) -> tuple[Course, Course, Course, Course]:
    """Rail, cylinder and return pressure [Pa] and the drive's trace, zero if there is none."""
    drive: Course = 0.0 if point.drive is None else point.drive
    return point.rail_pressure, point.cylinder_pressure, point.return_pressure, drive


def value_at(course: Course, t: float) -> float:
    """Value of a course at a time [s]."""
    return float(np.interp(t, course.time, course.value)) if isinstance(course, Trace) else course


def knots(point: OperatingPoint) -> Floats:
    """Times [s] at which the slope of a course may change."""
    return np.array([t for course in courses(point) if isinstance(course, Trace) for t in course.time])


def segments(point: OperatingPoint, peak_duration: float, start: float, stop: float) -> Sequence[Segment]:
    """The schedule from `start` to `stop` [s], peak phases `peak_duration` [s] long."""
    edges = {start, stop}
    for pulse in point.pulses:
        edges |= {pulse.start, pulse.start + pulse.duration, pulse.start + min(peak_duration, pulse.duration)}
    inside = sorted(e for e in edges if start <= e <= stop)
    return [Segment(a, b, *_schedule(point, peak_duration, 0.5 * (a + b))) for a, b in pairwise(inside)]


def _schedule(point: OperatingPoint, peak_duration: float, t: float) -> tuple[float, float]:
    for pulse in point.pulses:
        if pulse.start <= t < pulse.start + pulse.duration:
            return 1.0, float(t < pulse.start + peak_duration)
    return 0.0, 0.0
