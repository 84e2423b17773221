"""Files that a fleet leaves: results.csv, results.parquet where pyarrow is installed, and fleet.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from commonrail.files.atomic import replacing, write_csv
from commonrail.files.record_file import write_record
from commonrail.files.sums import summed
from commonrail.fleet.fleet_file import Fleet
from commonrail.fleet.journal import Entry
from commonrail.fleet.summary import fleet_record, units_of
from commonrail.kinds import KINDS

__all__ = ["RECORD", "RESULTS", "RESULTS_PARQUET", "result_columns", "write_results"]

RECORD, RESULTS, RESULTS_PARQUET = "fleet.json", "results.csv", "results.parquet"
PENDING = "pending"

Value = str | int | float | None


def write_results(
    folder: Path,
    fleet: Fleet,
    entries: Sequence[Entry],
    status: str,
    clock: Mapping[str, Any],
    *,
    warnings: Sequence[Mapping[str, Any]] = (),
    why: str = "",
) -> dict[str, Any]:
    """Write the files, each whole or not at all; returns what ``fleet.json`` holds.

    Parameters
    ----------
    folder : Path
    fleet : Fleet
    entries : sequence of Entry
        Injectors that are done.
    status : str
        "finished", "interrupted" or "failed".
    clock : mapping
        "seconds", "calibrated_now" and "workers" of this run.
    warnings : sequence of mappings
        About the fleet as a whole, in the form of those of its record.
    why : str
        Reason that the injectors that are not done have none.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    record = fleet_record(fleet, entries, status, clock)
    record["warnings"] = [*warnings, *record["warnings"]]
    columns = result_columns(fleet, entries, why)
    notes = [f"SYNTHETIC: {' '.join(record['synthetic'].split())}"] if record["synthetic"] else []
    rows = zip(*(map(_text, column) for column in columns.values()), strict=True)
    with summed(folder, RECORD, RESULTS, RESULTS_PARQUET):
        write_csv(folder / RESULTS, notes, list(columns), rows)
        _write_parquet(folder / RESULTS_PARQUET, columns, record["synthetic"])
        write_record(folder / RECORD, record)
    return record


def result_columns(fleet: Fleet, entries: Sequence[Entry], why: str = "") -> dict[str, list[Value]]:
    """Columns of the table of results, a row for each injector of the fleet; None where there is no number.

    Values are SI unless the head gives another unit. Only the last column, the processor time, depends on the
    clock.

    Parameters
    ----------
    fleet : Fleet
    entries : sequence of Entry
        Injectors that are done.
    why : str
        Reason of the others.
    """
    found = {entry.name: entry for entry in entries}
    rows = [found.get(name) for name in fleet.supply.names]
    columns: dict[str, list[Value]] = {
        "injector": list(fleet.supply.names),
        "status": [PENDING if entry is None else entry.status for entry in rows],
        "reason": [why if entry is None else entry.reason for entry in rows],
    }
    records: list[Mapping[str, Any]] = [entry.record if entry else {} for entry in rows]
    columns |= {f"J {key}": [r["J"][key] if r else None for r in records] for key in ("start", "best")}
    for data in fleet.template.model.data:
        if data.name not in fleet.template.left_out:
            measure, unit = KINDS[data.kind].error_head
            columns[f"{measure} {data.name} [{unit}]"] = [_of_data(r, data.name) for r in records]
    units = units_of(fleet)
    for name, unit in units.items():
        own = [r["parameters"][name] if r else {} for r in records]
        head = f" [{unit}]" if unit != "1" else ""
        columns[name + head] = [p.get("best") for p in own]
        columns[f"{name} standard error{head}"] = [p.get("standard_error") for p in own]
        columns[f"{name} verdict"] = [p.get("verdict", "") for p in own]
    columns["warnings"] = [len(r["warnings"]) if r else None for r in records]
    columns["seed"] = [r.get("seed") for r in records]
    columns["processor time [s]"] = [None if entry is None else entry.seconds for entry in rows]
    return columns


def _of_data(record: Mapping[str, Any], name: str) -> Value:
    values = [data["best"] for data in record.get("data", ()) if data["name"] == name]
    return values[0] if values else None


def _text(value: Value) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else repr(value)  # repr: the same float when it is read


def _write_parquet(path: Path, columns: Mapping[str, list[Value]], synthetic: str) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return
    arrays = {}
    for name, values in columns.items():
        numbers = all(value is None or isinstance(value, float) for value in values)
        arrays[name] = pyarrow.array(values, pyarrow.float64() if numbers else None)
    table = pyarrow.table(arrays)
    if synthetic:
        table = table.replace_schema_metadata({"SYNTHETIC": synthetic})
    with replacing(path, "wb") as stream:
        parquet.write_table(table, stream)
