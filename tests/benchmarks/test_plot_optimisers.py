"""Figure of a contest: medians where half of the searches are, and a panel for each problem."""

from __future__ import annotations

import pytest

pytest.importorskip("matplotlib", reason="matplotlib draws the figures of the benchmarks")

from benchmarks.plot_optimisers import draw_contest, medians


def row(problem: str, evaluations: list[int], best: list[float | None]) -> dict[str, object]:
    seconds = [float(n) for n in evaluations]
    return {
        "problem": problem,
        "optimiser": "one",
        "seed": 1,
        "evaluations": evaluations,
        "seconds": seconds,
        "best": best,
        "converged": None,
    }


def test_medians_begin_and_end_where_half_of_the_searches_do() -> None:
    rows = [row("p", [10, 20, 40], [4.0, 2.0, 1.0]), row("p", [20, 30], [None, 3.0]), row("p", [10, 30], [6.0, 5.0])]
    # at 10: 4, none, 6; at 20: 2, none, 6; at 30: 2, 3, 5; two of the three have ended by then
    assert medians(rows) == ([10, 20, 30], [6.0, 6.0, 3.0])


def test_every_problem_has_a_panel() -> None:
    figure = draw_contest([row("p", [10], [4.0]), row("q", [10], [5.0])])
    assert [axes.get_title() for axes in figure.axes] == ["p", "q"]
