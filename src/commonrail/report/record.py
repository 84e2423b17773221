"""Records of result.json and comparison.json, read by kinds of data and labels of models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from commonrail.kinds import KINDS
from commonrail.kinds.base import View
from commonrail.kinds.records import LABELS, Record, Shown

__all__ = [
    "by_kind",
    "of_role",
    "shown_of",
]

_DASHES = ("solid", "dash", "dot", "dashdot")


def shown_of(record: Record) -> dict[str, Shown]:
    """Looks of the models: the fixed ones of a calibration, or a colour, marker and dash for each of a comparison."""
    texts: Mapping[str, str] = record["labels"]
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
