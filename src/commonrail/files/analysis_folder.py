"""Folders that a sensitivity study and a tolerance study leave behind: a record and a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from commonrail.files import atomic
from commonrail.files.record_file import write_record
from commonrail.files.sums import summed

__all__ = ["write_analysis"]


def write_analysis(folder: Path, table: str, record: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a record, a table and their checksums.

    Parameters
    ----------
    folder : Path
    table : str
        File of the table, such as "tolerance.csv", beside which the record lies as "tolerance.json".
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
    record_file = Path(table).with_suffix(".json").name
    with summed(folder, record_file, table):
        write_record(folder / record_file, record)
        atomic.write_csv(folder / table, notes, heads, ([_cell(row.get(head)) for head in heads] for row in rows))


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.9g}" if isinstance(value, float) else str(value)
