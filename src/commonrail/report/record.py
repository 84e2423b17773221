"""Records of result.json and comparison.json: checked, and read by kinds of data and labels of models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from commonrail.errors import InputError
from commonrail.kinds import KINDS
from commonrail.kinds.base import View
from commonrail.kinds.records import LABELS, Record, Shown

__all__ = [
    "SCHEMA",
    "by_kind",
    "check_record",
    "of_role",
    "shown_of",
    "texts_of",
]

SCHEMA = 1

_DASHES = ("solid", "dash", "dot", "dashdot")
_NEEDED = ("title", "seed", "status", "injector", "parameters", "objective", "data", "generations")
_COMPARED = ("title", "labels", "models", "differences", "studies", "data")
_SENSITIVE = ("title", "design", "samples", "ranges", "outputs", "injections", "clock")
_TOLERATED = ("title", "parts", "injector", "dimensions", "points", "trim", "injections", "clock")
_JOINT = ("title", "seed", "status", "synthetic", "objective", "parts", "parameters", "generations")
_FOREIGN = ("title", "seed", "status", "fmu", "parameters", "objective", "data", "evaluations", "generations")
# by kind of record: its file, who writes it, and the keys that it must have
_FILES = {
    "calibration": ("result.json", "calibrate", _NEEDED),
    "comparison": ("comparison.json", "compare", _COMPARED),
    "sensitivity": ("sensitivity.json", "sensitivity", _SENSITIVE),
    "tolerance": ("tolerance.json", "tolerance", _TOLERATED),
    "family": ("family.json", "family", _JOINT),
    "fmu calibration": ("fmu-result.json", "calibrate", _FOREIGN),
}


def check_record(record: Any, folder: str, kind: str = "calibration") -> Record:
    """Return the record if this version can read it.

    Parameters
    ----------
    record : object
        Content of the file.
    folder : str
        Of the file.
    kind : str
        Kind that it has to be: a key of `_FILES`, such as "calibration".

    Raises
    ------
    InputError
        If it is of another kind or of another schema, or incomplete.
    """
    file, verb, needed = _FILES[kind]
    where = f"{folder}: {file}"
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


def by_kind(data: Sequence[Record]) -> Iterator[tuple[View, list[Record]]]:
    """Data sets of each kind that there is, with what reports show of it."""
    for name, kind in KINDS.items():
        if own := [d for d in data if d["kind"] == name]:
            yield kind.view, own


def of_role(data: Sequence[Record], role: str) -> list[Record]:
    """Data sets of one role: "fit" or "validation"."""
    return [d for d in data if d["role"] == role]
