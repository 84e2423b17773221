"""Update in sentences: in the terminal, first in the report of its run, and in notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from commonrail.base.text import MISSING, count_noun, join_words, number, percent, significant, to_fixed
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


def update_lines(content: Record) -> list[str]:
    """Sentences on an update, what is bad first: held-out data that are met worse, contradictions, what has moved."""
    unseen = [row for row in content["errors"] if row["role"] == "validation"]
    worse = [row for row in unseen if row["rises"]]
    keep = f"keep {content['run']} until you know why"
    lines = [f"Held-out data are predicted worse than before, so {keep}: {_changes(worse)}."] if worse else []
    ranked = sorted(content["new"], key=lambda row: _RANK.index(row["agreement"]))
    lines += [_agreement(row) for row in ranked[:SHOWN]]
    if rest := [row["agreement"] for row in ranked[SHOWN:]]:
        lines.append(
            f"Further new data: {join_words([f'{rest.count(word)} × {word}' for word in _RANK if word in rest])}."
        )
    far = sum(abs(row["moved"] or 0.0) > 1.0 for row in content["moved"])
    lines.append(
        f"{count_noun(far, 'parameter')} moved by more than half the earlier interval: "
        f"{'; '.join(map(_move, content['moved'][:SHOWN]))}."
    )
    lines.append(f"Errors of fitted data: {_changes([row for row in content['errors'] if row['role'] == 'fit'])}.")
    if met := [row for row in unseen if not row["rises"]]:
        lines.append(f"Errors of held-out data: {_changes(met)}.")
    if content["gone"]:
        prior = "; the draws of the run are the prior in their place, without correlations" if content["prior"] else ""
        lines.append(f"Data of the run that are gone: {join_words(content['gone'])}{prior}.")
    return lines


def _agreement(row: Record) -> str:
    words = f"{row['name']}: {row['agreement']}; error {_error(row['error'])}"
    if "covered" in row:
        words += f", {row['covered']} of {row['values']} values in the 90 % band"
    if row["baseline"]:
        words += f"; the run {'beats' if row['baseline']['beaten'] else 'does not beat'} {row['baseline']['text']}"
    if row["agreement"] == "contradicts":
        words += "; check that part, bench and operating points are the same before you use the new fit"
    return f"{words}."


def _changes(errors: Sequence[Record]) -> str:
    """Errors before and after, the largest rises first."""
    ranked = sorted(
        errors, key=lambda row: (number(row["before"]["size"]) or 0.0) - (number(row["after"]["size"]) or 0.0)
    )
    shown = [f"{row['name']} {_error(row['before'])} → {_error(row['after'])}" for row in ranked[:SHOWN]]
    return join_words(shown + [f"{len(ranked) - SHOWN} more"] * (len(ranked) > SHOWN)) or MISSING


def _error(error: Record) -> str:
    return f"{significant(error['size'], 2)} tolerances" if error["in_tolerances"] else f"{percent(error['size'])} %"


def _move(row: Record) -> str:
    before, after = (to_text(row[key], row["unit"], 4) for key in ("before", "after"))
    return f"{row['name']} {before} → {after} ({to_fixed(row['moved'], 1)} half widths)"


UPDATE = Presenter(lambda update: [f"Update in {update.folder}", *update.content["lines"]])
