"""Tables of a calibration or a validation: the terminal prints them and the report sets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from commonrail.base.table import Cell, Table
from commonrail.base.text import MISSING, fixed, number, quantity, signed, significant
from commonrail.data.records import LABELS, Record, Texts
from commonrail.report.fit.certainty import interval_text
from commonrail.report.fit.record import by_kind

# The calibrated parameters against their bounds, as text and positions for a bar.

MARKS = {
    "M": "measured",
    "C": "ECU calibration",
    "F": "fitted or derived",
    "E": "engineering estimate",
}
_LEAST = 1e-6  # of the effect alone: below, an effect with the others is the rounding of the derivatives


@dataclass(frozen=True)
class ParameterRow:
    """One parameter in words; values have their units.

    `error` is the standard error of the best, empty where there is a most likely value. `likely` is that and its
    interval, which is not about the best one; empty where the certainty was not computed. `change` is that of the best
    against the start [%], `mark` says where the start value comes from. `effect` is the change of the residuals for a
    move of 1 % of the range: alone, and after the others have readjusted. `pull` is the distance of the best from the
    prior's value in its standard deviations, "+0.8 σ"; empty without a prior. `best_at` and `start_at` are positions
    between the bounds, held within the bar [%].
    """

    name: str
    meaning: str
    source: str
    verdict: str
    start: str
    best: str
    error: str
    likely: str
    lower: str
    upper: str
    change: str
    mark: str
    effect: str
    pull: str
    best_at: float
    start_at: float
    at_bound: bool


def parameter_rows(parameters: Sequence[Record], certainty: Record | None = None) -> list[ParameterRow]:
    """Rows of the table of parameters, in their order; `certainty` is that of the same result."""
    likely = {p["name"]: p for p in certainty["parameters"]} if certainty else {}
    level = fixed(certainty["level"], 0, 100.0) if certainty else ""
    return [_row(p, likely.get(p["name"]), level) for p in parameters]


def parameter_table(parameters: Sequence[Record], certainty: Record | None = None) -> Table:
    """Calibrated parameters for the terminal: what the report sets with bars.

    The table of the `certainty` of the same result follows, and has the intervals about the most likely values.
    """
    found = parameter_rows(parameters, certainty)
    columns = {
        "parameter": [r.name for r in found],
        "what the data say": [r.verdict for r in found],
        "start": [r.start for r in found],
        "calibrated": [r.best for r in found],
        "standard error": [r.error or MISSING for r in found],
        "change, %": [r.change for r in found],
        "bounds": [f"{r.lower} to {r.upper}" for r in found],
        "at a bound": ["yes" if r.at_bound else "no" for r in found],
        "from its prior": [r.pull or MISSING for r in found],
    }
    if certainty:
        del columns["standard error"]
    if not any(r.pull for r in found):
        del columns["from its prior"]
    rows = zip(*columns.values(), strict=True)
    return Table("Parameters", tuple(columns), tuple(tuple(map(Cell, row)) for row in rows), texts=2)


def _row(p: Record, likely: Record | None, level: str) -> ParameterRow:
    unit, start, best = p["unit"], p["reference"], p["best"]
    return ParameterRow(
        name=p["name"],
        meaning=p["meaning"],
        source=p.get("source") or "no source given",
        verdict=p.get("verdict") or MISSING,
        start=quantity(start, unit),
        best=quantity(best, unit),
        error="" if likely else _error(p),
        likely=f"{quantity(likely['value'], unit)}, {level} %: {interval_text(likely, p, 4)}" if likely else "",
        lower=quantity(p["lower"], unit, 3),
        upper=quantity(p["upper"], unit, 3),
        change=signed(100.0 * (best / start - 1.0) if start else None, 1),
        mark=MARKS.get(p["mark"], str(p["mark"])),
        effect=_effect(p),
        pull=f"{signed(p['pull'], 1)} σ" if number(p.get("pull")) is not None else "",
        best_at=_percent(p, best),
        start_at=_percent(p, start),
        at_bound=bool(p.get("at_bound")),
    )


def _effect(p: Record) -> str:
    effect, pinned = number(p.get("effect")), number(p.get("pinned"))
    if effect is None or pinned is None:
        return MISSING
    left = significant(pinned, 2) if pinned > _LEAST * effect else "none"
    return f"{significant(effect, 2)}, {left} with the others"


def _error(p: Record) -> str:
    error = number(p.get("standard_error"))
    if error is None:
        return ""
    wide = error > p["upper"] - p["lower"]  # the linearised fit has no meaning there
    return "± more than its range" if wide else f"± {quantity(error, p['unit'], 3)}"


def _percent(p: Record, value: float) -> float:
    share = float((value - p["lower"]) / (p["upper"] - p["lower"]))
    return round(100.0 * min(max(share, 0.0), 1.0), 2)


def tables_of(data: Sequence[Record], texts: Texts = LABELS) -> list[Table]:
    """Every table that the data sets of a result, or of a validation, have something for.

    Errors and shares are those of the label "best", whatever its text.
    """
    return [table for view, own in by_kind(data) for table in view.tables(own, texts)]
