"""Update in sentences: in the terminal, first in the report of its run, and in notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from commonrail.base.text import MISSING, counted, fixed, listed, number, percent, significant
from commonrail.base.units import to_text
from commonrail.data.records import Record
from commonrail.report.presenter import Presenter
from commonrail.runs.folder import read_record

RECORD = "update.json"  # in the folder of the new run
SHOWN = 3  # data sets and parameters that the sentences name one by one
_RANK = ("contradicts", "outside the bands", "not judged", "agrees")


def read_opening(folder: Path) -> tuple[str, list[str]]:
    """Title and sentences that the report of an updated run opens with."""
    return "Update", read_record(folder / RECORD, "commonrail update")["lines"]


def update_lines(found: Record) -> list[str]:
    """Sentences on an update, what is bad first: held-out data that are met worse, contradictions, what has moved."""
    unseen = [one for one in found["errors"] if one["role"] == "validation"]
    worse = [one for one in unseen if one["rises"]]
    keep = f"keep {found['run']} until you know why"
    lines = [f"Held-out data are predicted worse than before, so {keep}: {_changes(worse)}."] if worse else []
    ranked = sorted(found["new"], key=lambda one: _RANK.index(one["agreement"]))
    lines += [_agreement(one) for one in ranked[:SHOWN]]
    if rest := [one["agreement"] for one in ranked[SHOWN:]]:
        lines.append(f"Further new data: {listed([f'{rest.count(word)} × {word}' for word in _RANK if word in rest])}.")
    far = sum(abs(one["moved"] or 0.0) > 1.0 for one in found["moved"])
    lines.append(
        f"{counted(far, 'parameter')} moved by more than half the earlier interval: "
        f"{'; '.join(map(_move, found['moved'][:SHOWN]))}."
    )
    lines.append(f"Errors of fitted data: {_changes([one for one in found['errors'] if one['role'] == 'fit'])}.")
    if met := [one for one in unseen if not one["rises"]]:
        lines.append(f"Errors of held-out data: {_changes(met)}.")
    if found["gone"]:
        prior = "; the draws of the run are the prior in their place, without correlations" if found["prior"] else ""
        lines.append(f"Data of the run that are gone: {listed(found['gone'])}{prior}.")
    return lines


def _agreement(one: Record) -> str:
    words = f"{one['name']}: {one['agreement']}; error {_error(one['error'])}"
    if "covered" in one:
        words += f", {one['covered']} of {one['values']} values in the 90 % band"
    if one["baseline"]:
        words += f"; the run {'beats' if one['baseline']['beaten'] else 'does not beat'} {one['baseline']['text']}"
    if one["agreement"] == "contradicts":
        words += "; check that part, bench and operating points are the same before you use the new fit"
    return f"{words}."


def _changes(errors: Sequence[Record]) -> str:
    """Errors before and after, the largest rises first."""
    ranked = sorted(
        errors, key=lambda one: (number(one["before"]["size"]) or 0.0) - (number(one["after"]["size"]) or 0.0)
    )
    shown = [f"{one['name']} {_error(one['before'])} → {_error(one['after'])}" for one in ranked[:SHOWN]]
    return listed(shown + [f"{len(ranked) - SHOWN} more"] * (len(ranked) > SHOWN)) or MISSING


def _error(error: Record) -> str:
    return f"{significant(error['size'], 2)} tolerances" if error["in_tolerances"] else f"{percent(error['size'])} %"


def _move(one: Record) -> str:
    before, after = (to_text(one[key], one["unit"], 4) for key in ("before", "after"))
    return f"{one['name']} {before} → {after} ({fixed(one['moved'], 1)} half widths)"


UPDATE = Presenter(lambda found: [f"Update in {found.folder}", *found.content["lines"]])
