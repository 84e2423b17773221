"""Bands of a quantity map in tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from commonrail.display.chart import Band, Points
from commonrail.display.text import MISSING, fixed, number
from commonrail.kinds.bands import band_name
from commonrail.kinds.records import JUDGED, MEASURED, MICROSECOND, MM3, Record, scaled

__all__ = ["band_cells", "band_note", "error_band"]

INSIDE, OUTSIDE = "✓", "✗"

Measure = Callable[[float, float], float]  # of a value and the measured quantity [m³]


def band_note(data: Record) -> str:
    """Sentence on what the bands are."""
    return f"{band_name(data)} by {data['band']['estimator']}; {INSIDE} measured value inside, {OUTSIDE} outside."


def band_cells(row: Record) -> tuple[str]:
    """Half width of a row's band [mm³], and on which side of its edge the measured quantity lies."""
    half, best = number(row["band"]), number(row.get(JUDGED))
    if half is None or best is None:
        return (MISSING,)
    return (f"{fixed(half, 2, MM3)} {INSIDE if abs(best - row[MEASURED]) <= half else OUTSIDE}",)


def error_band(rows: Sequence[Record], family: int, measure: Measure, about: str = "") -> Band:
    """Area within the half widths, about zero or about a label's values.

    Parameters
    ----------
    rows : sequence of Record
        Of one rail pressure, in the order of energising time.
    family : int
    measure : function of a value and the measured quantity [m³]
    about : str
        Label whose values are the middle; zero if empty.
    """
    low, high = (_edge(rows, sign, measure, about) for sign in (-1.0, 1.0))
    return Band(JUDGED, scaled(rows, "energising_time", MICROSECOND), low, high, family)


def _edge(rows: Sequence[Record], sign: float, measure: Measure, about: str) -> Points:
    found = []
    for row in rows:
        half, middle = number(row["band"]), number(row.get(about)) if about else 0.0
        value = None if half is None or middle is None else measure(middle + sign * half, float(row[MEASURED]))
        found.append(value)
    return tuple(found)
