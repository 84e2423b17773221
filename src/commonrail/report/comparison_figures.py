"""What every figure of a comparison shows, as plain numbers: one colour, marker and dash for each model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from commonrail.report.chart import BOTH, MARKERS, Figure, Panel, Points, Series
from commonrail.report.figures import ENERGISING, MICROSECOND, MM3, MPA, rate_figure
from commonrail.report.record import Record, Shown, number, of_kind, origin_of, shown_of
from commonrail.report.text import listed, megapascal, pressure

__all__ = ["comparison_figures", "dead_times_compared", "map_compared", "map_errors_compared"]

Floats = NDArray[np.float64]
Models = Mapping[str, Shown]


def comparison_figures(record: Record, traces: Mapping[str, Mapping[str, Floats]]) -> list[Figure]:
    """Figures of a comparison in the order of its data: curves, then maps."""
    data: Sequence[Record] = record["data"]
    models = shown_of(record)
    figures = [replace(rate_figure(d, traces[d["name"]], models), title=_title(d)) for d in of_kind(data, "rate")]
    for d in of_kind(data, "quantities"):
        if _quantities(d):
            figures += [map_compared(d, models), map_errors_compared(d, models)]
        if sum(row["dead_time"] for row in d["rows"]) > 1:
            figures.append(dead_times_compared(d, models))
    return figures


def map_compared(data: Record, models: Models) -> Figure:
    """Quantity [mm³] against energising time [us]; each model draws a line for each rail pressure."""
    rows = _quantities(data)
    rails = list(dict.fromkeys(megapascal(row["rail_pressure"]) for row in rows))
    x = _parted(rows, lambda row: float(row["energising_time"]) * MICROSECOND)
    series = [
        Series(model.text, model.look, x, _parted(rows, _value(label, MM3)), family=model.family)
        for label, model in models.items()
    ]
    measured = Series(origin_of(data), "measured", x, _parted(rows, _value("measured", MM3)), MARKERS)
    return Figure(
        data["name"],
        f"Injected quantity: markers {origin_of(data)}; each model has a line for each rail pressure "
        f"({listed(rails)} MPa).",
        ENERGISING,
        (Panel("quantity, mm³", (*_present(series), measured)),),
    )


def map_errors_compared(data: Record, models: Models) -> Figure:
    """Errors of the quantities, in percent for large ones and in mm³ for small ones."""
    figures = list(data["figures"].values())
    limit = float(figures[0]["limit_quantity"]) if figures else 3.0 / MM3
    rows = _quantities(data)
    over = [row for row in rows if row["measured"] > limit]
    under = [row for row in rows if row["measured"] <= limit]
    large = _error_series(over, models, lambda error, measured: 100.0 * error / measured)
    small = _error_series(under, models, lambda error, _: error * MM3)
    panels = [Panel("error, %", large, 0.6, zero_line=True)] if over else []
    panels += [Panel("error, mm³", _unlabelled(small, large), 0.4, zero_line=True)] if under else []
    return Figure(
        f"Errors of {data['name']}",
        f"Simulated − {origin_of(data)}: in percent above {limit * MM3:.3g} mm³, in mm³ up to it; all rail pressures.",
        ENERGISING,
        tuple(panels),
    )


def dead_times_compared(data: Record, models: Models) -> Figure:
    """Energising time [us] at which a small quantity is reached, against rail pressure [MPa]."""
    rows = sorted((row for row in data["rows"] if row["dead_time"]), key=lambda row: float(row["rail_pressure"]))
    x = tuple(float(row["rail_pressure"]) * MPA for row in rows)
    lines = [
        Series(model.text, model.look, x, tuple(map(_value(label, MICROSECOND), rows)), BOTH, model.family)
        for label, model in models.items()
    ]
    marks = Series(origin_of(data), "measured", x, tuple(map(_value("measured", MICROSECOND), rows)), MARKERS)
    return Figure(
        f"Dead times of {data['name']}",
        "Energising time at which the injector delivers the stated small quantity.",
        "rail pressure, MPa",
        (Panel("dead time, µs", (*_present(lines), marks)),),
    )


def _title(data: Record) -> str:
    """Without the role, which does not matter where nothing is fitted."""
    rail = pressure(data["rail_pressure"])
    return data["name"] if rail in data["name"] else f"{data['name']}, {rail}"


def _present(series: Sequence[Series]) -> tuple[Series, ...]:
    """Without models that have no number at all: the legend would promise a curve."""
    return tuple(s for s in series if any(y is not None for y in s.y))


def _quantities(data: Record) -> list[Record]:
    """Rows that are quantities, by rail pressure and energising time."""
    rows = (row for row in data["rows"] if not row["dead_time"])
    return sorted(rows, key=lambda row: (float(row["rail_pressure"]), float(row["energising_time"])))


def _value(label: str, scale: float) -> Callable[[Record], float | None]:
    def read(row: Record) -> float | None:
        value = number(row.get(label))
        return None if value is None else value * scale

    return read


def _parted(rows: Sequence[Record], read: Callable[[Record], float | None]) -> Points:
    """Values with a gap between rail pressures."""
    parts = [[read(row) for row in part] for _, part in groupby(rows, key=lambda row: row["rail_pressure"])]
    return tuple(value for part in parts for value in (*part, None))[:-1]


def _error_series(
    rows: Sequence[Record], models: Models, measure: Callable[[float, float], float]
) -> tuple[Series, ...]:
    x = tuple(float(row["energising_time"]) * MICROSECOND for row in rows)
    found = []
    for label, model in models.items():
        pairs = ((number(row.get(label)), float(row["measured"])) for row in rows)
        errors = tuple(None if value is None else measure(value - m, m) for value, m in pairs)
        found.append(Series(model.text, model.look, x, errors, MARKERS, model.family))
    return _present(found)


def _unlabelled(series: Sequence[Series], named: Sequence[Series]) -> tuple[Series, ...]:
    """Series of a second panel: one entry in the legend for each model is enough."""
    known = {s.label for s in named}
    return tuple(replace(s, label="") if s.label in known else s for s in series)
