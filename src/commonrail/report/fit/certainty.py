"""Certainty of a fit in tables and sentences: intervals with their estimators, verdicts, noise, sensitivities."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from commonrail.base.table import Part, Table, table_of
from commonrail.base.text import (
    MISSING,
    counted,
    fixed,
    in_print,
    listed,
    number,
    quantity,
    quantity_range,
    significant,
)
from commonrail.data.records import Record

DIGITS = 5
MOST_PERCENT = 1000.0  # of a value, above which half an interval or a move is no figure any more
OPEN = "not bounded by the data"  # interval
FRICTION = "friction"  # suspect of the test that fits it


def certainty_tables(record: Record) -> list[Table]:
    """Tables of a record with the key "certainty": most likely values, and `likelihood_tables`; none without it."""
    found = record.get("certainty")
    known = {p["name"]: p for p in record["parameters"]}
    return [_parameters(found, known), *likelihood_tables(record)] if found else []


def likelihood_tables(record: Record) -> list[Table]:
    """Tables of stated combinations, of the posterior and of the noise; none of a record without certainty."""
    found = record.get("certainty")
    if not found:
        return []
    units = {p["name"]: p["unit"] for p in record["parameters"]}
    tables = []
    if found["combinations"]:
        tables.append(_combinations(found))
    if found.get("posterior"):
        tables.append(posterior_table(found["posterior"], units))
    return [*tables, _noise(found["noise"])]


class Difference(NamedTuple):
    """Sentence on most likely values that differ from the calibrated ones.

    It matters if the difference is larger than noise explains, or an interval excludes the calibrated value beside it.
    """

    sentence: str
    matters: bool


def difference(record: Record) -> Difference | None:
    """Difference of the most likely values from the calibrated ones; None of a record without it.

    It matters if an interval, or the joint region of all parameters, excludes the calibrated values.
    """
    found = record.get("certainty")
    if not found:
        return None
    from commonrail.calibration.identifiability import outside_joint_region  # slow to import

    if "taken" in found and found["gain"] == 0.0:
        return Difference("The calibrated values are the most likely ones, which were adopted.", False)
    best = {p["name"]: number(p.get("best")) for p in record["parameters"]}
    excluded = [p["name"] for p in found["parameters"] if _excludes(p, best[p["name"]])]
    gain = number(found["gain"])
    matters = bool(excluded) or (gain is not None and outside_joint_region(gain, len(best)))
    if gain is None and not excluded:
        return None
    higher = "" if gain is None else f": 2 ln L is higher by {significant(gain, 3)} at the most likely values"
    if matters and found["starts"] > 1:
        sentence = f"Other values, which commonrail certainty has, fit better, by more than noise explains{higher}."
    elif matters:
        sentence = f"Other values near these fit the data better, by more than noise explains{higher}."
    else:
        sentence = f"Calibrated and most likely values differ by no more than noise explains{higher}."
    level = fixed(found["level"], 0, 100.0)
    if excluded:
        sentence += f" There the {level} % interval excludes the calibrated value of {listed(excluded)}."
    return Difference(
        f"{sentence} The calibrated values minimise the objective; intervals and verdicts hold about the most likely "
        "ones.",
        matters,
    )


def _excludes(p: Record, best: float | None) -> bool:
    low, high = number(p.get("lower")), number(p.get("upper"))
    return best is not None and low is not None and high is not None and not low <= best <= high


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
    differs = difference(record)
    return [
        *([differs.sentence] if differs else []),
        *_search(found),
        *([f"No parameter is called pinned, because {found['withdrawn']}."] if found["withdrawn"] else []),
        *_grown(found["noise"]),
        *_stated(found["parameters"]),
        *_fitted(found),
        *_sensitivity(found),
        *_visible(found),
        *_friction(found),
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
    estimators = {p["estimator"] for p in found["parameters"]}
    if len(estimators) > 1:
        parts = (*parts[:1], Part(("estimator",), lambda p: (p["estimator"],)), *parts[1:])
    note = (
        f"An interval holds the true value in {level} % of the benches that have the noise below and no law that the "
        "model lacks. Bounds and constraints do not narrow it; an end beyond a bound is left out. A parameter is "
        "pinned if half its interval is at most 10 % of its value."
    )
    if len(estimators) == 1:
        note += f" Estimator of all: {min(estimators)}."
    return table_of("Most likely values and intervals", found["parameters"], parts, note, 2 + (len(estimators) > 1))


def _combinations(found: Record) -> Table:
    half = f"half of the {fixed(found['level'], 0, 100.0)} % interval"
    parts = (
        Part(("sum [SI]",), lambda c: (c["sum"],)),
        Part(("value", half), lambda c: (significant(c["value"], 4), significant(c["half_width"], 3))),
    )
    return table_of("Combinations", found["combinations"], parts, "By the curvature of the likelihood.", 1)


def posterior_table(drawn: Record, units: Record) -> Table:
    """Medians, intervals, R-hat and effective draws of the record of a posterior; units are SI, by parameter."""
    level = fixed(drawn["level"], 0, 100.0)
    parts = (
        Part(("parameter",), lambda p: (p["name"],)),
        Part(
            ("median", f"{level} % interval"),
            lambda p: (
                MISSING if number(p["median"]) is None else quantity(p["median"], units[p["name"]], DIGITS),
                interval_text(p, {"unit": units[p["name"]]}),
            ),
        ),
        Part(("R-hat", "effective draws"), lambda p: (fixed(p["r_hat"], 3), fixed(p["effective"], 0))),
    )
    note = (
        f"{drawn['chains']} chains of {drawn['steps']} steps, {drawn['simulated']} simulations, {drawn['failed']} of "
        f"them failed; {fixed(drawn['accepted'], 0, 100.0)} % of the proposals accepted. Within bounds and constraints."
    )
    if drawn["refused"]:
        note = f"Refused: {drawn['refused']}. {note}"
    return table_of("Posterior", drawn["parameters"], parts, note, 1)


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
    starts = found["starts"]
    lines = []
    if starts == 1:
        lines.append(
            "The intervals are local: one start, from the best values. commonrail certainty RUN searches from "
            "several and profiles the likelihood."
        )
    else:
        lines.append(
            f"{found['agreeing']} of {starts} starts end within 0.5 of the largest 2 ln L, or beyond its ripple within "
            "0.7 standard errors of every parameter."
        )
    if found["adopted"]:
        lines.append("A profile met a better fit than the search had found; all figures here are those of that fit.")
    return lines


def _stated(parameters: Sequence[Record]) -> list[str]:
    """One sentence for each uncertain quantity that the study states."""
    lines = []
    for k, one in enumerate(parameters[0]["moved_by"]):
        moves = [(p["name"], number(p["moved_by"][k]["percent"])) for p in parameters]
        text = quantity(one["deviation"], one["unit"], 3)
        lines.append(f"One standard deviation of the {one['name']} ({text}) moves {_moves(moves)}.")
    return lines


def _is_stated(found: Record, name: str) -> bool:
    """True if the study states a quantity of a meter as uncertain."""
    return any(one["name"].startswith(f"{name} of ") for one in found["parameters"][0]["moved_by"])


def _sensitivity(found: Record) -> list[str]:
    """One sentence for each quantity of the bench that the study does not state."""
    names = [p["name"] for p in found["parameters"]]
    lines = []
    for one in found["sensitivity"]:
        if _is_stated(found, one["quantity"]):
            continue  # said already, by fits that know more than derivatives
        moves = list(zip(names, map(number, one["percent"]), strict=True))
        lines.append(f"{one['text']} would move {_moves(moves)}.")
    return lines


def _fitted(found: Record) -> list[str]:
    """Sentence on the quantities that were fitted within what the study states."""
    values = [f"{one['name']} {quantity(one['value'], one['unit'], 2)}" for one in found["fitted_as_stated"]]
    return [f"Fitted within what the study states, and integrated out: {listed(values)}."] if values else []


def _visible(found: Record) -> list[str]:
    """Sentence on the smallest delay of the meter that the tests find."""
    delay = number(found["visible_delay"])
    if delay is None:
        return []
    words = "beyond what the study states" if _is_stated(found, "delay") else "which the study lacks"
    return [
        f"A delay of the meter of {quantity(delay, 's', 2)}, {words}, would be found in 9 of 10 benches "
        "with this noise; a smaller one mostly stays hidden in the parameters."
    ]


def _friction(found: Record) -> list[str]:
    """Sentence on a test of friction that found none; what it finds withdraws the verdicts, which is said elsewhere."""
    done = next((test for test in found["tests"] if test["suspect"] == FRICTION and not test["found"]), None)
    if done is None:
        return []
    return [
        "All parameters were fitted once more with dry and viscous friction of the guides free: it explains the curves "
        f"no better than chance does (probability {significant(done['score'], 2)}). Small friction may stay hidden in "
        "the parameters."
    ]


def _moves(moves: Sequence[tuple[str, float | None]]) -> str:
    """Largest moves first: "k7 by 12 %, k1 by 3 %"."""
    known = sorted(((abs(m), name) for name, m in moves if m is not None), reverse=True)[:4]
    return listed([f"{name} by {_share(move)}" for move, name in known])


def _share(percent: float) -> str:
    """Percentage in words: "12 %", "more than 1000 %"."""
    most = percent > MOST_PERCENT
    return f"more than {MOST_PERCENT:g} %" if most else f"{significant(percent, 2)} %"


def _cures(parameters: Sequence[Record]) -> list[str]:
    """Sentence on what would make the parameters better known, and of how many."""
    counts = Counter(p["cure"] for p in parameters if p["cure"])
    cures = [f"{cure} ({counted(count, 'parameter')})" for cure, count in counts.most_common()]
    return [f"To know more: {'; '.join(cures)}."] if cures else []
