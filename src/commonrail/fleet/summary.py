"""A fleet as one JSON-able record: spread of parameters and of fit, the worst injectors, the failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from commonrail.analysis.certainty.linear import ESTIMATOR
from commonrail.compile_target import describe, package_versions
from commonrail.files.meter_models import free_names
from commonrail.fleet.fleet_file import Fleet
from commonrail.fleet.journal import FAILED, FINISHED, Entry
from commonrail.fleet.population import population_record
from commonrail.observation.quantities import known_quantity

__all__ = ["SCHEMA", "WORST", "fleet_record", "units_of"]

SCHEMA = 1
WORST = 10  # injectors that are named as the worst

Record = dict[str, Any]


def units_of(fleet: Fleet) -> dict[str, str]:
    """Unit of each free parameter, in the order of the template."""
    model = fleet.template.model
    names = [*(p.name for p in model.parameter), *free_names(model.meters)]
    return {name: known_quantity(name).unit for name in names}


def fleet_record(fleet: Fleet, entries: Sequence[Entry], status: str, clock: Mapping[str, Any]) -> Record:
    """Record of a fleet; all that depends on the clock is under "clock".

    Parameters
    ----------
    fleet : Fleet
    entries : sequence of Entry
        Injectors that are done, in the table's order.
    status : str
        "finished", "interrupted" or "failed".
    clock : mapping
        "seconds", "first" (until the first injector was done), "calibrated_now" and "workers" of this run.
    """
    finished = [entry for entry in entries if entry.status == FINISHED]
    failed = [entry for entry in entries if entry.status == FAILED]
    total = len(fleet.supply.names)
    return {
        "schema": SCHEMA,
        "kind": "fleet",
        "software": package_versions(),
        "target": describe().machine,
        "title": fleet.title,
        "note": fleet.note,
        "synthetic": " ".join(dict.fromkeys(e.record["synthetic"] for e in finished if e.record["synthetic"])),
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
        "worst": [_worst(entry) for entry in _by_cost(finished)[:WORST]],
        "warnings": _warnings(finished),
        "failures": [{"injector": entry.name, "reason": entry.reason} for entry in failed],
        "clock": _clock(clock, finished),
    }


def spread_of(values: Sequence[float | None]) -> Record | None:
    """Minimum, quartiles, maximum and count of what is a number; None if nothing is."""
    known = np.array([value for value in values if value is not None])
    if not len(known):
        return None
    low, q1, median, q3, high = np.quantile(known, [0.0, 0.25, 0.5, 0.75, 1.0]).tolist()
    return {"minimum": low, "q1": q1, "median": median, "q3": q3, "maximum": high, "count": len(known)}


def _sorted(values: Sequence[float | None]) -> list[float]:
    """At most 400 of the sorted values, evenly spread: a curve of them, for a figure."""
    known = np.sort([value for value in values if value is not None])
    places = np.unique(np.linspace(0, len(known) - 1, min(len(known), 400)).round().astype(int))
    found: list[float] = known[places].tolist() if len(known) else []
    return found


def _data(fleet: Fleet, finished: Sequence[Entry]) -> list[Record]:
    found = []
    for data in fleet.template.model.data:
        rows = [d for entry in finished for d in entry.record["data"] if d["name"] == data.name]
        if not rows:
            continue
        spreads = {key: spread_of([row[key] for row in rows]) for key in ("start", "best")}
        common = {key: rows[0][key] for key in ("measure", "unit")}
        found.append({"name": data.name, "role": data.role, **common, **spreads, "injectors": len(rows)})
    return found


def _parameter(name: str, unit: str, finished: Sequence[Entry]) -> Record:
    own = [entry.record["parameters"][name] for entry in finished]
    return {
        "name": name,
        "unit": unit,
        "meaning": known_quantity(name).meaning,
        "best": spread_of([p["best"] for p in own]),
        "position": spread_of([p["position"] for p in own]),
        "at_bound": sum(p["at_bound"] for p in own),
        "verdicts": dict(sorted(Counter(p["verdict"] for p in own).items())),
        **{key: own[0][key] for key in ("lower", "upper", "prior")},
    }


def _by_cost(finished: Sequence[Entry]) -> list[Entry]:
    """The worst first; among equals, in the table's order."""
    return sorted(finished, key=lambda entry: -entry.record["J"]["best"])


def _worst(entry: Entry) -> Record:
    bounded = [name for name, p in entry.record["parameters"].items() if p["at_bound"]]
    return {"injector": entry.name, "J": entry.record["J"], "at_bound": bounded, "seed": entry.record["seed"]}


def _warnings(finished: Sequence[Entry]) -> list[Record]:
    """For each kind of warning how many injectors have it, and the first of them with its sentence."""
    found: dict[str, list[tuple[str, str]]] = {}
    for entry in finished:
        first = {w["code"]: w["sentence"] for w in reversed(entry.record["warnings"])}
        for code, sentence in first.items():
            found.setdefault(code, []).append((entry.name, sentence))
    rows = [{"code": code, "injectors": len(f), "first": f[0][0], "sentence": f[0][1]} for code, f in found.items()]
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
