"""Verdicts on parameters in plain words, from the width of their intervals relative to their values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.text import listed, quantity, significant
from commonrail.calibration.identifiability import LIMIT, ParameterVerdict
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.physics.meters import is_of_meter, parts_of
from commonrail.plugins.certainty.covariance import student
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.lack_of_fit import LackOfFit, meter_changes
from commonrail.plugins.certainty.noise_fit import spread

# Sensitivity of the estimates to what the bench may be off by, whether a study states it or not.


class Assumed(NamedTuple):
    """Change of the bench that is tried on the estimates: quantity, size [SI] and unit, and the size in words."""

    key: str
    change: float
    unit: str
    size: str

    @property
    def text(self) -> str:
        """Size and quantity in words."""
        return f"{self.size} of {self.key}"

    @property
    def owner(self) -> str:
        """Quantity in words."""
        return "discrepancy of the model" if self.key == "discrepancy" else f"{self.key} of the meter"


# Engineering estimates of what bench and model leave open where a study states nothing. The delay of a meter is seldom
# known to better than a fraction of a sample, its gain to better than a calibration; the discrepancy is a share of the
# largest rate over the time that a needle's motion takes.
ASSUMED = (Assumed("delay", 1e-6, "s", "1 µs"), Assumed("gain", 0.01, "1", "1 %"))
DISCREPANCY = Assumed("discrepancy", 0.01, "1", "1 %")
LENGTH = 50e-6  # over which the assumed discrepancy is correlated [s]


def assumed_shifts(estimate: Estimate) -> list[tuple[Assumed, Floats]]:
    """Changes (1, d) of the estimates [SI] by each assumed change of the bench that has any effect.

    All data sets that see the quantity change together. It takes no simulation: a delay moves the model's course, a
    gain stretches it.
    """
    likelihood = estimate.likelihood
    found = []
    for assumed in ASSUMED:
        shift = np.zeros((1, likelihood.size))
        for block in likelihood.blocks:
            changes = meter_changes(block, estimate.errors[block.rows])
            shift[0, block.rows] = assumed.change * changes.get(assumed.key, 0.0)
        if shift.any():
            found.append((assumed, estimate.value_shifts(shift)))
    return found


def unstated(estimate: Estimate) -> list[tuple[Assumed, Floats]]:
    """Assumed quantities that a study does not state, and the moves (k, d) [SI] of the estimates that add up to each.

    Delay and gain count where they are neither uncertain nor free, a discrepancy where a course in time states none.
    """
    likelihood = estimate.likelihood
    known = {nuisance.key for nuisance in likelihood.nuisances}
    known |= {parts_of(name)[1] for name in likelihood.names if is_of_meter(name)}
    found = [(assumed, move) for assumed, move in assumed_shifts(estimate) if assumed.key not in known]
    rows = []
    for block in likelihood.blocks:
        if block.ordered and not block.noise.discrepancy:
            largest = float(np.abs(estimate.errors[block.rows] - block.at_zero).max())
            courses = block.courses(DISCREPANCY.change * largest, LENGTH)
            rows.append(estimate.value_shifts(spread(block, courses, likelihood.size)))
    return [*found, (DISCREPANCY, np.vstack(rows))] if rows else found


def sensitivity_records(estimate: Estimate) -> list[dict[str, Any]]:
    """JSON-able forms: quantity, change, unit, and the change of each parameter in percent of its value."""
    values = np.abs(estimate.point)
    return [
        {
            "quantity": assumed.key,
            "change": assumed.change,
            "unit": assumed.unit,
            "text": assumed.text,
            "percent": [float(100.0 * m / v) if v > 0.0 else None for m, v in zip(move[0], values, strict=True)],
        }
        for assumed, move in assumed_shifts(estimate)
    ]


NAMED = 0.5  # correlation from which another parameter is named
MOST_NAMED = 3
NOTICED = 1.1  # half width with what is assumed over that without, from which both are given
MOSTLY = 0.5  # share of the variance from which an uncertain quantity is blamed
MOST_TOLD = 10.0  # half width over value, above which it is no figure any more


class Assessment(NamedTuple):
    """Verdict on a parameter."""

    verdict: ParameterVerdict
    sentence: str  # verdict with its figure
    cure: str  # measurement or statement that would improve it; empty for a pinned parameter
    # half width [SI] that the verdict rests on: that of the interval, and of the delay, the gain and the discrepancy
    # that are assumed where the study states none
    half: float


class _Case(NamedTuple):
    """Parameter that is judged: its column, half width [SI], and that where all others are known; by what quantity of
    the bench most of it is, and that quantity's standard deviation; figure in words."""

    column: int
    half: float
    alone: float
    blamed: tuple[str, str] | None
    figure: str


# With a needle spring fixed 20 % wrong, starts agreed and four parameters were pinned to wrong values: the noise, which
# was estimated, had taken the lack of fit. Against a stated one, or that of repeated shots, the residuals are tested.
UNSTATED = "the starts agree only beyond a ripple, and no noise of the curves is stated that the residuals could exceed"


def withdrawal(estimate: Estimate, tests: Sequence[LackOfFit]) -> str:
    """Reason why no parameter may be called pinned; empty if there is none."""
    if not estimate.settled:
        if estimate.starts > 1 and estimate.agreeing < 3:
            return f"the search has not settled: {estimate.agreeing} of {estimate.starts} starts agree"
        return "the search has not settled: a better fit is near"
    found = next((test.sentence for test in tests if test.found), "")
    pairs = zip(estimate.likelihood.blocks, estimate.likelihood.noises, strict=True)
    if not found and estimate.beyond_ripple and not all(noise.known for block, noise in pairs if block.ordered):
        return UNSTATED
    return found


def verdicts_of(
    estimate: Estimate, low: Floats, high: Floats, reason: str, *, limit: float = LIMIT, level: float = 0.95
) -> list[Assessment]:
    """Verdict on each parameter.

    `low`, `high` (d,): ends of the intervals [SI]; `reason`: of `withdrawal`; `limit`: half width over value, up to
    which a parameter is pinned; `level`: of the intervals.
    """
    likelihood = estimate.likelihood
    scale, quantile = np.abs(likelihood.scaled(estimate.unit)), student(estimate.covariance.freedom, level)
    single = quantile * estimate.covariance.alone * scale
    assumed = unstated(estimate)
    moves = np.vstack([np.zeros((1, len(scale))), *(move for _, move in assumed)])
    added = quantile * np.sqrt(np.sum(moves**2, axis=0))
    words = listed([one.text for one, _ in assumed])
    found = []
    for i, value in enumerate(np.abs(estimate.point).tolist()):
        interval = 0.5 * float(high[i] - low[i])
        half = float(np.hypot(interval, added[i]))
        figure = _percent(half, value)
        if assumed:
            apart = f", by noise alone {_percent(interval, value)}" if half > NOTICED * interval else ""
            figure += f"{apart}; {words} assumed"
        case = _Case(i, half, float(single[i]), _blamed(estimate, assumed, i), figure)
        found.append(Assessment(*_words(estimate, case, reason, limit), half))
    return found


def _words(estimate: Estimate, case: _Case, reason: str, limit: float) -> tuple[ParameterVerdict, str, str]:
    """Verdict, its sentence and its cure."""
    likelihood = estimate.likelihood
    parameter, value = likelihood.space.parameters[case.column], float(estimate.point[case.column])
    if parameter.is_at_bound(value):
        cure = "widen the bound if the part allows it, or read the value as something the model lacks"
        return ParameterVerdict.AT_BOUND, f"at a bound ({case.figure} without it)", cure
    if wall := _constraint(estimate, case.column):
        cure = "measure what tells its members apart, or check the constraint"
        return ParameterVerdict.CONSTRAINED, f'held by the constraint "{wall}" ({case.figure})', cure
    verdict = ParameterVerdict.by_width(case.half, case.alone, value, limit)
    if verdict is ParameterVerdict.PINNED:
        if reason:
            more = "search with more starts, or with a shorter time step"
            cure = more if "settled" in reason else "describe the meter, or state a discrepancy"
            cure = "state the noise of the curves (sigma, or repeated shots)" if reason == UNSTATED else cure
            return ParameterVerdict.WITHDRAWN, f"{case.figure}; withdrawn, because {reason}", cure
        return ParameterVerdict.PINNED, f"pinned to {case.figure}", ""
    if case.blamed is not None:
        name, deviation = case.blamed
        cure = f"know the {name} better than to {deviation}, and state it in the noise of the data"
        return ParameterVerdict.COMBINED, f"only in combination with the {name} ({case.figure})", cure
    if verdict is ParameterVerdict.COMBINED:
        others = _partners(estimate, case.column)
        words = f" with {listed(others)}" if others else ""
        cure = "measure at another rail pressure or energising time, or state a prior of one of them"
        return ParameterVerdict.COMBINED, f"only in combination{words} ({case.figure})", cure
    cure = "measure it on the part, or where it acts more; the fitted value means nothing"
    return ParameterVerdict.UNSEEN, f"not seen by these data ({case.figure})", cure


def _percent(half: float, value: float) -> str:
    if not np.isfinite(half):
        return "no interval"
    if half > MOST_TOLD * value > 0.0:
        return f"more than ± {100.0 * MOST_TOLD:g} %"
    return f"± {significant(100.0 * half / value, 2)} %" if value > 0.0 else f"± {significant(half, 2)}"


def _constraint(estimate: Estimate, column: int) -> str:
    """Text of an active constraint that the parameter is part of, empty for none."""
    space = estimate.likelihood.space
    feasible = FeasibleSet.of(space)
    touched = feasible.active(estimate.unit, near=1e-4)[: feasible.constraints]
    for row in np.flatnonzero(touched):
        if feasible.rows[row, column] != 0.0:
            return _row_text(feasible.rows[row], space.names)
    return ""


def _row_text(row: Floats, names: Sequence[str]) -> str:
    """Relation of two parameters, or the names of all in a longer sum."""
    above, below = np.flatnonzero(row > 0.0).tolist(), np.flatnonzero(row < 0.0).tolist()
    if len(above) == len(below) == 1:
        return f"{names[below[0]]} < {names[above[0]]}"
    return f"between {listed([names[i] for i in np.flatnonzero(row).tolist()])}"


def _blamed(estimate: Estimate, assumed: Sequence[tuple[Assumed, Floats]], column: int) -> tuple[str, str] | None:
    """Quantity of the bench that makes most of a parameter's variance, and its standard deviation in words."""
    likelihood, scale = estimate.likelihood, float(estimate.likelihood.scaled(estimate.unit)[column])
    moves = [
        (move[column] ** 2 * scale**2, nuisance.name, quantity(nuisance.deviation, nuisance.unit, 2))
        for nuisance, move in zip(likelihood.nuisances, estimate.covariance.nuisances, strict=True)
    ] + [(float(np.sum(move[:, column] ** 2)), one.owner, one.size) for one, move in assumed]
    total = float(estimate.covariance.total[column, column]) * scale**2
    total += sum(float(np.sum(move[:, column] ** 2)) for _, move in assumed)
    return next(((name, size) for part, name, size in moves if np.isfinite(total) and part > MOSTLY * total), None)


def _partners(estimate: Estimate, column: int) -> list[str]:
    """Parameters that imitate this one best."""
    covariance = estimate.covariance.noise
    variance = np.diag(covariance)
    with np.errstate(invalid="ignore", divide="ignore"):
        related = np.abs(covariance[column] / np.sqrt(variance * variance[column]))
    related = np.where(np.isfinite(related), related, 0.0)
    related[column] = 0.0
    order = np.argsort(-related, kind="stable")[:MOST_NAMED]
    return [estimate.likelihood.names[i] for i in order if related[i] >= NAMED]
