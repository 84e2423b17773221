"""Figures of a calibration or a comparison as plain numbers; drawing comes later, in `draw`."""

from __future__ import annotations

from collections.abc import Sequence

from commonrail.base.chart import Figure, Panel, Series
from commonrail.data.records import Plotted, Record, Traces, scaled
from commonrail.report.fit.record import by_kind, shown_of


def figures_of(record: Record, traces: Traces) -> list[Figure]:
    """Figures of the data of a calibration."""
    plotted = Plotted(shown_of(record), traces)
    return [f for view, own in by_kind(record["data"]) for d in own for f in view.figures(d, plotted)]


def comparison_figures(record: Record, traces: Traces) -> list[Figure]:
    """Figures of the data of a comparison: one colour, marker and dash for each model."""
    plotted = Plotted(shown_of(record), traces)
    return [f for view, own in by_kind(record["data"]) for d in own for f in view.compared_figures(d, plotted)]


def convergence_figure(generations: Sequence[Record]) -> Figure:
    """Best and mean objective of the population against the generation (the paper's Fig. 4)."""
    x = scaled(generations, "generation", 1.0)
    best, mean = (scaled(generations, key, 1.0) for key in ("best", "mean"))
    values = [v for v in (*best, *mean) if v is not None]
    spread = bool(values) and min(values) > 0.0 and max(values) > 5.0 * min(values)
    series = (Series("mean of the population", "mean", x, mean), Series("best", "best", x, best))
    return Figure(
        "Convergence",
        "Objective of the best member and mean over the population's finite members.",
        "generation",
        (Panel("objective", series, logarithmic=spread),),
    )
