"""Heat maps of the errors of measured quantity maps: all of it in percent, and the small quantities in mm³."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from commonrail.display.heat_map import HeatMap
from commonrail.display.text import megapascal, number, signed
from commonrail.kinds.maps.data import QuantityData
from commonrail.kinds.maps.returned import ReturnData
from commonrail.kinds.records import JUDGED, MEASURED, MM3, Record, origin_of

__all__ = ["error_maps"]

SMALL = 5e-9  # largest quantity of the second map [m³]
COLUMNS = 22  # of energising times; more share a column
LARGEST_PERCENT, LARGEST_MM3 = 20.0, 1.0  # beyond them the colour stays the same
_MICRO = 1e6


class _Point(NamedTuple):
    """Rail pressure [Pa], energising time [us], measured quantity [m³] and error [m³]."""

    rail: float
    time: float
    measured: float
    error: float


def error_maps(record: Record) -> list[HeatMap]:
    """Heat maps of each quantity map of a calibration; none for one with fewer than two pressures or four points."""
    kinds = (QuantityData.kind, ReturnData.kind)
    return [heat for data in record["data"] if data["kind"] in kinds for heat in _maps(data)]


def _maps(data: Record) -> list[HeatMap]:
    points = [
        _Point(
            float(row["rail_pressure"]),
            float(row["energising_time"]) * _MICRO,
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
    small = [point for point in points if point.measured <= SMALL]
    what = f"{data['name']} ({data['role']})"
    found = []
    if large:
        title = f"Error of {what}, % of the quantity, above {limit * MM3:.3g} mm³"
        found.append(_heat(large, title, _percent, ("%", 1, LARGEST_PERCENT), data))
    if small:
        title = f"Error of {what}, mm³, quantities up to {SMALL * MM3:.3g} mm³"
        found.append(_heat(small, title, _absolute, ("mm³", 2, LARGEST_MM3), data))
    return found


def _percent(point: _Point) -> float:
    return 100.0 * point.error / point.measured


def _absolute(point: _Point) -> float:
    return point.error * MM3


def _heat(
    points: Sequence[_Point],
    title: str,
    measure: Callable[[_Point], float],
    shown: tuple[str, int, float],
    data: Record,
) -> HeatMap:
    """Heat map of some points; `shown` is the unit, its decimals, and the error of the last colour."""
    unit, decimals, most = shown
    rails = sorted({point.rail for point in points})
    columns, names = _columns([point.time for point in points])
    cells: dict[tuple[int, int], float] = {}
    for point, column in zip(points, columns, strict=True):
        cell, error = (rails.index(point.rail), column), measure(point)
        if abs(error) >= abs(cells.get(cell, 0.0)):
            cells[cell] = error
    places = [[(i, j) for j in range(len(names))] for i in range(len(rails))]
    largest = max(map(abs, cells.values()))
    shared = " A cell with several points shows the largest error." if len(cells) < len(points) else ""
    return HeatMap(
        title,
        f"Calibrated − {origin_of(data)}: red delivers too much, blue too little.{shared}",
        "energising time, µs",
        "rail pressure, MPa",
        names,
        tuple(map(megapascal, rails)),
        tuple(tuple(cells.get(cell) for cell in row) for row in places),
        tuple(tuple(signed(cells[cell], decimals) if cell in cells else "" for cell in row) for row in places),
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
