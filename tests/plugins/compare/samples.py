"""Records as comparison.json holds them, made from those of samples.py."""

from __future__ import annotations

from typing import Any

import numpy as np

from commonrail.base.record import from_record
from commonrail.plugins.compare.file import ComparisonRecord
from tests.report.samples import SYNTHETIC, map_record, rate_record, rate_traces

OLD, NEW, STIFF = "old", "new, seat 2 mm", "stiff"
_OF = {OLD: "start", NEW: "best", STIFF: "rigid"}  # the labels of samples.py


def typed(record: dict[str, Any]) -> ComparisonRecord:
    """Record as pages read it."""
    return from_record(ComparisonRecord, record)


def compared_rates() -> dict[str, Any]:
    """Three curves and three models."""
    record = _record(rate_record()["data"], (OLD, NEW, STIFF))
    for d in record["data"]:
        for key in ("J", "J_relative", "volume"):
            d[key] |= {label: d[key].pop(old) for label, old in _OF.items()}
    return record | {"synthetic": SYNTHETIC}


def compared_traces(record: dict[str, Any]) -> dict[str, dict[str, np.ndarray]]:
    """Traces of `compared_rates`."""
    names = {old: label for label, old in _OF.items()}
    return {
        data: {names.get(key, key): values for key, values in trace.items()}
        for data, trace in rate_traces(record).items()
    }


def compared_maps() -> dict[str, Any]:
    """Two maps and two models."""
    record = _record(map_record()["data"], (OLD, NEW))
    for d in record["data"]:
        for part in (*d["rows"], d["figures"]):
            part |= {label: part.pop(_OF[label]) for label in (OLD, NEW)}
    return record


def fail(record: dict[str, Any], label: str, sentence: str) -> None:
    """Let a model fail at the first and the second point of the first map."""
    data = record["data"][0]
    for row in data["rows"][:2]:
        row[label] = None
        point = {key: row[key] for key in ("rail_pressure", "energising_time")}
        data["failures"][label].append(point | {"status": "RAN_AWAY", "sentence": sentence})
    data["figures"][label]["rms_small"] = None


def _record(data: list[dict[str, Any]], labels: tuple[str, ...]) -> dict[str, Any]:
    for d in data:
        d["failures"] = {label: [] for label in labels}
    return {
        "schema": 1,
        "kind": "comparison",
        "software": {"commonrail": "0.1.0", "python": "3.11.7", "numpy": "2.1.0", "numba": "0.60.0"},
        "title": "Comparison",
        "synthetic": "",
        "labels": {label: label for label in labels},
        "models": [
            {
                "label": label,
                "name": "virtual",
                "title": f"Injector {i}",
                "variant": "flexible body, ideal rail, pwm drive",
                "fuel": "iso4113",
                "synthetic": "",
                "argument": f"{label}=runs/{i}",
            }
            for i, label in enumerate(labels)
        ],
        "differences": [
            {
                "name": "needle_seat.diameter",
                "unit": "m",
                "meaning": "diameter of the seat",
                "values": {label: 1e-3 * (2 + i) for i, label in enumerate(labels)},
            }
        ],
        "studies": [{"title": "A study", "time_step": 1e-6, "file": "my study.toml"}],
        "data": data,
    }
