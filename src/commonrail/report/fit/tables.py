"""Tables of a calibration or a validation: the terminal prints them and the report sets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import MISSING, quantity, quantity_range, significant, to_fixed, to_signed
from commonrail.calibration.record import CertainParameter, CertaintyRecord, ParameterRecord
from commonrail.data.records import LABELS, Record, Texts
from commonrail.report.fit.certainty import interval_digits, interval_text
from commonrail.report.fit.record import by_kind, short_names
from commonrail.report.parameter_names import FORMULA_SIGNS

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

    `interval` is by the likelihood where the certainty was computed, else the standard error of the best; both may
    be empty. `change` is that of the best against the start [%], `mark` says where the start value comes from. `effect`
    is the change of the residuals for a move of 1 % of the range: alone, and after the others have readjusted. `pull`
    is the distance of the best from the prior's value in its standard deviations, "+0.8 σ"; empty without a prior.
    `best_at` and `start_at` are positions between the bounds, `span` and `prior` left ends and widths of interval and
    prior there, all held within the bar [%]; `span` of the whole bar says that the data do not bound the value.
    `is_outside` says that the best lies outside the interval of the likelihood. `label` is the meaning, with the name
    as `detail`; a meaning that is a formula is the detail of a short name.
    """

    name: str
    label: str
    detail: str
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
    is_outside: bool = False


def parameter_rows(
    parameters: Sequence[ParameterRecord], certainty: CertaintyRecord | None = None
) -> list[ParameterRow]:
    """Rows of the table of parameters, in their order; `certainty` belongs to the same result."""
    certain = {p.name: p for p in certainty.parameters} if certainty else {}
    names = short_names([p.name for p in parameters])
    return [_row(p, certain.get(p.name), names[p.name]) for p in parameters]


def interval_head(certainty: CertaintyRecord | None) -> str:
    """Head of the column of intervals."""
    return f"{to_fixed(certainty.level, 0, 100.0)} % interval" if certainty else "standard error"


def parameter_table(parameters: Sequence[ParameterRecord], certainty: CertaintyRecord | None = None) -> Table:
    """Calibrated parameters for the terminal; the report shows them as bars."""
    rows = parameter_rows(parameters, certainty)
    columns: list[Column] = [
        ("parameter", lambda r: r.name),
        ("calibrated", lambda r: r.best),
        (interval_head(certainty), lambda r: r.interval or MISSING),
        ("what the data say", lambda r: r.verdict),
        ("start", lambda r: r.start),
        ("change, %", lambda r: r.change),
        ("bounds", lambda r: r.bounds),
        ("at a bound", lambda r: "yes" if r.at_bound else "no"),
    ]
    if any(r.pull for r in rows):
        columns.append(("from its prior", lambda r: r.pull or MISSING))
    return table_from_columns("Parameters", rows, columns)


def _row(p: ParameterRecord, certain: CertainParameter | None, short: str) -> ParameterRow:
    unit, start, best, prior = p.unit, p.reference, p.best, p.prior
    is_plain = bool(p.meaning) and not any(sign in p.meaning for sign in FORMULA_SIGNS)
    ends = (certain.lower, certain.upper) if certain else _about(best, p.standard_error)
    return ParameterRow(
        name=p.name,
        label=p.meaning if is_plain else short,
        detail=p.name if is_plain else p.meaning,
        meaning=p.meaning,
        source=p.source or "no source given",
        verdict=p.verdict or MISSING,
        start=quantity(start, unit),
        best=quantity(best, unit, max(4, interval_digits(certain)) if certain else 4),
        interval=interval_text(certain, p, 4) if certain else _error(p),
        bounds=quantity_range(p.lower, p.upper, unit, 3),
        change=to_signed(100.0 * (best / start - 1.0) if start else None, 1),
        mark=MARKS.get(p.mark, p.mark),
        effect=_effect(p),
        pull="" if p.pull is None else f"{to_signed(p.pull, 1)} σ",
        best_at=_percent(p, best),
        start_at=_percent(p, start),
        span=_span(p, *ends),
        prior=_span(p, *_about(prior.value, prior.sigma)) if prior else None,
        at_bound=p.at_bound,
        is_outside=_is_outside(best, certain),
    )


def _is_outside(best: float, certain: CertainParameter | None) -> bool:
    if certain is None or certain.lower is None or certain.upper is None:
        return False
    return not certain.lower <= best <= certain.upper


def _about(value: float, error: float | None) -> tuple[float | None, float | None]:
    return (None, None) if error is None else (value - error, value + error)


def _span(p: ParameterRecord, low: float | None, high: float | None) -> tuple[float, float] | None:
    """Left end and width on the bar [%]; None without both ends."""
    if low is None or high is None:
        return None
    left, right = _percent(p, low), _percent(p, high)
    return left, round(right - left, 2)


def _effect(p: ParameterRecord) -> str:
    if p.effect is None or p.pinned is None:
        return MISSING
    left = significant(p.pinned, 2) if p.pinned > _LEAST * p.effect else "none"
    return f"{significant(p.effect, 2)}, {left} with the others"


def _error(p: ParameterRecord) -> str:
    if p.standard_error is None:
        return ""
    wide = p.standard_error > p.upper - p.lower  # the linearised fit has no meaning there
    return "± more than its range" if wide else f"± {quantity(p.standard_error, p.unit, 3)}"


def _percent(p: ParameterRecord, value: float) -> float:
    share = (value - p.lower) / (p.upper - p.lower)
    return round(100.0 * min(max(share, 0.0), 1.0), 2)


def tables_of(data: Sequence[Record], texts: Texts = LABELS) -> list[Table]:
    """Every table that the data sets of a result, or of a validation, have something for.

    Errors and shares refer to the label "best", whatever its text.
    """
    return [table for view, records in by_kind(data) for table in view.tables(records, texts)]
