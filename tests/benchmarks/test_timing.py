"""The shortest of several runs counts, within runs and seconds."""

from __future__ import annotations

import pytest

from benchmarks.timing import Effort, Timing, time_best
from tests.benchmarks.conftest import HandClock


def test_the_shortest_run_counts_with_its_own_processor_time(clock: HandClock) -> None:
    durations = iter([3.0, 1.0, 2.0])
    found = time_best(lambda: clock.pass_by(next(durations)), Effort(3, 100.0), clock.clocks)
    assert found == Timing(1.0, 0.5, 3)


@pytest.mark.parametrize(("seconds", "runs"), [(0.0, 1), (2.5, 3), (100.0, 5)])
def test_no_run_is_begun_after_the_time_is_spent(clock: HandClock, seconds: float, runs: int) -> None:
    assert time_best(lambda: clock.pass_by(1.0), Effort(5, seconds), clock.clocks).runs == runs
