"""Folders that a sensitivity study and a tolerance study leave behind: a record and a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from commonrail.base import output
from commonrail.base.output import summed
from commonrail.calibration.compare import Comparison
from commonrail.data.records import MEASURED
from commonrail.runs.folder import TRACES, rate_curves, write_record
from commonrail.runs.traces import write_traces


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
        output.write_csv(folder / table, notes, heads, ([_cell(row.get(head)) for head in heads] for row in rows))


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.9g}" if isinstance(value, float) else str(value)


# The folder that a comparison leaves behind.

COMPARISON = "comparison.json"


def write_comparison(folder: Path, comparison: Comparison, record: Mapping[str, Any]) -> None:
    """Write comparison.json and traces.csv; J of every curve can be computed again from the latter."""
    synthetic = record["synthetic"]
    notes = (
        record["title"],
        f"SYNTHETIC: {synthetic}" if synthetic else "measured data",
        "a row is the mean rate of one sample, whose middle is the time; J is the sum of |model - measured|",
    )
    curves = rate_curves(comparison.data, comparison.scores)
    with summed(folder, COMPARISON, TRACES):
        write_record(folder / COMPARISON, record)
        write_traces(folder / TRACES, notes, (MEASURED, *comparison.models), curves)
