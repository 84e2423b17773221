"""Wall and processor time of an action, best of several warm runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple


class Clocks(NamedTuple):
    """Functions that tell wall time and the process's processor time [s]."""

    wall: Callable[[], float]
    processor: Callable[[], float]


class Effort(NamedTuple):
    """Limits of a timing: number of runs, and seconds after which no run begins."""

    runs: int
    seconds: float


class Timing(NamedTuple):
    """Shortest wall time [s], processor time of that run [s], and how many runs were made."""

    seconds: float
    cpu_seconds: float
    runs: int


CLOCKS = Clocks(time.perf_counter, time.process_time)


def time_best(action: Callable[[], Any], effort: Effort, clocks: Clocks = CLOCKS) -> Timing:
    """Time an action that has been run before, since the first run compiles and loads.

    The shortest run is the one least disturbed by others on the machine; processor time does not see waiting.
    """
    timings: list[tuple[float, float]] = []
    while len(timings) < effort.runs and (not timings or sum(wall for wall, _ in timings) < effort.seconds):
        wall, processor = clocks.wall(), clocks.processor()
        action()
        timings.append((clocks.wall() - wall, clocks.processor() - processor))
    return Timing(*min(timings), len(timings))
