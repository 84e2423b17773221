"""Folders that a sensitivity study and a tolerance study leave behind: a record and a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.files import atomic
from commonrail.files.record_file import read_record, write_record
from commonrail.files.sums import summed

__all__ = ["SENSITIVITY", "TOLERANCE", "Kind", "read_analysis", "write_analysis"]


class Kind(NamedTuple):
    """Kind of folder: verb that leaves it, file of its record, file of its table."""

    verb: str
    record: str
    table: str


SENSITIVITY = Kind("sensitivity", "sensitivity.json", "sensitivity.csv")
TOLERANCE = Kind("tolerance", "tolerance.json", "tolerance.csv")


def write_analysis(folder: Path, kind: Kind, record: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write record, table and their checksums.

    Parameters
    ----------
    folder : Path
    kind : Kind
    record : mapping
    rows : sequence of mappings
        Rows of the table, SI; keys that only some have are columns too, and None is an empty cell.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    synthetic = record["synthetic"]
    notes = (
        record["title"],
        "simulated, not measured; SI units",
        *([f"SYNTHETIC: {synthetic}"] if synthetic else []),
    )
    heads = list(dict.fromkeys(key for row in rows for key in row))
    with summed(folder, kind.record, kind.table):
        write_record(folder / kind.record, record)
        atomic.write_csv(folder / kind.table, notes, heads, ([_cell(row.get(head)) for head in heads] for row in rows))


def read_analysis(folder: Path, kind: Kind) -> dict[str, Any]:
    """Record of a folder; `InputError` if it was left by another verb or is broken."""
    return read_record(folder / kind.record, f"commonrail {kind.verb}")


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.9g}" if isinstance(value, float) else str(value)
