"""Populations in processes of their own, and what is told when one of them dies."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

from benchmarks import curves
from benchmarks.timing import Effort

EFFORT = Effort(1, 0.0)
Done = subprocess.CompletedProcess


def test_a_population_tells_its_time_and_memory_and_not_that_of_who_asked() -> None:
    asked_by = np.ones(100_000_000)  # 800 MB; the population's process needs a third
    (row,) = curves.population_curve((8,), EFFORT)
    assert row["candidates"] == 8
    assert row["per_second"] == pytest.approx(8 / row["seconds"])
    assert row["peak_bytes"] is None or asked_by.nbytes > row["peak_bytes"] >= row["before_bytes"] > 1e7


@pytest.mark.parametrize(("status", "words"), [(-9, "signal 9"), (1, "ended with status 1: MemoryError")])
def test_a_process_that_dies_is_told_and_the_next_is_measured(status: int, words: str) -> None:
    ends = iter([Done([], status, "", "Traceback\nMemoryError\n"), Done([], 0, '{"candidates": 2}', "")])
    dead, alive = curves.population_curve((1, 2), EFFORT, lambda *_: next(ends))
    assert words in dead["failed"]
    assert alive == {"candidates": 2}


def test_a_process_that_never_ends_is_told() -> None:
    def hang(module: str, arguments: list[str], seconds: float) -> Done[str]:
        raise subprocess.TimeoutExpired(module, seconds)

    (row,) = curves.population_curve((1,), EFFORT, hang)
    assert "within" in row["failed"]


def test_threads_double_up_to_the_most() -> None:
    assert [row["threads"] for row in curves.thread_curve(3, EFFORT)] == [1, 2, 3]


def test_points_and_horizons_are_those_asked_for() -> None:
    assert [row["points"] for row in curves.point_curve((1, 2), EFFORT)] == [1, 2]
    assert [row["horizon"] for row in curves.horizon_curve((1e-4, 2e-4), EFFORT)] == [1e-4, 2e-4]
