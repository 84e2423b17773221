"""What every figure of a calibration shows, as plain numbers; drawing comes later, in `draw`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from commonrail.report.chart import BOTH, MARKERS, Figure, Panel, Points, Series
from commonrail.report.record import LABELS, Record, Shown, number, of_kind, origin_of, shown_of
from commonrail.report.text import pressure

__all__ = [
    "convergence_figure",
    "dead_time_figure",
    "figures_of",
    "map_error_figure",
    "map_figure",
    "rate_figure",
]

Floats = NDArray[np.float64]
MM3 = 1e9  # of 1 m³
MM3_PER_MS = 1e6  # of 1 m³/s
MICROSECOND = 1e6  # of 1 s
MPA = 1e-6  # of 1 Pa

RATE, ERROR = "rate, mm³/ms", "error, mm³/ms"
ENERGISING = "energising time, µs"


def figures_of(record: Record, traces: Mapping[str, Mapping[str, Floats]]) -> list[Figure]:
    """Figures of a result in the order in which they are read: data first, then the search."""
    data: Sequence[Record] = record["data"]
    shown = shown_of(record)
    figures = [rate_figure(d, traces[d["name"]], shown) for d in of_kind(data, "rate")]
    for quantities in of_kind(data, "quantities"):
        figures += [map_figure(quantities), map_error_figure(quantities)]
        if sum(row["dead_time"] for row in quantities["rows"]) > 1:
            figures.append(dead_time_figure(quantities))
    return figures


CALIBRATED = {label: Shown(text, label) for label, text in LABELS.items()}


def rate_figure(data: Record, trace: Mapping[str, Floats], shown: Mapping[str, Shown] = CALIBRATED) -> Figure:
    """Injection curve, data and simulation [mm³/ms], and the errors below, against time [us].

    Parameters
    ----------
    data : mapping
        One of the record's data sets of kind "rate".
    trace : mapping of str to (samples,) array
        "time_s" [s], "measured" and what there is of the labels [m³/s].
    shown : mapping of str to Shown
        Models by label, in order.
    """
    time = _points(trace["time_s"] * MICROSECOND)
    measured = trace["measured"]
    curves = [Series(origin_of(data), "measured", time, _points(measured * MM3_PER_MS))]
    errors = []
    for label, model in shown.items():
        if label not in trace:
            continue
        rate, error = (_points(y * MM3_PER_MS) for y in (trace[label], trace[label] - measured))
        curves.append(Series(model.text, model.look, time, rate, family=model.family))
        errors.append(Series("", model.look, time, error, family=model.family))
    return Figure(
        f"{data['name']} ({data['role']}), {pressure(data['rail_pressure'])}",
        f"Rate of injection, energising time {data['energising_time'] * MICROSECOND:.0f} µs; below, "
        f"simulated − {origin_of(data)}.",
        "time, µs",
        (
            Panel(RATE, tuple(curves), 0.66),
            Panel(ERROR, tuple(errors), 0.34, zero_line=True),
        ),
    )


def map_figure(data: Record) -> Figure:
    """Quantity [mm³] against energising time [us], one family for each rail pressure."""
    series = []
    for family, (rail, rows) in enumerate(_by_pressure(data).items()):
        x = _column(rows, "energising_time", MICROSECOND)
        series.append(Series("", "start", x, _column(rows, "start", MM3), family=family))
        series.append(Series("", "best", x, _column(rows, "best", MM3), family=family))
        measured = _column(rows, "measured", MM3)
        series.append(Series(pressure(rail), "measured", x, measured, MARKERS, family))
    return Figure(
        f"{data['name']} ({data['role']})",
        f"Injected quantity: markers {origin_of(data)}, solid lines calibrated, dotted lines start values.",
        ENERGISING,
        (Panel("quantity, mm³", tuple(series)),),
    )


def map_error_figure(data: Record) -> Figure:
    """Error of the calibrated quantities, in mm³ for small ones and in percent for large ones."""
    limit = data["figures"].get("best", {}).get("limit_quantity", 3.0 / MM3)
    large, small = [], []
    for family, (rail, rows) in enumerate(_by_pressure(data).items()):
        over = [row for row in rows if row["measured"] > limit]
        under = [row for row in rows if row["measured"] <= limit]
        relative = _errors(over, lambda error, measured: 100.0 * error / measured)
        absolute = _errors(under, lambda error, _: error * MM3)
        x_over, x_under = (_column(r, "energising_time", MICROSECOND) for r in (over, under))
        large.append(Series(pressure(rail), "best", x_over, relative, MARKERS, family))
        small.append(Series("", "best", x_under, absolute, MARKERS, family))
    text = f"{limit * MM3:.3g} mm³"
    return Figure(
        f"Errors of {data['name']}",
        f"Calibrated − {origin_of(data)}: in percent above {text}, in mm³ up to it.",
        ENERGISING,
        (
            Panel("error, %", tuple(large), 0.6, zero_line=True),
            Panel("error, mm³", tuple(small), 0.4, zero_line=True),
        ),
    )


def dead_time_figure(data: Record) -> Figure:
    """Energising time [us] at which a small quantity is reached, against rail pressure [MPa]."""
    rows = sorted((r for r in data["rows"] if r["dead_time"]), key=lambda r: float(r["rail_pressure"]))
    x = _column(rows, "rail_pressure", MPA)
    lines = [
        Series(LABELS[k], k, x, _column(rows, k, MICROSECOND), BOTH)
        for k in ("start", "best")
        if any(number(row.get(k)) is not None for row in rows)
    ]
    measured = _column(rows, "measured", MICROSECOND)
    marks = Series(origin_of(data), "measured", x, measured, MARKERS)
    return Figure(
        f"Dead times of {data['name']}",
        "Energising time at which the injector delivers the stated small quantity.",
        "rail pressure, MPa",
        (Panel("dead time, µs", (*lines, marks)),),
    )


def convergence_figure(generations: Sequence[Record]) -> Figure:
    """Best and mean objective of the population against the generation (the paper's Fig. 4)."""
    x = _column(generations, "generation", 1.0)
    best, mean = (_column(generations, key, 1.0) for key in ("best", "mean"))
    values = [v for v in (*best, *mean) if v is not None]
    spread = bool(values) and min(values) > 0.0 and max(values) > 5.0 * min(values)
    series = (Series("mean of the population", "mean", x, mean), Series("best", "best", x, best))
    return Figure(
        "Convergence",
        "Objective of the best member and mean over the population's finite members.",
        "generation",
        (Panel("objective", series, logarithmic=spread),),
    )


def _by_pressure(data: Record) -> dict[float, list[Record]]:
    """Rows that are quantities, by rail pressure [Pa], each in the order of energising time."""
    families: dict[float, list[Record]] = {}
    rows = (row for row in data["rows"] if not row["dead_time"])
    for row in sorted(rows, key=lambda r: (r["rail_pressure"], r["energising_time"])):
        families.setdefault(float(row["rail_pressure"]), []).append(row)
    return families


def _column(rows: Sequence[Record], key: str, scale: float) -> Points:
    found = (number(row.get(key)) for row in rows)
    return tuple(None if value is None else value * scale for value in found)


def _errors(rows: Sequence[Record], measure: Callable[[float, float], float]) -> Points:
    """Measure of calibrated − measured, row by row."""
    found = ((number(row.get("best")), float(row["measured"])) for row in rows)
    return tuple(None if best is None else measure(best - m, m) for best, m in found)


def _points(values: Floats) -> Points:
    return tuple(float(v) if np.isfinite(v) else None for v in values)
