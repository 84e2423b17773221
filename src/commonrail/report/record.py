"""What result.json and comparison.json say, read by the labels of the models in them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from commonrail.calibration.result import LABELS
from commonrail.errors import InputError

__all__ = [
    "LABELS",
    "SCHEMA",
    "Record",
    "Shown",
    "check_comparison",
    "check_record",
    "labels_of",
    "number",
    "of_kind",
    "of_role",
    "origin_of",
    "shown_of",
    "texts_of",
]

Record = Mapping[str, Any]

SCHEMA = 1

_DASHES = ("solid", "dash", "dot", "dashdot")
_COMPARED = ("title", "labels", "models", "differences", "studies", "data")
_NEEDED = ("title", "seed", "status", "injector", "parameters", "objective", "data", "generations")


def check_record(record: Any, where: str) -> Record:
    """Return the record if this version can read it.

    Raises
    ------
    InputError
        If it is not the result of a calibration, of another schema, or incomplete.
    """
    return _checked(record, f"{where}: result.json", "calibration", _NEEDED)


def check_comparison(record: Any, where: str) -> Record:
    """Return the record of a comparison if this version can read it.

    Raises
    ------
    InputError
        If it is not the result of a comparison, of another schema, or incomplete.
    """
    return _checked(record, f"{where}: comparison.json", "comparison", _COMPARED)


def _checked(record: Any, where: str, kind: str, needed: Sequence[str]) -> Record:
    verb = {"calibration": "calibrate", "comparison": "compare"}[kind]
    if not isinstance(record, Mapping) or record.get("kind") != kind:
        raise InputError(f"{where} is not the result of commonrail {verb}.")
    if record.get("schema") != SCHEMA:
        raise InputError(
            f"{where} has schema {record.get('schema')!r} and this version reads {SCHEMA}; make the report with "
            f"the version that left it, or {verb} again."
        )
    missing = [key for key in needed if key not in record]
    if missing:
        raise InputError(f'{where} lacks "{missing[0]}"; {verb} again.')
    return record


class Shown(NamedTuple):
    """How figures show a model: text of the legend, and look and family of its `Series`."""

    text: str
    look: str
    family: int | None = None


def texts_of(record: Record) -> Mapping[str, str]:
    """Text of every label, in order; records of early versions carry none and mean `LABELS`."""
    found: Mapping[str, str] = record.get("labels", LABELS)
    return found


def shown_of(record: Record) -> dict[str, Shown]:
    """Looks of the models: the fixed ones of a calibration, or a colour, marker and dash for each of a comparison."""
    texts = texts_of(record)
    if set(texts) <= set(LABELS) and record.get("kind") != "comparison":
        return {label: Shown(text, label) for label, text in texts.items()}
    return {label: Shown(text, _DASHES[i % len(_DASHES)], i) for i, (label, text) in enumerate(texts.items())}


def of_kind(data: Sequence[Record], kind: str) -> list[Record]:
    """Data sets of one kind: "rate" or "quantities"."""
    return [d for d in data if d["kind"] == kind]


def of_role(data: Sequence[Record], role: str) -> list[Record]:
    """Data sets of one role: "fit" or "validation"."""
    return [d for d in data if d["role"] == role]


def labels_of(data: Sequence[Record], texts: Mapping[str, str] = LABELS) -> list[str]:
    """Labels for which at least one of the data sets has figures, in the order of their texts."""
    return [label for label in texts if any(_has(d, label) for d in data)]


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
