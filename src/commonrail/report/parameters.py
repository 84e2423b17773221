"""The calibrated parameters against their bounds, as text and positions for a bar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from commonrail.display.table import Cell, Table
from commonrail.display.text import MISSING, number, quantity, signed, significant
from commonrail.kinds.records import Record

__all__ = ["ParameterRow", "parameter_rows", "parameter_table"]

MARKS = {
    "M": "measured",
    "C": "ECU calibration",
    "F": "fitted or derived",
    "E": "engineering estimate",
}
_COLUMNS = (
    "parameter",
    "what the data say",
    "start",
    "calibrated",
    "standard error",
    "change, %",
    "bounds",
    "at a bound",
)


@dataclass(frozen=True)
class ParameterRow:
    """One parameter.

    Attributes
    ----------
    name, meaning, source, verdict : str
    start, best, error, lower, upper : str
        Values with units; `error` is the standard error of the best.
    change : str
        Of the best against the start [%].
    mark : str
        Where the start value comes from, in words.
    effect, pinned : str
        Change of the residuals for a move of 1 % of the range: alone, and after the others have readjusted.
    pull : str
        Distance of the best from the prior's value in its standard deviations, "+0.8 σ"; empty without a prior.
    best_at, start_at : float
        Position between the bounds [%]; `start_at` is held within the bar.
    at_bound : bool
    """

    name: str
    meaning: str
    source: str
    verdict: str
    start: str
    best: str
    error: str
    lower: str
    upper: str
    change: str
    mark: str
    effect: str
    pinned: str
    pull: str
    best_at: float
    start_at: float
    at_bound: bool


def parameter_rows(parameters: Sequence[Record]) -> list[ParameterRow]:
    """Rows of the table of parameters, in the order of the study."""
    return [_row(p) for p in parameters]


def parameter_table(parameters: Sequence[Record]) -> Table:
    """Calibrated parameters for the terminal: what the report sets with bars."""
    found = parameter_rows(parameters)
    rows: list[tuple[str, ...]] = [
        (r.name, r.verdict, r.start, r.best, r.error or MISSING, r.change, f"{r.lower} to {r.upper}", _bound(r))
        for r in found
    ]
    columns: tuple[str, ...] = _COLUMNS
    if any(r.pull for r in found):
        columns = (*_COLUMNS, "from its prior")
        rows = [(*row, r.pull or MISSING) for row, r in zip(rows, found, strict=True)]
    return Table(
        "Parameters",
        columns,
        tuple(tuple(Cell(text) for text in row) for row in rows),
        texts=2,
    )


def _bound(row: ParameterRow) -> str:
    return "yes" if row.at_bound else "no"


def _row(p: Record) -> ParameterRow:
    unit, start, best = p["unit"], p["reference"], p["best"]
    return ParameterRow(
        name=p["name"],
        meaning=p["meaning"],
        source=p.get("source") or "no source given",
        verdict=p.get("verdict") or MISSING,
        start=quantity(start, unit),
        best=quantity(best, unit),
        error=_error(p),
        lower=quantity(p["lower"], unit, 3),
        upper=quantity(p["upper"], unit, 3),
        change=signed(100.0 * (best / start - 1.0) if start else None, 1),
        mark=MARKS.get(p["mark"], str(p["mark"])),
        effect=significant(p.get("effect"), 2),
        pinned=significant(p.get("pinned"), 2),
        pull=f"{signed(p['pull'], 1)} σ" if number(p.get("pull")) is not None else "",
        best_at=_percent(p, best),
        start_at=_percent(p, start),
        at_bound=bool(p.get("at_bound")),
    )


def _error(p: Record) -> str:
    error = number(p.get("standard_error"))
    if error is None:
        return ""
    wide = error > p["upper"] - p["lower"]  # the linearised fit has no meaning there
    return "± more than its range" if wide else f"± {quantity(error, p['unit'], 3)}"


def _percent(p: Record, value: float) -> float:
    share = float((value - p["lower"]) / (p["upper"] - p["lower"]))
    return round(100.0 * min(max(share, 0.0), 1.0), 2)
