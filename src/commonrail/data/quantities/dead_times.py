"""Dead times: energising times at which a small quantity is reached, rows of a quantity map that are judged by time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import BOTH, MARKERS, Figure, Panel, Series
from commonrail.base.table import BEST_LEGEND, SIGNS, Cell, Part, Table, marked, size_of, table_of
from commonrail.base.text import fixed, megapascal, number, signed, significant
from commonrail.data.records import (
    JUDGED,
    MEASURED,
    MICROSECOND,
    MM3,
    MPA,
    Models,
    Record,
    Texts,
    origin_of,
    present,
    scaled,
)
from commonrail.engine.operating_point import OperatingPoint

AROUND = 50e-6  # distance of the energising times between which a dead time is interpolated [s]
FLATTEST = 200e-6  # time in which the quantity is taken to grow from zero at the slowest [s]

SEARCHED = np.linspace(120e-6, 480e-6, 37)  # energising times [s]
_STEPS = (10.0, 20.0)  # [us]
_LEGEND = "{small} within 10 µs, {medium} within 20 µs, {large} beyond.".format(**SIGNS)

NO_DEAD_TIME = "NO_DEAD_TIME"
NOT_REACHED = (
    "No dead time was found: the quantity is not passed between energising times of 120 and 480 µs, or the "
    "simulation fails there."
)


def neighbours(point: OperatingPoint) -> list[OperatingPoint]:
    """Points energised shorter and longer than a dead time, between which `crossing_times` interpolates."""
    duration = point.pulses[0].duration
    return [energised(point, duration - _before(duration)), energised(point, duration + AROUND)]


def crossing_times(duration: Floats, quantity: Floats, threshold: Floats) -> Floats:
    """Energising times at which a quantity is reached, by linear interpolation between three of them.

    Beyond the outer ones the nearest segment is extrapolated. Its slope is at least that of a quantity that grows by
    the threshold within `FLATTEST`, so that an injector that injects nothing still has a finite dead time.

    `duration` (rows,): energising times of the middle ones [s]. `quantity` (candidates, rows, 3): quantities at the
    `neighbours` and, between them, at the point itself [m³]; NaN where a simulation failed. `threshold` (rows,):
    quantity to be reached [m³]. Returns (candidates, rows) times [s]; NaN where a simulation failed.
    """
    low, middle, high = np.moveaxis(quantity, -1, 0)
    later = middle < threshold
    width = np.where(later, AROUND, _before(duration))
    slope = np.where(later, high - middle, middle - low) / width
    share = (threshold - middle) / np.maximum(slope, threshold / FLATTEST)
    return np.where(np.isfinite(low + high), duration + share, np.nan)


def _before(duration: Any) -> Any:
    return np.minimum(AROUND, 0.5 * duration)


def energised(point: OperatingPoint, duration: float) -> OperatingPoint:
    """Point with another energising time [s]."""
    return OperatingPoint(
        point.rail_pressure, duration, point.cylinder_pressure, point.return_pressure, start=point.start
    )


def dead_times_of(data: Record) -> list[Record]:
    """Rows of a map that are dead times."""
    return [row for row in data["rows"] if row["dead_time"]]


def dead_time_table(data: Record, labels: Sequence[str], texts: Texts) -> Table:
    """Dead times of one map and the error of the calibrated model.

    `labels`: models that have a column. `texts`: what they are called.
    """

    def error(row: Record) -> list[Cell]:
        (found,) = _errors(row, [JUDGED])
        return [Cell(signed(found, 1), size_of(found, _STEPS))]

    parts = (
        *_head(origin_of(data)),
        Part([texts[label] for label in labels], lambda row: [fixed(row.get(k), 1, MICROSECOND) for k in labels]),
        Part(("error",), error),
    )
    title = f"Dead times, µs: {data['name']} ({data['role']})"
    note = f"Energising time at which the quantity is reached. {_LEGEND}"
    return table_of(title, dead_times_of(data), parts, note, 0)


def compared_dead_times(data: Record, labels: Sequence[str]) -> Table:
    """Errors of the dead times of one map, by model."""

    def errors(row: Record) -> list[Cell]:
        return marked(_errors(row, labels), lambda error: signed(error, 1), _STEPS)

    note = (
        "The dead time is the energising time at which the quantity is reached; errors are simulated − "
        f"{origin_of(data)}. {_LEGEND} {BEST_LEGEND}"
    )
    parts = (*_head(f"{origin_of(data)}, µs"), Part(labels, errors))
    return table_of(f"Errors of the dead times, µs: {data['name']}", dead_times_of(data), parts, note, 0)


def dead_time_figure(data: Record, models: Models) -> list[Figure]:
    """Dead times [us] against rail pressure [MPa], if there are two or more."""
    rows = sorted(dead_times_of(data), key=lambda row: float(row["rail_pressure"]))
    if len(rows) < 2:
        return []
    x = scaled(rows, "rail_pressure", MPA)
    lines = [
        Series(model.text, model.look, x, scaled(rows, label, MICROSECOND), BOTH, model.family)
        for label, model in models.items()
    ]
    marks = Series(origin_of(data), MEASURED, x, scaled(rows, MEASURED, MICROSECOND), MARKERS)
    return [
        Figure(
            f"Dead times of {data['name']}",
            "Energising time at which the injector delivers the stated small quantity.",
            "rail pressure, MPa",
            (Panel("dead time, µs", (*present(lines), marks)),),
        )
    ]


def _head(origin: str) -> tuple[Part, Part]:
    place = Part(
        ("rail, MPa", "quantity, mm³"),
        lambda row: (megapascal(row["rail_pressure"]), significant(row.get("quantity"), 3, MM3)),
    )
    return place, Part((origin,), lambda row: (fixed(row[MEASURED], 0, MICROSECOND),))


def _errors(row: Record, labels: Sequence[str]) -> list[float | None]:
    """Errors [us] of models."""
    found = (number(row.get(label)) for label in labels)
    return [None if value is None else (value - row[MEASURED]) * MICROSECOND for value in found]
