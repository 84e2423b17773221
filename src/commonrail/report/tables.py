"""Tables of a calibration or a validation as text: the terminal prints them and the report sets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from commonrail.report.record import LABELS, Record, labels_of, number, of_kind, origin_of
from commonrail.report.text import fixed, megapascal, percent, signed, significant

__all__ = [
    "Cell",
    "Table",
    "dead_time_size",
    "dead_time_table",
    "figures_table",
    "j_table",
    "limit_text",
    "quantity_size",
    "quantity_table",
    "tables_of",
    "volume_table",
]

MM3 = 1e9  # of 1 m³
MICROSECOND = 1e6  # of 1 s

JUDGED = "best"  # the label whose errors are told

# Sizes of an error, with the sign that says it without colour.
SMALL, MEDIUM, LARGE = "small", "medium", "large"
SIGNS = {SMALL: "○", MEDIUM: "◐", LARGE: "●"}
BEST_SIGN = "★"
_QUANTITY_STEPS = ((0.05, 0.1), (0.10, 0.3))  # relative, and [mm³] for what is near zero
_DEAD_TIME_STEPS = (10.0, 20.0)  # [us]

QUANTITY_LEGEND = (
    f"{SIGNS[SMALL]} within 5 % or 0.1 mm³, {SIGNS[MEDIUM]} within 10 % or 0.3 mm³, {SIGNS[LARGE]} beyond."
)
DEAD_TIME_LEGEND = f"{SIGNS[SMALL]} within 10 µs, {SIGNS[MEDIUM]} within 20 µs, {SIGNS[LARGE]} beyond."


@dataclass(frozen=True)
class Cell:
    """Text of a cell, the size of the error that it states ("" where it states none), and whether it is the least."""

    text: str
    size: str = ""
    best: bool = False

    @property
    def plain(self) -> str:
        """Text with its sign, for where there is no colour."""
        # the star stands before the number, so that the digits stay in line
        marked = f"{BEST_SIGN}\N{NO-BREAK SPACE}{self.text}" if self.best else self.text
        return f"{marked} {SIGNS[self.size]}" if self.size else marked


@dataclass(frozen=True)
class Table:
    """A table; the first `texts` columns are words, the others numbers."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    texts: int = 1


Texts = Mapping[str, str]  # of the labels, in order


def tables_of(data: Sequence[Record], texts: Texts = LABELS) -> list[Table]:
    """Every table that the data sets of a result, or of a validation, have something for.

    Errors and shares are those of the label "best", whatever its text.
    """
    rates, maps = of_kind(data, "rate"), of_kind(data, "quantities")
    tables = [j_table(rates, texts), volume_table(rates, texts)] if rates else []
    if maps:
        tables.append(figures_table(maps, texts))
    for data_set in maps:
        found = (quantity_table(data_set, texts), dead_time_table(data_set, texts))
        tables += [table for table in found if table.rows]
    return tables


def j_table(rates: Sequence[Record], texts: Texts = LABELS) -> Table:
    """J of every injection curve, Σ |rate error| over its samples [mm³/ms], by label."""
    labels = labels_of(rates, texts)
    rows = []
    for d in rates:
        cells = [d["name"], d["role"], *(fixed(d["J"].get(label), 1) for label in labels)]
        cells += [percent(d["J_relative"].get(JUDGED)), megapascal(d["rail_pressure"])]
        rows.append((*cells, str(d["samples"])))
    note = (
        "J is the sum over the samples of |simulated rate − data|; the share is that of J of "
        f"“{texts[JUDGED]}” in the sum of the data's rates."
    )
    names = (texts[label] for label in labels)
    columns = ("data set", "role", *names, "share, %", "rail, MPa", "samples")
    return Table("Error J of the injection curves, mm³/ms", columns, _cells(rows), note, 2)


def volume_table(rates: Sequence[Record], texts: Texts = LABELS) -> Table:
    """Volume injected within the samples of every curve [mm³], by label."""
    labels = labels_of(rates, texts)
    rows = []
    for d in rates:
        measured = d["volume"]["measured"]
        cells = [d["name"], d["role"], fixed(measured, 2, MM3)]
        for label in labels:
            volume = number(d["volume"].get(label))
            cells += [fixed(volume, 2, MM3), _relative_error(volume, measured)]
        rows.append(tuple(cells))
    heads = [head for label in labels for head in (texts[label], "error, %")]
    origins = {origin_of(d) for d in rates}
    columns = ("data set", "role", origins.pop() if len(origins) == 1 else "data", *heads)
    return Table("Injected volume, mm³", columns, _cells(rows), "", 2)


def figures_table(maps: Sequence[Record], texts: Texts = LABELS) -> Table:
    """Root-mean-square errors of every quantity map, by label."""
    rows = []
    for d in maps:
        count = sum(not row["dead_time"] for row in d["rows"])
        for label in labels_of([d], texts):
            found = d["figures"].get(label, {})
            large = fixed(found.get("rms_large_percent"), 2)
            small = fixed(found.get("rms_small"), 3, MM3)
            dead = fixed(found.get("dead_time_rms"), 1, MICROSECOND)
            rows.append((d["name"], d["role"], texts[label], str(count), large, small, dead))
    limit = limit_text(maps)
    columns = (
        "data set",
        "role",
        "model",
        "quantities",
        f"above {limit} mm³, % rms",
        f"up to {limit} mm³, mm³ rms",
        "dead time, µs rms",
    )
    return Table("Errors of the quantity maps", columns, _cells(rows), "", 3)


def quantity_table(data: Record, texts: Texts = LABELS) -> Table:
    """Quantities of one map point by point, start and calibrated against measured."""
    labels = [label for label in labels_of([data], texts) if label != "rigid"]
    rows = []
    for row in data["rows"]:
        if row["dead_time"]:
            continue
        measured, best = row["measured"], number(row.get(JUDGED))
        cells = [megapascal(row["rail_pressure"]), fixed(row["energising_time"], 0, MICROSECOND)]
        cells += [fixed(measured, 2, MM3)]
        cells += [fixed(row.get(label), 2, MM3) for label in labels]
        error = None if best is None else (best - measured) * MM3
        size = quantity_size(error, measured * MM3)
        row_cells = [Cell(text) for text in (*cells, signed(error, 2))]
        rows.append((*row_cells, Cell(_relative_error(best, measured), size)))
    heads = [texts[label] for label in labels]
    columns = ("rail, MPa", "energising time, µs", origin_of(data), *heads, "error", "error, %")
    title = f"Quantities, mm³: {data['name']} ({data['role']})"
    note = f"Errors are {texts[JUDGED]} − {origin_of(data)}. {QUANTITY_LEGEND}"
    return Table(title, columns, tuple(rows), note, 0)


def dead_time_table(data: Record, texts: Texts = LABELS) -> Table:
    """Energising times at which a small quantity is reached, of one map."""
    labels = [label for label in labels_of([data], texts) if label != "rigid"]
    rows = []
    for row in data["rows"]:
        if not row["dead_time"]:
            continue
        best = number(row.get(JUDGED))
        error = None if best is None else (best - row["measured"]) * MICROSECOND
        cells = [megapascal(row["rail_pressure"]), significant(row.get("quantity"), 3, MM3)]
        cells += [fixed(row["measured"], 0, MICROSECOND)]
        cells += [fixed(row.get(label), 1, MICROSECOND) for label in labels]
        error_cell = Cell(signed(error, 1), dead_time_size(error))
        rows.append((*map(Cell, cells), error_cell))
    heads = [texts[label] for label in labels]
    columns = ("rail, MPa", "quantity, mm³", origin_of(data), *heads, "error")
    title = f"Dead times, µs: {data['name']} ({data['role']})"
    note = f"Energising time at which the quantity is reached. {DEAD_TIME_LEGEND}"
    return Table(title, columns, tuple(rows), note, 0)


def limit_text(maps: Sequence[Record]) -> str:
    """Quantity [mm³] above which errors are judged in percent."""
    limits = [f["limit_quantity"] for d in maps for f in d["figures"].values()]
    return significant(limits[0], 3, MM3) if limits else "3"


def _relative_error(value: float | None, measured: float) -> str:
    return signed(None if value is None or not measured else 100.0 * (value / measured - 1.0), 1)


def quantity_size(error: float | None, measured: float) -> str:
    """Size of an error of a quantity [mm³]: relative, or absolute for what is near zero."""
    return _size(error, tuple(max(rel * abs(measured), ab) for rel, ab in _QUANTITY_STEPS))


def dead_time_size(error: float | None) -> str:
    """Size of an error of a dead time [us]."""
    return _size(error, _DEAD_TIME_STEPS)


def _size(error: float | None, steps: Sequence[float]) -> str:
    if error is None:
        return LARGE
    return (SMALL, MEDIUM, LARGE)[sum(abs(error) > step for step in steps)]


def _cells(rows: Sequence[Sequence[str]]) -> tuple[tuple[Cell, ...], ...]:
    return tuple(tuple(map(Cell, row)) for row in rows)
