"""Certainty of a fit in tables and sentences: intervals, verdicts, noise, and quantities of the bench."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from commonrail.base.table import Part, Table, table_of
from commonrail.base.text import MISSING, counted, fixed, in_print, number, quantity, quantity_range, significant
from commonrail.data.records import Record

DIGITS = 5
MOST_PERCENT = 1000.0  # of a value, above which half an interval or a move is no figure any more
OPEN = "not bounded by the data"  # interval


def certainty_tables(record: Record) -> list[Table]:
    """Tables of a record with the key "certainty": most likely values, and `likelihood_tables`; none without it."""
    found = record.get("certainty")
    known = {p["name"]: p for p in record["parameters"]}
    return [_parameters(found, known), *likelihood_tables(record)] if found else []


def likelihood_tables(record: Record) -> list[Table]:
    """Tables of stated combinations, quantities of the bench and noise; none of a record without certainty."""
    found = record.get("certainty")
    if not found:
        return []
    tables = [_combinations(found)] if found["combinations"] else []
    tables += [_bench(found["bench"])] if found["bench"] else []
    return [*tables, _noise(found["noise"])]


def interval_text(p: Record, known: Record, digits: int = DIGITS) -> str:
    """Interval of a parameter as far as it lies within the bounds.

    An end beyond a bound says that the data do not bound the parameter on that side: a stiffness has no negative values
    that could be given for it. `p` is a parameter of the certainty, `known` that of the study.
    """
    low, high = number(p["lower"]), number(p["upper"])
    if low is None or high is None:
        return MISSING
    below, above = known.get("lower", low) > low, known.get("upper", high) < high
    if (below and above) or (number(p.get("percent")) or 0.0) > MOST_PERCENT:
        return OPEN
    if below or above:
        return f"{'below' if below else 'above'} {quantity(high if below else low, known['unit'], digits)}"
    return quantity_range(low, high, known["unit"], max(digits, interval_digits(p)))


def interval_digits(p: Record) -> int:
    """Significant digits that show the width of the interval of a parameter with two; 1 without an interval."""
    low, high = number(p["lower"]), number(p["upper"])
    if low is None or high is None:
        return 1
    size, width = max(abs(low), abs(high)), high - low
    return min(2 + math.floor(math.log10(size / width)), 12) if 0.0 < width < size else 1


def certainty_lines(record: Record) -> list[str]:
    """Sentences on the search, the tests for lack of fit, what the bench may be off by, and cures."""
    found = record.get("certainty")
    if not found:
        return []
    return [
        *_search(found),
        *([f"No parameter is called pinned, because {found['withdrawn']}."] if found["withdrawn"] else []),
        *_discrepancy(found),
        *_grown(found["noise"]),
        *_cures(found["parameters"]),
    ]


def _parameters(found: Record, known: Mapping[str, Record]) -> Table:
    level = fixed(found["level"], 0, 100.0)
    parts: tuple[Part, ...] = (
        Part(("parameter", "what the data say"), lambda p: (p["name"], p["sentence"])),
        Part(
            ("most likely", f"{level} % interval"),
            lambda p: (quantity(p["value"], known[p["name"]]["unit"], DIGITS), interval_text(p, known[p["name"]])),
        ),
    )
    note = (
        f"An interval holds the true value in {level} % of the benches that have the noise below and no law that the "
        "model lacks; it is of draws within bounds and constraints. A parameter is pinned if half its interval is at "
        "most 10 % of its value."
    )
    return table_of("Most likely values and intervals", found["parameters"], parts, note, 2)


def _combinations(found: Record) -> Table:
    level = fixed(found["level"], 0, 100.0)
    parts = (
        Part(("sum [SI]",), lambda c: (c["sum"],)),
        Part(
            ("value", f"{level} % interval"),
            lambda c: (significant(c["value"], 4), f"{significant(c['lower'], 4)} to {significant(c['upper'], 4)}"),
        ),
    )
    return table_of("Combinations", found["combinations"], parts, "Of the draws.", 1)


def _bench(bench: Sequence[Record]) -> Table:
    parts = (
        Part(("quantity", "from"), lambda q: (q["name"], q["source"])),
        Part(
            ("stated", "by the data"),
            lambda q: (
                f"{quantity(q['stated'], q['unit'], 3)} ± {quantity(q['deviation'], q['unit'], 2)}",
                f"{quantity(q['value'], q['unit'], 3)} ± {quantity(q['standard_error'] or 0.0, q['unit'], 2)}",
            ),
        ),
    )
    note = "Fitted and drawn with the parameters: their intervals hold what these quantities may be."
    return table_of("Quantities of the bench", bench, parts, note, 2)


def _noise(noise: Sequence[Record]) -> Table:
    parts = (
        Part(("data set", "noise"), lambda n: (n["name"], _law(n))),
        Part(
            ("standard deviation", "values", "share of −2 ln L, %", "parameters it pays for"),
            lambda n: (
                _deviation(n),
                str(n["values"]),
                fixed(n["share"], 0, 100.0),
                fixed(n["parameters"], 1),
            ),
        ),
    )
    note = "Each data set counts by its own noise; the weights of the objective play no part in the likelihood."
    return table_of("Noise of the data", noise, parts, note, 2)


def _deviation(n: Record) -> str:
    """Standard deviation of a value, with the share of the rate that it grows by."""
    relative = n["relative"]
    grown = f" + {significant(100.0 * relative, 3)} % of the rate" if relative else ""
    return f"{significant(n['sigma'], 3)} {in_print(n['unit'])}{grown}"


def _grown(noise: Sequence[Record]) -> list[str]:
    return [
        f"The residuals of {n['name']} grow with the rate; their standard deviation was taken as {_deviation(n)}."
        for n in noise
        if n["relative"] and not n["stated"]
    ]


def _law(n: Record) -> str:
    order = f"autoregressive of order {n['order']}" if n["order"] else "white"
    return f"{n['law']}, {order}, {'stated' if n['stated'] else 'estimated'}"


def _search(found: Record) -> list[str]:
    """Sentences on the starts and on the draws."""
    lines, draws = [], found["draws"]
    if found["starts"] > 1:
        lines.append(f"{found['agreeing']} of {found['starts']} starts end within 0.5 of the largest 2 ln L.")
    if draws["refused"]:
        lines.append(f"The intervals are those of the curvature too, because {draws['refused']}.")
    return lines


def _discrepancy(found: Record) -> list[str]:
    """Sentence on an error of the model that no parameter mends."""
    if not found["discrepancy"]:
        return []
    share = significant(100.0 * found["discrepancy"], 1)
    words = "in a way that no free parameter mends; intervals and bands hold it"
    return [f"The model is off by about {share} % of the values {words}."]


def _cures(parameters: Sequence[Record]) -> list[str]:
    """Sentence on what would make the parameters better known, and of how many."""
    counts = Counter(p["cure"] for p in parameters if p["cure"])
    cures = [f"{cure} ({counted(count, 'parameter')})" for cure, count in counts.most_common()]
    return [f"To know more: {'; '.join(cures)}."] if cures else []
