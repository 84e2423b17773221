"""Certainty of a fit in tables and sentences: intervals, verdicts, noise, and quantities of the bench."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import MISSING, count_noun, in_print, quantity, quantity_range, significant, to_fixed
from commonrail.calibration.record import CertainParameter, CertaintyRecord, NoiseRecord, ParameterRecord

DIGITS = 5
MOST_PERCENT = 1000.0  # of a value; a larger half interval or move is not given as a number
OPEN = "not bounded by the data"  # interval


def certainty_tables(certainty: CertaintyRecord | None, parameters: Sequence[ParameterRecord]) -> list[Table]:
    """Tables of stated combinations and most likely values, and `likelihood_tables`; none without certainty."""
    if certainty is None:
        return []
    tables = likelihood_tables(certainty)
    asked = 1 if certainty.combinations else 0
    return [*tables[:asked], _parameters(certainty, {p.name: p for p in parameters}), *tables[asked:]]


def likelihood_tables(certainty: CertaintyRecord | None) -> list[Table]:
    """Tables of stated combinations, quantities of the bench and noise; none without certainty."""
    if certainty is None:
        return []
    level = to_fixed(certainty.level, 0, 100.0)
    combinations: list[Column] = [
        ("sum [SI]", lambda c: c.sum),
        ("value", lambda c: significant(c.value, 4)),
        (f"{level} % interval", lambda c: f"{significant(c.lower, 4)} to {significant(c.upper, 4)}"),
    ]
    tables = [table_from_columns("Combinations", certainty.combinations, combinations, "Of the draws.")]
    bench = "Fitted and drawn with the parameters: their intervals hold what these quantities may be."
    tables.append(table_from_columns("Quantities of the bench", certainty.bench, _BENCH, bench, 2))
    noise = "Each data set counts by its own noise; the weights of the objective play no part in the likelihood."
    return [
        *(table for table in tables if table.rows),
        table_from_columns("Noise of the data", certainty.noise, _NOISE, noise, 2),
    ]


_BENCH: list[Column] = [
    ("quantity", lambda q: q.name),
    ("from", lambda q: q.source),
    ("stated", lambda q: f"{quantity(q.stated, q.unit, 3)} ± {quantity(q.deviation, q.unit, 2)}"),
    ("by the data", lambda q: f"{quantity(q.value, q.unit, 3)} ± {quantity(q.standard_error or 0.0, q.unit, 2)}"),
]


def _parameters(certainty: CertaintyRecord, records: dict[str, ParameterRecord]) -> Table:
    level = to_fixed(certainty.level, 0, 100.0)
    columns: list[Column] = [
        ("parameter", lambda p: p.name),
        ("what the data say", lambda p: p.sentence),
        ("most likely", lambda p: quantity(p.value, records[p.name].unit, DIGITS)),
        (f"{level} % interval", lambda p: interval_text(p, records[p.name])),
    ]
    note = (
        f"An interval holds the true value in {level} % of the benches that have the noise below and no law that the "
        "model lacks; it is of draws within bounds and constraints. A parameter is determined if half its "
        "interval is at most 10 % of its value."
    )
    return table_from_columns("Most likely values and intervals", certainty.parameters, columns, note, 2)


def interval_text(p: CertainParameter, record: ParameterRecord, digits: int = DIGITS) -> str:
    """Interval of a parameter as far as it lies within the bounds.

    An end beyond a bound is not given: the data do not limit the parameter on that side, and a stiffness, for example,
    cannot be negative. `record` is the parameter of the study.
    """
    if p.lower is None or p.upper is None:
        return MISSING
    below, above = record.lower > p.lower, record.upper < p.upper
    if (below and above) or (p.percent or 0.0) > MOST_PERCENT:
        return OPEN
    if below or above:
        return f"{'below' if below else 'above'} {quantity(p.upper if below else p.lower, record.unit, digits)}"
    return quantity_range(p.lower, p.upper, record.unit, max(digits, interval_digits(p)))


def interval_digits(p: CertainParameter) -> int:
    """Significant digits of a value that show the width of its interval with two digits; 1 without an interval."""
    if p.lower is None or p.upper is None:
        return 1
    size, width = max(abs(p.lower), abs(p.upper)), p.upper - p.lower
    return min(2 + math.floor(math.log10(size / width)), 12) if 0.0 < width < size else 1


def verdict_sentence(parameters: Sequence[ParameterRecord]) -> str:
    """Number of parameters by verdict."""
    counts = Counter(p.verdict for p in parameters)
    counted = [f"{count} {verdict}" for verdict, count in counts.most_common() if verdict]
    return f"{count_noun(len(parameters), 'parameter')}: {', '.join(counted) or 'not judged'}."


def certainty_lines(certainty: CertaintyRecord | None) -> list[str]:
    """Sentences on the search, the tests for lack of fit, the errors of the bench, and cures."""
    if certainty is None:
        return []
    lines = []
    if certainty.starts > 1:
        lines.append(f"{certainty.agreeing} of {certainty.starts} starts end within 0.5 of the largest 2 ln L.")
    if certainty.draws_refused:
        lines.append(f"The intervals also use the curvature of the likelihood, because {certainty.draws_refused}.")
    if certainty.withdrawn:
        lines.append(f"No parameter is confirmed, because {certainty.withdrawn}.")
    if certainty.discrepancy:  # an error of the model that no parameter mends
        share = significant(100.0 * certainty.discrepancy, 1)
        words = "in a way that no free parameter can correct; intervals and bands include this"
        lines.append(f"The model is off by about {share} % of the values {words}.")
    lines += [
        f"The residuals of {n.name} grow with the rate; their standard deviation was taken as {_deviation(n)}."
        for n in certainty.noise
        if n.relative and not n.stated
    ]
    counts = Counter(p.cure for p in certainty.parameters if p.cure)
    cures = [f"{cure} ({count_noun(count, 'parameter')})" for cure, count in counts.most_common()]
    return lines + ([f"To know more: {'; '.join(cures)}."] if cures else [])


def _deviation(n: NoiseRecord) -> str:
    """Standard deviation of a value, with its growth in percent of the rate."""
    grown = f" + {significant(100.0 * n.relative, 3)} % of the rate" if n.relative else ""
    return f"{significant(n.sigma, 3)} {in_print(n.unit)}{grown}"


def _law(n: NoiseRecord) -> str:
    order = f"autoregressive of order {n.order}" if n.order else "white"
    return f"{n.law}, {order}, {'stated' if n.stated else 'estimated'}"


_NOISE: list[Column] = [
    ("data set", lambda n: n.name),
    ("noise", _law),
    ("standard deviation", _deviation),
    ("values", lambda n: str(n.values)),
    ("share of −2 ln L, %", lambda n: to_fixed(n.share, 0, 100.0)),
    ("parameters it pays for", lambda n: to_fixed(n.parameters, 1)),
]
