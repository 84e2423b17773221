"""Tables of a calibration or a validation: the terminal prints them and the report sets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from commonrail.base.table import Cell, Table
from commonrail.base.text import MISSING, fixed, number, quantity, quantity_range, signed, significant
from commonrail.data.records import LABELS, Record, Texts
from commonrail.report.fit.certainty import interval_digits, interval_text
from commonrail.report.fit.record import by_kind, short_names

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

    `interval` is that of the likelihood where the certainty was computed, else the standard error of the best; both may
    be empty. `change` is that of the best against the start [%], `mark` says where the start value comes from. `effect`
    is the change of the residuals for a move of 1 % of the range: alone, and after the others have readjusted. `pull`
    is the distance of the best from the prior's value in its standard deviations, "+0.8 σ"; empty without a prior.
    `best_at` and `start_at` are positions between the bounds, `span` and `prior` left ends and widths of interval and
    prior there, all held within the bar [%]; `span` of the whole bar says that the data do not bound the value.
    """

    name: str
    short: str
    meaning: str
    source: str
    verdict: str
    start: str
    best: str
    interval: str
    bounds: str
    change: str
    mark: str
    effect: str
    pull: str
    best_at: float
    start_at: float
    span: tuple[float, float] | None
    prior: tuple[float, float] | None
    at_bound: bool


def parameter_rows(parameters: Sequence[Record], certainty: Record | None = None) -> list[ParameterRow]:
    """Rows of the table of parameters, in their order; `certainty` is that of the same result."""
    known = {p["name"]: p for p in certainty["parameters"]} if certainty else {}
    names = short_names([p["name"] for p in parameters])
    return [_row(p, known.get(p["name"]), names[p["name"]]) for p in parameters]


def interval_head(certainty: Record | None) -> str:
    """Head of the column of intervals."""
    return f"{fixed(certainty['level'], 0, 100.0)} % interval" if certainty else "standard error"


def parameter_table(parameters: Sequence[Record], certainty: Record | None = None) -> Table:
    """Calibrated parameters for the terminal: what the report sets with bars."""
    found = parameter_rows(parameters, certainty)
    columns = {
        "parameter": [r.name for r in found],
        "calibrated": [r.best for r in found],
        interval_head(certainty): [r.interval or MISSING for r in found],
        "what the data say": [r.verdict for r in found],
        "start": [r.start for r in found],
        "change, %": [r.change for r in found],
        "bounds": [r.bounds for r in found],
        "at a bound": ["yes" if r.at_bound else "no" for r in found],
        "from its prior": [r.pull or MISSING for r in found],
    }
    if not any(r.pull for r in found):
        del columns["from its prior"]
    rows = zip(*columns.values(), strict=True)
    return Table("Parameters", tuple(columns), tuple(tuple(map(Cell, row)) for row in rows))


def _row(p: Record, known: Record | None, short: str) -> ParameterRow:
    unit, start, best = p["unit"], p["reference"], p["best"]
    return ParameterRow(
        name=p["name"],
        short=short,
        meaning=p["meaning"],
        source=p.get("source") or "no source given",
        verdict=p.get("verdict") or MISSING,
        start=quantity(start, unit),
        best=quantity(best, unit, max(4, interval_digits(known)) if known else 4),
        interval=interval_text(known, p, 3) if known else _error(p),
        bounds=quantity_range(p["lower"], p["upper"], unit, 3),
        change=signed(100.0 * (best / start - 1.0) if start else None, 1),
        mark=MARKS.get(p["mark"], str(p["mark"])),
        effect=_effect(p),
        pull=f"{signed(p['pull'], 1)} σ" if number(p.get("pull")) is not None else "",
        best_at=_percent(p, best),
        start_at=_percent(p, start),
        span=_span(p, *_ends(p, known)),
        prior=_prior(p),
        at_bound=bool(p.get("at_bound")),
    )


def _ends(p: Record, known: Record | None) -> tuple[float | None, float | None]:
    """Ends of the interval of a parameter, or of its standard error about the best."""
    if known:
        return number(known["lower"]), number(known["upper"])
    error = number(p.get("standard_error"))
    return (None, None) if error is None else (p["best"] - error, p["best"] + error)


def _prior(p: Record) -> tuple[float, float] | None:
    """One standard deviation of the prior about its value, on the bar [%]."""
    prior = p.get("prior")
    return _span(p, prior["value"] - prior["sigma"], prior["value"] + prior["sigma"]) if prior else None


def _span(p: Record, low: float | None, high: float | None) -> tuple[float, float] | None:
    """Left end and width on the bar [%]; None without both ends."""
    if low is None or high is None:
        return None
    left, right = _percent(p, low), _percent(p, high)
    return left, round(right - left, 2)


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
