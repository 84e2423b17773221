"""Standing of optimisers after a contest: medians over seeds, against the best known and against the paper's search."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any

from commonrail.bench.contest import PAPER, Trace

__all__ = ["NEAR", "standing"]

NEAR = 1.01  # of the best known objective counts as reached


def standing(rows: Sequence[dict[str, Any]], evaluations: int) -> list[dict[str, Any]]:
    """One row for each problem and optimiser, in the order of the contest.

    Parameters
    ----------
    rows : sequence of dict
        As `contest` yields them.
    evaluations : int
        Of each search.

    Returns
    -------
    list of dict
        "tenth" and "end": median objective after a tenth of the evaluations, and after all; None before the first
        step. "near": share of the seeds that come within 1 % of the best known, of any search in `rows`;
        "near_evaluations", "near_seconds": their median, None where half of the seeds do not. "equal_evaluations": the
        median number until the median end of the paper's search is reached, None where half of the seeds do not reach
        it; "saving", how many times fewer than its own they are. "converged": share of the seeds that say so.
    """
    found = []
    for problem in dict.fromkeys(row["problem"] for row in rows):
        own = [row for row in rows if row["problem"] == problem]
        traces = {name: [_trace(row) for row in own if row["optimiser"] == name] for name in _names(own)}
        known = min(min(trace.best) for group in traces.values() for trace in group)
        paper = median(trace.after(evaluations) for trace in traces[PAPER]) if PAPER in traces else None
        for name, group in traces.items():
            equal = _reached(group, paper) if paper is not None else (None, None, 0.0)
            near = _reached(group, NEAR * known)
            found.append(
                {
                    "problem": problem,
                    "optimiser": name,
                    "seeds": len(group),
                    "best_known": known,
                    "tenth": _finite(median(trace.after(evaluations // 10) for trace in group)),
                    "end": _finite(median(trace.after(evaluations) for trace in group)),
                    "near": near[2],
                    "near_evaluations": near[0],
                    "near_seconds": near[1],
                    "equal_evaluations": equal[0],
                    "saving": evaluations / equal[0] if equal[0] else None,
                    "seconds": median(trace.seconds[-1] for trace in group),
                    "converged": sum(bool(trace.converged) for trace in group) / len(group),
                }
            )
    return found


def _names(rows: Iterable[dict[str, Any]]) -> list[str]:
    return list(dict.fromkeys(row["optimiser"] for row in rows))


def _finite(objective: float) -> float | None:
    return objective if objective < float("inf") else None


def _trace(row: dict[str, Any]) -> Trace:
    best = [float("inf") if j is None else j for j in row["best"]]
    return Trace(row["evaluations"], row["seconds"], best, row["converged"])


def _reached(group: Sequence[Trace], objective: float) -> tuple[float | None, float | None, float]:
    """Median evaluations and seconds until an objective, None where half of the searches miss it, and their share."""
    hits = [trace.reaching(objective) for trace in group]
    share = sum(hit is not None for hit in hits) / len(hits)
    endless = (float("inf"), float("inf"))
    middle = [median((hit or endless)[i] for hit in hits) for i in (0, 1)]
    return (*(value if value < float("inf") else None for value in middle), share)  # type: ignore[return-value]
