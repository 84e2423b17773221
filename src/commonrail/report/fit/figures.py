"""Figures of a calibration as plain numbers; drawing comes later, in `draw`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from commonrail.base.chart import Figure, HeatMap, Panel, Series
from commonrail.base.text import megapascal, number, to_signed
from commonrail.calibration.record import GenerationRecord
from commonrail.data.quantities.data import QuantityData
from commonrail.data.quantities.returned import ReturnData
from commonrail.data.records import JUDGED, MEASURED, MICROSECOND, MM3, Record, Texts, Traces, origin_word
from commonrail.report.data.view import Plotted
from commonrail.report.fit.record import by_kind, shown_of


def figures_of(data: Sequence[Record], texts: Texts, traces: Traces) -> list[Figure]:
    """Figures of the data of a calibration; `texts` are the texts of its labels."""
    plotted = Plotted(shown_of(texts), traces)
    return [f for view, records in by_kind(data) for d in records for f in view.figures(d, plotted)]


def convergence_figure(generations: Sequence[GenerationRecord]) -> Figure:
    """Best and mean objective of the population against the generation (the paper's Fig. 4)."""
    x = tuple(float(g.generation) for g in generations)
    best, mean = (
        tuple(generation.best for generation in generations),
        tuple(generation.mean for generation in generations),
    )
    values = [v for v in (*best, *mean) if v is not None]
    spread = bool(values) and min(values) > 0.0 and max(values) > 5.0 * min(values)
    series = (Series("mean of the population", "mean", x, mean), Series("best", "best", x, best))
    note = "Objective of the best member and mean over the population's finite members."
    return Figure("Convergence", note, "generation", (Panel("objective", series, logarithmic=spread),))


# Heat maps of the errors of measured quantity maps: all quantities in percent, small quantities in mm³.

COLUMNS = 22  # most columns; further energising times share a column
LARGEST_PERCENT, LARGEST_MM3 = 20.0, 1.0  # beyond them the colour stays the same


class _Point(NamedTuple):
    """Rail pressure [Pa], energising time [us], measured quantity [m³] and error [m³]."""

    rail: float
    time: float
    measured: float
    error: float


def error_maps(data: Sequence[Record]) -> list[HeatMap]:
    """Heat maps of each quantity map of a calibration; none for one with fewer than two pressures or four points."""
    kinds = (QuantityData.kind, ReturnData.kind)
    return [heat for record in data if record["kind"] in kinds for heat in _maps(record)]


def _maps(data: Record) -> list[HeatMap]:
    points = [
        _Point(
            float(row["rail_pressure"]),
            float(row["energising_time"]) * MICROSECOND,
            float(row[MEASURED]),
            best - row[MEASURED],
        )
        for row in data["rows"]
        if not row.get("dead_time") and (best := number(row.get(JUDGED))) is not None
    ]
    if len(points) < 4 or len({point.rail for point in points}) < 2:
        return []
    limit = float(data["figures"].get(JUDGED, {}).get("limit_quantity", 3e-9))
    large = [point for point in points if point.measured > limit]
    small = [point for point in points if point.measured <= limit]
    what = f"{data['name']} ({data['role']})"
    maps = []
    if large:
        title = f"Error of {what}, % of the quantity, above {limit * MM3:.3g} mm³"
        maps.append(_heat(large, [100.0 * p.error / p.measured for p in large], title, ("%", 1, LARGEST_PERCENT), data))
    if small:
        title = f"Error of {what}, mm³, quantities up to {limit * MM3:.3g} mm³"
        maps.append(_heat(small, [p.error * MM3 for p in small], title, ("mm³", 2, LARGEST_MM3), data))
    return maps


def _heat(
    points: Sequence[_Point], errors: Sequence[float], title: str, scale: tuple[str, int, float], data: Record
) -> HeatMap:
    """Heat map of the errors at points; `scale`: unit, decimals, and error beyond which the colour stays the same."""
    unit, decimals, most = scale
    rails = sorted({point.rail for point in points})
    columns, names = _columns([point.time for point in points])
    cells: dict[tuple[int, int], float] = {}
    for point, column, error in zip(points, columns, errors, strict=True):
        cell = (rails.index(point.rail), column)
        if abs(error) >= abs(cells.get(cell, 0.0)):
            cells[cell] = error
    places = [[(i, j) for j in range(len(names))] for i in range(len(rails))]
    largest = max(map(abs, cells.values()))
    shared = " A cell with several points shows the largest error." if len(cells) < len(points) else ""
    return HeatMap(
        title,
        f"Calibrated − {origin_word(data)}: red delivers too much, blue too little.{shared}",
        "energising time, µs",
        "rail pressure, MPa",
        names,
        tuple(map(megapascal, rails)),
        tuple(tuple(cells.get(cell) for cell in row) for row in places),
        tuple(tuple(to_signed(cells[cell], decimals) if cell in cells else "" for cell in row) for row in places),
        unit,
        True,
        min(largest, most) or 1.0,
    )


def _columns(times: Sequence[float]) -> tuple[list[int], tuple[str, ...]]:
    """Column of each energising time [us], and the names of the columns: single times, or ranges if there are many."""
    rounded = np.round(times)
    distinct = np.unique(rounded)
    if len(distinct) <= COLUMNS:
        return np.searchsorted(distinct, rounded).tolist(), tuple(f"{time:.0f}" for time in distinct)
    edges = np.unique(np.round(np.quantile(distinct, np.linspace(0.0, 1.0, COLUMNS + 1))))
    column = np.clip(np.searchsorted(edges, rounded, side="right") - 1, 0, len(edges) - 2)
    return column.tolist(), tuple(f"{low:.0f}…" for low in edges[:-1])
