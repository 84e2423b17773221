"""Figures 4, 5 and 6 of the paper from the summary and the curves of a reproduction."""

from __future__ import annotations

import math
from collections.abc import Mapping

from commonrail.base.arrays import Floats
from commonrail.base.chart import MARKERS, Band, Boxes, Figure, Panel, Series, points
from commonrail.base.text import count_noun
from commonrail.data.records import MICROSECOND, MM3_PER_MS
from commonrail.plugins.paper.file import CurveFacts, ReproductionSummary

# Labels of the models that the paper's Fig. 6 shows, with their looks.
SHOWN = {"rigid": "rigid", "rigid_fitted": "rigid fitted", "theoretical": "start", "optimised": "best"}


def convergence(summary: ReproductionSummary) -> Figure:
    """Best and mean J against generation, medians and quartiles over the seeds (the paper's Fig. 4)."""
    courses = summary.convergence
    x = tuple(float(generation) for generation in courses.generation)
    series = [
        Series("mean of the population", "mean", x, points(courses.mean.median)),
        Series("best", "best", x, points(courses.best.median)),
    ]
    if math.isfinite(courses.level):
        series.append(Series("theoretical model", "level", (x[0], x[-1]), (courses.level, courses.level)))
    bands = tuple(
        Band(look, x, points(course.low), points(course.high))
        for look, course in (("mean", courses.mean), ("best", courses.best))
    )
    seeds = count_noun(len(summary.seeds), "seed")
    return Figure(
        "Convergence (Fig. 4)",
        f"J at 160 MPa of (70, 50) against generation: medians over {seeds}; bands span the quartiles.",
        "generation",
        (Panel("J, mm³/ms", tuple(series), logarithmic=True, bands=bands),),
    )


def search_boxes(summary: ReproductionSummary) -> Figure:
    """Box plots of k1…k7 over the search, relative to theory (the paper's Fig. 5)."""
    rows = summary.search
    at = tuple(float(i) for i in range(len(rows)))
    seeds = count_noun(len(summary.seeds), "seed")
    boxes = (
        Boxes(f"seed {summary.shown_seed}", "start", tuple(row.seed for row in rows), -0.17),
        Boxes(f"all of {seeds}", "best", tuple(row.every for row in rows), 0.17),
    )
    ends = (at[0] - 0.5, at[-1] + 0.5)
    series = (
        Series("paper's optimal k", "paper", at, tuple(row.paper for row in rows), MARKERS),
        Series("theoretical", "level", ends, (1.0, 1.0)),
        Series("bounds", "solid", at, tuple(row.lower for row in rows), MARKERS, 5),
        Series("", "solid", at, tuple(row.upper for row in rows), MARKERS, 5),
    )
    return Figure(
        "Spread of k1…k7 over the search (Fig. 5)",
        "All members of all generations of (70, 50) at 160 MPa, each stiffness over its theoretical value; outliers "
        "beyond 1.5 interquartile ranges are left out of the whiskers.",
        "stiffness",
        (Panel("k / k theoretical", series, boxes=boxes, categories=tuple(row.symbol for row in rows)),),
    )


def rates(summary: ReproductionSummary, traces: Mapping[int, Mapping[str, Mapping[str, Floats]]]) -> list[Figure]:
    """Rate and error at each pressure for one seed (the paper's Fig. 6)."""
    shown = traces[summary.shown_seed]
    return [_rate(summary, curve, shown[curve.name]) for curve in summary.data]


def _rate(summary: ReproductionSummary, curve: CurveFacts, trace: Mapping[str, Floats]) -> Figure:
    time = points(trace["time_s"] * MICROSECOND)
    experiment = trace["experiment"]
    texts = summary.labels
    curves = [Series("synthetic experiment", "measured", time, points(experiment * MM3_PER_MS))]
    curves += [Series(texts[k], look, time, points(trace[k] * MM3_PER_MS)) for k, look in SHOWN.items()]
    errors = [Series("", look, time, points((trace[k] - experiment) * MM3_PER_MS)) for k, look in SHOWN.items()]
    return Figure(
        f"Rate of injection at {curve.name} ({curve.role}) (Fig. 6)",
        f"Energising time {curve.energising_time * MICROSECOND:.0f} µs, seed {summary.shown_seed}; below, "
        "simulated − synthetic experiment, cut at the range of the optimised model.",
        "time, µs",
        (
            Panel("rate, mm³/ms", tuple(curves), 0.6),
            Panel("error, mm³/ms", tuple(errors), 0.4, zero_line=True, scaled_by="best"),
        ),
    )
