"""Figure of a contest of optimisers as SVG: ``python -m benchmarks.plot_optimisers RECORD.json FILE.svg``.

The record is the output of ``python -m benchmarks optimisers --out RECORD.json``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from statistics import median
from typing import Any

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.contest import Trace
from benchmarks.plot import STYLE
from commonrail.report.figure import FAMILIES

__all__ = ["draw_contest", "medians"]

Row = dict[str, Any]
DASHES = ("-", "--", "-.", ":")  # in addition to the colours of the reports


def medians(rows: list[Row]) -> tuple[list[int], list[float]]:
    """Evaluations at which any of the searches of one optimiser had done a step, and the median objective there.

    From the number at which half of the searches have an objective, to the largest that half of them reach.
    """
    traces = [Trace(r["evaluations"], r["seconds"], [_known(j) for j in r["best"]], r["converged"]) for r in rows]
    last = median(trace.evaluations[-1] for trace in traces)
    grid = sorted({n for trace in traces for n in trace.evaluations if n <= last})
    steps = [(n, median(trace.after(n) for trace in traces)) for n in grid]
    finite = [(n, j) for n, j in steps if j < float("inf")]
    return [n for n, _ in finite], [j for _, j in finite]


def draw_contest(rows: list[Row]) -> Figure:
    """Median objective above the best known, against evaluations, one panel for each problem."""
    problems = list(dict.fromkeys(row["problem"] for row in rows))
    size = 4.6 * len(problems), 3.9
    figure, grid = plt.subplots(1, len(problems), squeeze=False, figsize=size, layout="constrained")
    for axes, problem in zip(grid[0], problems, strict=True):
        _panel(axes, problem, [row for row in rows if row["problem"] == problem])
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    figure.suptitle("median of the seeds; one evaluation is one candidate at all operating points", fontsize=8)
    return figure


def _panel(axes: Axes, problem: str, rows: list[Row]) -> None:
    best_known = min(min(map(_known, row["best"])) for row in rows)
    for i, name in enumerate(dict.fromkeys(row["optimiser"] for row in rows)):
        optimiser_rows = [row for row in rows if row["optimiser"] == name]
        evaluations, objective = medians(optimiser_rows)
        excess = [max(100.0 * (j / best_known - 1.0), 1e-3) for j in objective]
        look: dict[str, Any] = {
            "color": FAMILIES[i % len(FAMILIES)],
            "linestyle": DASHES[i % len(DASHES)],
        }  # those of the reports
        axes.step(evaluations, excess, where="post", label=f"{name} ({len(optimiser_rows)})", **look)
    axes.set(xscale="log", yscale="log", title=problem, xlabel="evaluations", ylabel="J above the best known, %")


def _known(objective: float | None) -> float:
    return float("inf") if objective is None else objective


def main() -> None:
    """Draw into a file."""
    if len(sys.argv) != 3:
        sys.exit("usage: python -m benchmarks.plot_optimisers RECORD.json FILE.svg")
    rows = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["searches"]
    with plt.rc_context(STYLE):
        figure = draw_contest(rows)
        figure.savefig(sys.argv[2], metadata={"Date": None}, bbox_inches="tight")


if __name__ == "__main__":
    main()
