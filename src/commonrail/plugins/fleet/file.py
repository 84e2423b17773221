"""Record of a fleet for JSON, with spreads, worst injectors and failures; tables of results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.csv_output import write_csv
from commonrail.base.output import replacing, write_set
from commonrail.data.records import record_head
from commonrail.data.registry import get_kind
from commonrail.physics.meters import known_quantity
from commonrail.plugins.certainty.linear import ESTIMATOR
from commonrail.plugins.fleet.journal import FAILED, FINISHED, Entry
from commonrail.plugins.fleet.population import population_record
from commonrail.plugins.fleet.study import Fleet
from commonrail.readers.meters import free_names
from commonrail.runs.folder import write_record

WORST = 10  # number of worst injectors listed

Record = dict[str, Any]


def parameter_units(fleet: Fleet) -> dict[str, str]:
    """Unit of each free parameter, in the order of the template."""
    model = fleet.template.model
    names = [*(p.name for p in model.parameter), *free_names(model.meters)]
    return {name: known_quantity(name).unit for name in names}


def fleet_record(fleet: Fleet, entries: Sequence[Entry], status: str, clock: Mapping[str, Any]) -> Record:
    """Return the record of a fleet; times are under "clock".

    `entries`: injectors that are done, in the table's order; `status`: "finished", "interrupted" or "failed"; `clock`:
    "seconds", "first" (seconds until the first injector was done), "calibrated_now" and "workers" of this run.
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
        "J": {key: summarise_spread([e.record["J"][key] for e in finished]) for key in ("start", "best")},
        "curve": {key: _sample_sorted([e.record["J"][key] for e in finished]) for key in ("start", "best")},
        "data": _data(fleet, finished),
        "fixed": finished[0].record["fixed"] if finished else [],
        "parameters": [_parameter(name, unit, finished) for name, unit in parameter_units(fleet).items()]
        if finished
        else [],
        **({"population": population_record(finished, list(parameter_units(fleet)))} if finished else {}),
        "estimator": ESTIMATOR,
        "worst": [_worst(entry) for entry in sorted(finished, key=lambda entry: -entry.record["J"]["best"])[:WORST]],
        "warnings": _warnings(finished),
        "failures": [{"injector": entry.name, "reason": entry.reason} for entry in failed],
        "clock": _clock(clock, finished),
    }


def summarise_spread(values: Sequence[float | None]) -> Record | None:
    """Minimum, quartiles, maximum and count of the numbers among values; None without a number."""
    finite_values = np.array([value for value in values if value is not None])
    if not len(finite_values):
        return None
    low, q1, median, q3, high = np.quantile(finite_values, [0.0, 0.25, 0.5, 0.75, 1.0]).tolist()
    return {"minimum": low, "q1": q1, "median": median, "q3": q3, "maximum": high, "count": len(finite_values)}


def _sample_sorted(values: Sequence[float | None]) -> list[float]:
    """At most 400 of the sorted values at even ranks, for the curve of a figure."""
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
        spreads = {key: summarise_spread([row[key] for row in rows]) for key in ("start", "best")}
        common = {key: rows[0][key] for key in ("measure", "unit")}
        records.append({"name": data.name, "role": data.role, **common, **spreads, "injectors": len(rows)})
    return records


def _parameter(name: str, unit: str, finished: Sequence[Entry]) -> Record:
    parameter_records = [entry.record["parameters"][name] for entry in finished]
    return {
        "name": name,
        "unit": unit,
        "meaning": known_quantity(name).meaning,
        "best": summarise_spread([p["best"] for p in parameter_records]),
        "position": summarise_spread([p["position"] for p in parameter_records]),
        "at_bound": sum(p["at_bound"] for p in parameter_records),
        "verdicts": dict(sorted(Counter(p["verdict"] for p in parameter_records).items())),
        **{key: parameter_records[0][key] for key in ("lower", "upper", "prior")},
    }


def _worst(entry: Entry) -> Record:
    bounded = [name for name, p in entry.record["parameters"].items() if p["at_bound"]]
    return {"injector": entry.name, "J": entry.record["J"], "at_bound": bounded, "seed": entry.record["seed"]}


def _warnings(finished: Sequence[Entry]) -> list[Record]:
    """For each kind of warning the number of injectors with it, and the first of them with its sentence."""
    by_code: dict[str, list[tuple[str, str]]] = {}
    for entry in finished:
        first = {w["code"]: w["sentence"] for w in reversed(entry.record["warnings"])}
        for code, sentence in first.items():
            by_code.setdefault(code, []).append((entry.name, sentence))
    rows = [{"code": code, "injectors": len(f), "first": f[0][0], "sentence": f[0][1]} for code, f in by_code.items()]
    return sorted(rows, key=lambda row: (-row["injectors"], row["code"]))


def _clock(clock: Mapping[str, Any], finished: Sequence[Entry]) -> Record:
    seconds = clock["seconds"]
    later = seconds - (clock["first"] or 0.0)
    return {
        **clock,
        "injectors_per_second": clock["calibrated_now"] / seconds if seconds > 0.0 else None,
        "after_the_first": (clock["calibrated_now"] - 1) / later
        if clock["calibrated_now"] > 1 and later > 0.0
        else None,
        "core_seconds_of_an_injector": summarise_spread([entry.seconds for entry in finished]),
        "core_seconds": sum(entry.seconds for entry in finished),
    }


# Files of a fleet: results.csv, results.parquet if pyarrow is installed, and fleet.json.

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
    """Write the files, each atomically; return the record in ``fleet.json``.

    Arguments as in `fleet_record`; `warnings`: about the fleet as a whole; `why`: reason of injectors that are not
    done.
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
    """Columns of the table of results, with a row for each injector; missing numbers are None.

    Values are SI unless the header gives another unit. Only the last column, the processor time, depends on the clock.
    `why`: reason of injectors that are not done.
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
            measure, unit = get_kind(data.kind).error_head
            columns[f"{measure} {data.name} [{unit}]"] = [_data_error(r, data.name) for r in records]
    units = parameter_units(fleet)
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


def _data_error(record: Mapping[str, Any], name: str) -> Value:
    values = [data["best"] for data in record.get("data", ()) if data["name"] == name]
    return values[0] if values else None


def _text(value: Value) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else repr(value)  # repr: reads back as the same float


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
