"""Verdicts on parameters in plain words, from the width of their intervals relative to their values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.text import join_words, quantity, significant
from commonrail.calibration.identifiability import LIMIT, ParameterVerdict
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.plugins.certainty.covariance import student
from commonrail.plugins.certainty.estimate import Estimate

NAMED = 0.5  # correlation from which another parameter is named
MOST_NAMED = 3
MOSTLY = 0.5  # square of the correlation from which an uncertain quantity is blamed
MOST_TOLD = 10.0  # half width over value, above which it is no figure any more


class Assessment(NamedTuple):
    """Verdict on a parameter."""

    verdict: ParameterVerdict
    sentence: str  # verdict with its figure
    cure: str  # measurement or statement that would improve it; empty for a determined parameter
    half: float  # half width of the interval [SI]


def verdicts_of(
    estimate: Estimate,
    d: int,
    interval: tuple[Floats, Floats],
    correlation: Floats,
    reason: str,
    *,
    limit: float = LIMIT,
    level: float = 0.95,
) -> list[Assessment]:
    """Verdict on each of the study's parameters.

    `d`: number of the study's parameters, the first ones; `interval`: ends (d,) [SI]; `correlation` (d + k, d + k): of
    the draws, k quantities of the bench last; `reason`: of `withdrawal`; `limit`: half width over value, up to which a
    parameter is determined; `level`: of the intervals.
    """
    scale = np.abs(estimate.likelihood.scaled(estimate.unit))
    alone = student(estimate.covariance.freedom, level) * estimate.covariance.alone * scale
    halves = 0.5 * (interval[1] - interval[0])
    cases = [_Case(i, d, half, float(alone[i]), correlation[i]) for i, half in enumerate(halves.tolist())]
    return [Assessment(*_words(estimate, case, reason, limit), case.half) for case in cases]


class _Case(NamedTuple):
    """Parameter that is judged: its column, the number of the study's parameters, half widths of its interval [SI] and
    of that where all others are known, and its correlations (d + k,)."""

    column: int
    d: int
    half: float
    alone: float
    correlation: Floats


def _words(estimate: Estimate, case: _Case, reason: str, limit: float) -> tuple[ParameterVerdict, str, str]:
    """Verdict, its sentence and its cure."""
    column = case.column
    parameter, value = estimate.likelihood.space.parameters[column], float(estimate.point[column])
    figure = _percent(case.half, abs(value))
    if parameter.is_at_bound(value):
        cure = "widen the bound if the part allows it, or read the value as something the model lacks"
        return ParameterVerdict.AT_BOUND, f"at a bound ({figure})", cure
    if wall := _constraint(estimate, column):
        cure = "measure what tells its members apart, or check the constraint"
        return ParameterVerdict.CONSTRAINED, f'held by the constraint "{wall}" ({figure})', cure
    verdict = ParameterVerdict.by_width(case.half, case.alone, value, limit)
    if verdict is ParameterVerdict.DETERMINED:
        if reason:
            cure = "search from more starts" if "converged" in reason else "mend what the test shows, then fit again"
            return ParameterVerdict.NOT_CONFIRMED, f"{figure}; not confirmed, because {reason}", cure
        return ParameterVerdict.DETERMINED, f"determined to {figure}", ""
    if blamed := _blamed(estimate, case):
        name, deviation = blamed
        cure = f"know {name} better than to {deviation}, and state it in the noise of the data"
        return ParameterVerdict.COMBINED, f"only in combination with {name} ({figure})", cure
    if verdict is ParameterVerdict.COMBINED:
        others = _partners(estimate, case)
        words = f" with {join_words(others)}" if others else ""
        cure = "measure at another rail pressure or energising time, or state a prior of one of them"
        return ParameterVerdict.COMBINED, f"only in combination{words} ({figure})", cure
    cure = "measure it on the part, or where it acts more; the fitted value means nothing"
    return ParameterVerdict.INSENSITIVE, f"the data are insensitive to it ({figure})", cure


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
    return f"between {join_words([names[i] for i in np.flatnonzero(row).tolist()])}"


def _blamed(estimate: Estimate, case: _Case) -> tuple[str, str] | None:
    """Quantity of the bench that makes most of a parameter's variance, and its standard deviation in words."""
    parameters = estimate.likelihood.space.parameters
    strongest = case.d + int(np.argmax(np.abs(case.correlation[case.d :]))) if case.d < len(parameters) else 0
    prior = parameters[strongest].prior
    if strongest < case.d or case.correlation[strongest] ** 2 <= MOSTLY or prior is None:
        return None
    return parameters[strongest].name, quantity(prior.sigma, parameters[strongest].unit, 2)


def _partners(estimate: Estimate, case: _Case) -> list[str]:
    """Parameters that imitate this one best."""
    related = np.abs(case.correlation)
    related[case.column] = 0.0
    order = np.argsort(-related, kind="stable")[:MOST_NAMED]
    return [estimate.likelihood.names[i] for i in order if related[i] >= NAMED]
