"""Contest of optimisers: evaluations are those of the study's own search, and the standing is that of its rows."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.case import paper_study
from benchmarks.contest import PAPER, Problem, Trace, contest, entries, rank_optimisers, search_once
from commonrail.calibration.run import calibrate


def test_the_paper_s_search_takes_the_steps_that_calibrate_takes() -> None:
    study = paper_study(seed=3, generations=2)
    problem = Problem("paper", study, 1e-4)
    trace = search_once(study, entries(problem)[0], 3, 150)
    assert trace.evaluations == [50, 100, 150]
    assert trace.best == [g.best for g in calibrate(study, threads=1).history]
    assert trace.converged is None


def test_evaluations_of_residuals_count() -> None:
    (few,) = [e for e in entries(Problem("paper", paper_study(), 1e-4)) if e.name.endswith("2 starts")]
    trace = search_once(paper_study(), few, 1, 70, clock=iter(range(100)).__next__)
    # 64 draws and 2 starts, then 7 differences, 2 probes and 2 steps of each
    assert trace.evaluations == [66, 88]
    assert trace.seconds == [1, 2]
    assert trace.converged is False


def test_only_the_wanted_optimisers_run_beside_the_paper_s() -> None:
    problem = Problem("paper", paper_study(), 1e-4)
    rows = list(contest([problem], [1, 2], 50, ["staged"]))
    again = [("staged least squares", 1), ("staged least squares", 2)]
    assert [(row["optimiser"], row["seed"]) for row in rows] == [(PAPER, 1), (PAPER, 2), *again]


def row(name: str, seed: int, best: list[float]) -> dict[str, Any]:
    """A search of four steps with 25 evaluations and two seconds each."""
    steps = range(1, len(best) + 1)
    trace = Trace([25 * i for i in steps], [2.0 * i for i in steps], best, seed == 1 if name != PAPER else None)
    return {"problem": "p", "optimiser": name, "seed": seed} | trace._asdict()


def test_the_ranking_goes_by_medians_and_shares() -> None:
    rows = [
        row(PAPER, 1, [9.0, 8.0, 7.0, 6.0]),
        row(PAPER, 2, [9.0, 8.5, 7.5, 4.0]),
        row("other", 1, [8.0, 4.5, 3.0, 3.0]),
        row("other", 2, [8.0, 7.0, 4.0, 3.02]),
    ]
    paper, other = rank_optimisers(rows, 100)
    assert paper["best_known"] == 3.0
    assert (paper["end"], paper["near"], paper["near_evaluations"]) == (5.0, 0.0, None)
    assert (other["end"], other["near"]) == (pytest.approx(3.01), 1.0)
    assert (other["near_evaluations"], other["near_seconds"]) == (87.5, 7.0)  # 75 and 100; 6 and 8
    assert other["equal_evaluations"] == 62.5  # J = 5 at 50 and 75
    assert other["saving"] == pytest.approx(1.6)
    assert (paper["converged"], other["converged"]) == (0.0, 0.5)
    assert (paper["tenth"], other["tenth"]) == (None, None)  # no step is done by then
