"""Tables of a comparison: those of the data, points that failed, and parameters that differ."""

from __future__ import annotations

from collections.abc import Sequence

from commonrail.display.table import Part, Table, table_of
from commonrail.display.text import fixed, pressure, quantity
from commonrail.kinds.records import MICROSECOND, Record
from commonrail.report.record import by_kind

__all__ = ["comparison_tables", "difference_table", "failure_table"]


def comparison_tables(record: Record) -> list[Table]:
    """Every table that the data sets of a comparison have something for."""
    labels = list(record["labels"])
    tables = [table for view, own in by_kind(record["data"]) for table in view.compared_tables(own, labels)]
    failed = failure_table(record["data"])
    return [*tables, failed] if failed.rows else tables


def difference_table(record: Record) -> Table:
    """Parameters that are not the same in all the models, with prefixes that suit them."""
    labels = list(record["labels"])
    parts = (
        Part(("parameter", "meaning"), lambda d: (d["name"], d["meaning"])),
        Part(labels, lambda d: [quantity(d["values"].get(label), d["unit"]) for label in labels]),
    )
    return table_of("Parameters that differ", record["differences"], parts, "", 2)


def failure_table(data: Sequence[Record]) -> Table:
    """Points that have no number, and why."""
    rows: dict[tuple[str, str, str], list[Record]] = {}
    for d in data:
        for label, failures in d.get("failures", {}).items():
            for failure in failures:
                rows.setdefault((d["name"], label, failure["sentence"]), []).append(failure)
    heads = ("data set", "model", "points", "reason", "number of points")
    cells = ((name, label, _points(found), reason, str(len(found))) for (name, label, reason), found in rows.items())
    return table_of("Points without a number", cells, (Part(heads, lambda row: row),), "", 4)


def _points(failures: Sequence[Record]) -> str:
    """Points in words: "80 MPa: 1000, 1400 µs; 120 MPa: 250 µs"."""
    by_rail: dict[str, list[str]] = {}
    for f in failures:
        by_rail.setdefault(pressure(f["rail_pressure"]), []).append(fixed(f["energising_time"], 0, MICROSECOND))
    return "; ".join(f"{rail}: {', '.join(times)} µs" for rail, times in by_rail.items())
