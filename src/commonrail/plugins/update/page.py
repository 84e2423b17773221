"""Sentences on an update, for the terminal, the report of the new run, and notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from commonrail.base.text import MISSING, count_noun, join_words, percent, significant, to_fixed
from commonrail.base.units import to_text
from commonrail.data.base import Role
from commonrail.plugins.update.record import (
    RECORD,
    Agreement,
    ChangedError,
    ErrorSize,
    MovedParameter,
    NewData,
    UpdateRecord,
)
from commonrail.report.presenter import Presenter
from commonrail.runs.folder import read_record

SHOWN = 3  # data sets and parameters that the sentences name
_RANK = (Agreement.CONTRADICTS, Agreement.OUTSIDE, Agreement.UNJUDGED, Agreement.AGREES)


def read_opening(folder: Path) -> tuple[str, list[str]]:
    """Title and first sentences of the report of an updated run."""
    return "Update", read_record(folder / RECORD, "commonrail update")["lines"]


def update_lines(record: UpdateRecord) -> list[str]:
    """Sentences on an update: first worse held-out data, then contradictions, then moved values."""
    unseen = [row for row in record.errors if row.role is Role.VALIDATION]
    worse = [row for row in unseen if row.rises]
    keep = f"keep {record.run} until you know why"
    lines = [f"Held-out data are predicted worse than before, so {keep}: {_changes(worse)}."] if worse else []
    ranked = sorted(record.new, key=lambda row: _RANK.index(row.agreement))
    lines += [_agreement(row) for row in ranked[:SHOWN]]
    if rest := [row.agreement for row in ranked[SHOWN:]]:
        lines.append(
            f"Further new data: {join_words([f'{rest.count(word)} × {word}' for word in _RANK if word in rest])}."
        )
    far = sum(abs(row.moved or 0.0) > 1.0 for row in record.moved)
    lines.append(
        f"{count_noun(far, 'parameter')} moved by more than half the earlier interval: "
        f"{'; '.join(map(_move, record.moved[:SHOWN]))}."
    )
    lines.append(f"Errors of fitted data: {_changes([row for row in record.errors if row.role is Role.FIT])}.")
    if met := [row for row in unseen if not row.rises]:
        lines.append(f"Errors of held-out data: {_changes(met)}.")
    if record.gone:
        prior = "; the draws of the run replace them as priors, without correlations" if record.prior else ""
        lines.append(f"Missing data of the run: {join_words(record.gone)}{prior}.")
    return lines


def _agreement(row: NewData) -> str:
    words = f"{row.name}: {row.agreement}; error {_error(row.error)}"
    if row.covered is not None:
        words += f", {row.covered} of {row.values} values in the 90 % band"
    if row.baseline:
        words += f"; the run {'beats' if row.baseline.beaten else 'does not beat'} {row.baseline.text}"
    if row.agreement is Agreement.CONTRADICTS:
        words += "; check that part, bench and operating points are the same before you use the new fit"
    return f"{words}."


def _changes(errors: Sequence[ChangedError]) -> str:
    """Errors before and after, the largest rises first."""
    ranked = sorted(errors, key=lambda row: (row.before.size or 0.0) - (row.after.size or 0.0))
    shown = [f"{row.name} {_error(row.before)} → {_error(row.after)}" for row in ranked[:SHOWN]]
    return join_words(shown + [f"{len(ranked) - SHOWN} more"] * (len(ranked) > SHOWN)) or MISSING


def _error(error: ErrorSize) -> str:
    return f"{significant(error.size, 2)} tolerances" if error.in_tolerances else f"{percent(error.size)} %"


def _move(row: MovedParameter) -> str:
    before, after = (to_text(value, row.unit, 4) for value in (row.before, row.after))
    return f"{row.name} {before} → {after} ({to_fixed(row.moved, 1)} half widths)"


UPDATE = Presenter(lambda update: [f"Update in {update.folder}", *update.content["lines"]])
