"""What result.json says, read by labels: rigid, start and best values of whatever was compared."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from commonrail.errors import InputError

__all__ = [
    "LABELS",
    "SCHEMA",
    "Record",
    "check_record",
    "labels_of",
    "number",
    "of_kind",
    "of_role",
    "origin_of",
]

Record = Mapping[str, Any]

SCHEMA = 1

# In the order in which a reader meets them; the paper says rigid, theoretical and optimised.
LABELS = {"rigid": "rigid body", "start": "start values", "best": "calibrated"}

_NEEDED = ("title", "seed", "status", "injector", "parameters", "objective", "data", "generations")


def check_record(record: Any, where: str) -> Record:
    """Return the record if this version can read it.

    Raises
    ------
    InputError
        If it is not the result of a calibration, of another schema, or incomplete.
    """
    if not isinstance(record, Mapping) or record.get("kind") != "calibration":
        raise InputError(f"{where}: result.json is not the result of commonrail calibrate.")
    if record.get("schema") != SCHEMA:
        raise InputError(
            f"{where}: result.json has schema {record.get('schema')!r} and this version reads "
            f"{SCHEMA}; make the report with the version that calibrated, or calibrate again."
        )
    missing = [key for key in _NEEDED if key not in record]
    if missing:
        raise InputError(f'{where}: result.json lacks "{missing[0]}"; calibrate again.')
    return record


def of_kind(data: Sequence[Record], kind: str) -> list[Record]:
    """Data sets of one kind: "rate" or "quantities"."""
    return [d for d in data if d["kind"] == kind]


def of_role(data: Sequence[Record], role: str) -> list[Record]:
    """Data sets of one role: "fit" or "validation"."""
    return [d for d in data if d["role"] == role]


def labels_of(data: Sequence[Record]) -> list[str]:
    """Labels for which at least one of the data sets has figures, in the order of `LABELS`."""
    return [label for label in LABELS if any(_has(d, label) for d in data)]


def origin_of(data: Record) -> str:
    """What to call the values of a data set: synthetic ones are never shown as measured."""
    return "synthetic" if data.get("synthetic") else "measured"


def number(value: Any) -> float | None:
    """A finite number, or None: what a failed simulation leaves."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def _has(data: Record, label: str) -> bool:
    if data["kind"] == "rate":
        return number(data["J"].get(label)) is not None
    return any(number(row.get(label)) is not None for row in data["rows"])
