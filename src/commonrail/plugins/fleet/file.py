"""A fleet as one JSON-able record: spread of parameters and of fit, the worst injectors, the failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.csv_output import write_csv
from commonrail.base.output import replacing, write_set
from commonrail.data.records import record_head
from commonrail.data.registry import kind_of
from commonrail.physics.meters import known_quantity
from commonrail.plugins.certainty.linear import ESTIMATOR
from commonrail.plugins.fleet.journal import FAILED, FINISHED, Entry
from commonrail.plugins.fleet.population import population_record
from commonrail.plugins.fleet.study import Fleet
from commonrail.readers.meters import free_names
from commonrail.runs.folder import write_record

WORST = 10  # injectors that are named as the worst

Record = dict[str, Any]


def units_of(fleet: Fleet) -> dict[str, str]:
    """Unit of each free parameter, in the order of the template."""
    model = fleet.template.model
    names = [*(p.name for p in model.parameter), *free_names(model.meters)]
    return {name: known_quantity(name).unit for name in names}


def fleet_record(fleet: Fleet, entries: Sequence[Entry], status: str, clock: Mapping[str, Any]) -> Record:
    """Record of a fleet; all that depends on the clock is under "clock".

    `entries` are the injectors that are done, in the table's order; the status is "finished", "interrupted" or
    "failed". The clock has "seconds", "first" (until the first injector was done), "calibrated_now" and "workers" of
    this run.
    """
    finished = [entry for entry in entries if entry.status == FINISHED]
    failed = [entry for entry in entries if entry.status == FAILED]
    total = len(fleet.supply.names)
    synthetic = " ".join(dict.fromkeys(e.record["synthetic"] for e in finished if e.record["synthetic"]))
    return {
        **record_head("fleet", fleet.title, synthetic),
        "note": fleet.note,
        "seed": fleet.seed,
        "study": {"title": fleet.template.model.title, "file": fleet.template.path.name},
        "table": fleet.supply.path.name,
        "status": status,
        "counts": {
            "injectors": total,
            FINISHED: len(finished),
            FAILED: len(failed),
            "pending": total - len(entries),
        },
        "J": {key: spread_of([e.record["J"][key] for e in finished]) for key in ("start", "best")},
        "curve": {key: _sorted([e.record["J"][key] for e in finished]) for key in ("start", "best")},
        "data": _data(fleet, finished),
        "fixed": finished[0].record["fixed"] if finished else [],
        "parameters": [_parameter(name, unit, finished) for name, unit in units_of(fleet).items()] if finished else [],
        **({"population": population_record(finished, list(units_of(fleet)))} if finished else {}),
        "estimator": ESTIMATOR,
        "worst": [_worst(entry) for entry in sorted(finished, key=lambda entry: -entry.record["J"]["best"])[:WORST]],
        "warnings": _warnings(finished),
        "failures": [{"injector": entry.name, "reason": entry.reason} for entry in failed],
        "clock": _clock(clock, finished),
    }


def spread_of(values: Sequence[float | None]) -> Record | None:
    """Minimum, quartiles, maximum and count of what is a number; None if nothing is."""
    finite_values = np.array([value for value in values if value is not None])
    if not len(finite_values):
        return None
    low, q1, median, q3, high = np.quantile(finite_values, [0.0, 0.25, 0.5, 0.75, 1.0]).tolist()
    return {"minimum": low, "q1": q1, "median": median, "q3": q3, "maximum": high, "count": len(finite_values)}


def _sorted(values: Sequence[float | None]) -> list[float]:
    """At most 400 of the sorted values, evenly spread: a curve of them, for a figure."""
    ordered = np.sort([value for value in values if value is not None])
    places = np.unique(np.linspace(0, len(ordered) - 1, min(len(ordered), 400)).round().astype(int))
    sample: list[float] = ordered[places].tolist() if len(ordered) else []
    return sample


def _data(fleet: Fleet, finished: Sequence[Entry]) -> list[Record]:
    records = []
    for data in fleet.template.model.data:
        rows = [d for entry in finished for d in entry.record["data"] if d["name"] == data.name]
        if not rows:
            continue
        spreads = {key: spread_of([row[key] for row in rows]) for key in ("start", "best")}
        common = {key: rows[0][key] for key in ("measure", "unit")}
        records.append({"name": data.name, "role": data.role, **common, **spreads, "injectors": len(rows)})
    return records


def _parameter(name: str, unit: str, finished: Sequence[Entry]) -> Record:
    parameter_records = [entry.record["parameters"][name] for entry in finished]
    return {
        "name": name,
        "unit": unit,
        "meaning": known_quantity(name).meaning,
        "best": spread_of([p["best"] for p in parameter_records]),
        "position": spread_of([p["position"] for p in parameter_records]),
        "at_bound": sum(p["at_bound"] for p in parameter_records),
        "verdicts": dict(sorted(Counter(p["verdict"] for p in parameter_records).items())),
        **{key: parameter_records[0][key] for key in ("lower", "upper", "prior")},
    }


def _worst(entry: Entry) -> Record:
    bounded = [name for name, p in entry.record["parameters"].items() if p["at_bound"]]
    return {"injector": entry.name, "J": entry.record["J"], "at_bound": bounded, "seed": entry.record["seed"]}


def _warnings(finished: Sequence[Entry]) -> list[Record]:
    """For each kind of warning how many injectors have it, and the first of them with its sentence."""
    by_code: dict[str, list[tuple[str, str]]] = {}
    for entry in finished:
        first = {w["code"]: w["sentence"] for w in reversed(entry.record["warnings"])}
        for code, sentence in first.items():
            by_code.setdefault(code, []).append((entry.name, sentence))
    rows = [{"code": code, "injectors": len(f), "first": f[0][0], "sentence": f[0][1]} for code, f in by_code.items()]
    return sorted(rows, key=lambda row: (-row["injectors"], row["code"]))


def _clock(clock: Mapping[str, Any], finished: Sequence[Entry]) -> Record:
    seconds, later = clock["seconds"], clock["seconds"] - (clock["first"] or 0.0)
    return {
        **clock,
        "injectors_per_second": clock["calibrated_now"] / seconds if seconds > 0.0 else None,
        "after_the_first": (clock["calibrated_now"] - 1) / later
        if clock["calibrated_now"] > 1 and later > 0.0
        else None,
        "core_seconds_of_an_injector": spread_of([entry.seconds for entry in finished]),
        "core_seconds": sum(entry.seconds for entry in finished),
    }


# Files that a fleet leaves: results.csv, results.parquet where pyarrow is installed, and fleet.json.

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

    As `fleet_record`, with warnings about the fleet as a whole and the reason why injectors that are not done have
    none.
    """
    record = fleet_record(fleet, entries, status, clock)
    record["warnings"] = [*warnings, *record["warnings"]]
    columns = result_columns(fleet, entries, why)
    notes = [f"SYNTHETIC: {' '.join(record['synthetic'].split())}"] if record["synthetic"] else []
    rows = zip(*(map(_text, column) for column in columns.values()), strict=True)
    with write_set(folder):
        write_csv(folder / RESULTS, notes, list(columns), rows)
        _write_parquet(folder / RESULTS_PARQUET, columns, record["synthetic"])
        write_record(folder / RECORD, record)
    return record


def result_columns(fleet: Fleet, entries: Sequence[Entry], why: str = "") -> dict[str, list[Value]]:
    """Columns of the table of results, a row for each injector of the fleet; None where there is no number.

    Values are SI unless the head gives another unit. Only the last column, the processor time, depends on the clock.
    `why` is the reason of injectors that are not done.
    """
    by_name = {entry.name: entry for entry in entries}
    rows = [by_name.get(name) for name in fleet.supply.names]
    columns: dict[str, list[Value]] = {
        "injector": list(fleet.supply.names),
        "status": [PENDING if entry is None else entry.status for entry in rows],
        "reason": [why if entry is None else entry.reason for entry in rows],
    }
    records: list[Mapping[str, Any]] = [entry.record if entry else {} for entry in rows]
    columns |= {f"J {key}": [r["J"][key] if r else None for r in records] for key in ("start", "best")}
    for data in fleet.template.model.data:
        if data.name not in fleet.template.left_out:
            measure, unit = kind_of(data.kind).error_head
            columns[f"{measure} {data.name} [{unit}]"] = [_of_data(r, data.name) for r in records]
    units = units_of(fleet)
    for name, unit in units.items():
        parameter_records = [r["parameters"][name] if r else {} for r in records]
        head = f" [{unit}]" if unit != "1" else ""
        columns[name + head] = [p.get("best") for p in parameter_records]
        columns[f"{name} standard error{head}"] = [p.get("standard_error") for p in parameter_records]
        columns[f"{name} verdict"] = [p.get("verdict", "") for p in parameter_records]
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
