"""Tables of a comparison: a column for each model, the least error of each row marked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain

from commonrail.report.record import Record, number, of_kind, origin_of, texts_of
from commonrail.report.tables import (
    BEST_SIGN,
    DEAD_TIME_LEGEND,
    MICROSECOND,
    MM3,
    QUANTITY_LEGEND,
    Cell,
    Table,
    dead_time_size,
    limit_text,
    quantity_size,
)
from commonrail.report.text import fixed, megapascal, percent, pressure, quantity, signed, significant

__all__ = ["comparison_tables", "difference_table", "failure_table"]

WIDE = 3  # models of which a row of a map holds quantities and errors; of more only errors

BEST_LEGEND = f"{BEST_SIGN} least error of the row."
_FIGURES: tuple[tuple[str, str, Callable[[float | None], str]], ...] = (
    ("rms_large_percent", "above {} mm³, % rms", lambda value: fixed(value, 2)),
    ("rms_small", "up to {} mm³, mm³ rms", lambda value: fixed(value, 3, MM3)),
    ("dead_time_rms", "dead time, µs rms", lambda value: fixed(value, 1, MICROSECOND)),
)


def comparison_tables(record: Record) -> list[Table]:
    """Every table that the data sets of a comparison have something for."""
    labels = list(texts_of(record))
    data: Sequence[Record] = record["data"]
    rates, maps = of_kind(data, "rate"), of_kind(data, "quantities")
    tables = [_j(rates, labels), _j_relative(rates, labels), _volume(rates, labels)] if rates else []
    tables += [_figures(maps, labels)] if maps else []
    for d in maps:
        tables += [table for table in (_quantities(d, labels), _dead_times(d, labels)) if table.rows]
    failed = failure_table(data)
    return [*tables, failed] if failed.rows else tables


def difference_table(record: Record) -> Table:
    """Parameters that are not the same in all the models, with prefixes that suit them."""
    labels = list(texts_of(record))
    rows = [
        (d["name"], d["meaning"], *(quantity(d["values"].get(label), d["unit"]) for label in labels))
        for d in record["differences"]
    ]
    cells = tuple(tuple(map(Cell, row)) for row in rows)
    return Table("Parameters that differ", ("parameter", "meaning", *labels), cells, "", 2)


def failure_table(data: Sequence[Record]) -> Table:
    """Points that have no number, and why."""
    rows = []
    for d in data:
        for label, failures in d.get("failures", {}).items():
            for reason in dict.fromkeys(f["sentence"] for f in failures):
                found = [f for f in failures if f["sentence"] == reason]
                rows.append(tuple(map(Cell, (d["name"], label, _points(found), reason, str(len(found))))))
    columns = ("data set", "model", "points", "reason", "number of points")
    return Table("Points without a number", columns, tuple(rows), "", 4)


def _points(failures: Sequence[Record]) -> str:
    """Points in words: "80 MPa: 1000, 1400 µs; 120 MPa: 250 µs"."""
    by_rail: dict[str, list[str]] = {}
    for f in failures:
        by_rail.setdefault(pressure(f["rail_pressure"]), []).append(fixed(f["energising_time"], 0, MICROSECOND))
    return "; ".join(f"{rail}: {', '.join(times)} µs" for rail, times in by_rail.items())


def _j(rates: Sequence[Record], labels: Sequence[str]) -> Table:
    rows = []
    for d in rates:
        errors = _marked([number(d["J"].get(label)) for label in labels], lambda j: fixed(j, 1))
        rows.append((*_head(d), *errors, Cell(str(d["samples"]))))
    return Table(
        "Error J of the injection curves, mm³/ms",
        ("data set", "rail, MPa", *labels, "samples"),
        tuple(rows),
        f"J is the sum over the samples of |simulated rate − data|. {BEST_LEGEND}",
    )


def _j_relative(rates: Sequence[Record], labels: Sequence[str]) -> Table:
    rows = [(*_head(d), *_marked([number(d["J_relative"].get(label)) for label in labels], percent)) for d in rates]
    note = f"J over the sum of |data| over the same samples. {BEST_LEGEND}"
    return Table("J relative to the data, %", ("data set", "rail, MPa", *labels), tuple(rows), note)


def _volume(rates: Sequence[Record], labels: Sequence[str]) -> Table:
    rows = []
    for d in rates:
        volume, measured = d["volume"], d["volume"]["measured"]
        errors = [_relative(number(volume.get(label)), measured) for label in labels]
        rows.append((*_head(d), Cell(fixed(measured, 2, MM3)), *_marked(errors, lambda e: signed(e, 1))))
    origins = {origin_of(d) for d in rates}
    columns = ("data set", "rail, MPa", f"{origins.pop() if len(origins) == 1 else 'data'}, mm³", *labels)
    return Table("Error of the injected volume, %", columns, tuple(rows), f"Simulated against data. {BEST_LEGEND}")


def _figures(maps: Sequence[Record], labels: Sequence[str]) -> Table:
    rows = []
    for d in maps:
        count = str(sum(not row["dead_time"] for row in d["rows"]))
        columns = [
            _marked([number(d["figures"].get(label, {}).get(key)) for label in labels], text)
            for key, _, text in _FIGURES
        ]
        rows += [
            (Cell(d["name"]), Cell(label), Cell(count), *cells) for label, *cells in zip(labels, *columns, strict=True)
        ]
    limit = limit_text(maps)
    heads = (head.format(limit) for _, head, _ in _FIGURES)
    note = f"{BEST_SIGN} least error of the data set. A model that fails at one point has no figure over the points."
    return Table("Errors of the quantity maps", ("data set", "model", "quantities", *heads), tuple(rows), note, 2)


def _quantities(data: Record, labels: Sequence[str]) -> Table:
    """Map point by point: quantities and errors of few models, errors of many."""
    wide = len(labels) <= WIDE
    rows = []
    for row in (r for r in data["rows"] if not r["dead_time"]):
        measured = float(row["measured"])
        found = [number(row.get(label)) for label in labels]
        errors = _marked([_relative(value, measured) for value in found], lambda e: signed(e, 1))
        sized = [
            Cell(cell.text, quantity_size(None if v is None else (v - measured) * MM3, measured * MM3), cell.best)
            for cell, v in zip(errors, found, strict=True)
        ]
        shown = zip((Cell(fixed(v, 2, MM3)) for v in found), sized, strict=True) if wide else zip(sized)
        point = (megapascal(row["rail_pressure"]), fixed(row["energising_time"], 0, MICROSECOND))
        rows.append((*map(Cell, (*point, fixed(measured, 2, MM3))), *chain.from_iterable(shown)))
    heads = [head for label in labels for head in ((label, "error, %") if wide else (label,))]
    columns = ("rail, MPa", "energising time, µs", f"{origin_of(data)}, mm³", *heads)
    note = f"Errors are simulated − {origin_of(data)}. {QUANTITY_LEGEND} {BEST_LEGEND}"
    title = f"{'Quantities, mm³' if wide else 'Errors of the quantities, %'}: {data['name']}"
    return Table(title, columns, tuple(rows), note, 0)


def _dead_times(data: Record, labels: Sequence[str]) -> Table:
    rows = []
    for row in (r for r in data["rows"] if r["dead_time"]):
        found = [number(row.get(label)) for label in labels]
        errors = [None if value is None else (value - row["measured"]) * MICROSECOND for value in found]
        cells = [
            Cell(cell.text, dead_time_size(e), cell.best)
            for cell, e in zip(_marked(errors, lambda e: signed(e, 1)), errors, strict=True)
        ]
        point = (megapascal(row["rail_pressure"]), significant(row.get("quantity"), 3, MM3))
        rows.append((*map(Cell, (*point, fixed(row["measured"], 0, MICROSECOND))), *cells))
    columns = ("rail, MPa", "quantity, mm³", f"{origin_of(data)}, µs", *labels)
    note = (
        "The dead time is the energising time at which the quantity is reached; errors are simulated − "
        f"{origin_of(data)}. {DEAD_TIME_LEGEND} {BEST_LEGEND}"
    )
    return Table(f"Errors of the dead times, µs: {data['name']}", columns, tuple(rows), note, 0)


def _head(data: Record) -> tuple[Cell, Cell]:
    return Cell(data["name"]), Cell(megapascal(data["rail_pressure"]))


def _relative(value: float | None, measured: float) -> float | None:
    return None if value is None or not measured else 100.0 * (value / measured - 1.0)


def _marked(errors: Sequence[float | None], text: Callable[[float | None], str]) -> list[Cell]:
    """Cells of a row of errors; the least is marked, and what reads the same, unless all of them do."""
    sizes = [None if error is None else text(abs(error)) for error in errors]
    numbers = [abs(error) for error in errors if error is not None]
    least = text(min(numbers)) if len({size for size in sizes if size is not None}) > 1 else None
    return [
        Cell(text(error), best=size is not None and size == least) for error, size in zip(errors, sizes, strict=True)
    ]
