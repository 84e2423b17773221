"""Verdicts on parameters in plain words, from the width of their intervals relative to their values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Floats
from commonrail.base.text import join_words, quantity, significant
from commonrail.calibration.identifiability import LIMIT, ParameterVerdict
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.parameter import Parameter
from commonrail.plugins.certainty.covariance import student
from commonrail.plugins.certainty.estimate import Estimate

NAMED = 0.5  # least correlation for another parameter to be named
MOST_NAMED = 3
MOSTLY = 0.5  # least squared correlation for an uncertain quantity to be named as cause
LEAST_NARROWED = 0.8  # half width over that known before, from which the data are not said to determine a value
MOST_TOLD = 10.0  # largest half width over value that is given as a figure


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
    """Verdict on each of the study's d parameters, which come first.

    `interval`: ends (d,) [SI]; `correlation` (d + k, d + k): correlation of the draws, with k quantities of the bench
    last; `reason`: result of `withdrawal`; `limit`: largest half width over value of a determined parameter; `level`:
    confidence level of the intervals.
    """
    scale = np.abs(estimate.likelihood.scaled(estimate.unit))
    alone = student(estimate.covariance.freedom, level) * estimate.covariance.alone * scale
    assessments = []
    for i, half in enumerate((0.5 * (interval[1] - interval[0])).tolist()):
        parameter, value = estimate.likelihood.space.parameters[i], float(estimate.point[i])
        figure, verdict = _percent(half, abs(value)), ParameterVerdict.by_width(half, float(alone[i]), value, limit)
        if parameter.is_at_bound(value):
            verdict, sentence = ParameterVerdict.AT_BOUND, f"at a bound ({figure})"
            cure = "widen the bound if the part allows it, or read the value as something the model lacks"
        elif wall := _constraint(estimate, i):
            verdict, sentence = ParameterVerdict.CONSTRAINED, f'held by the constraint "{wall}" ({figure})'
            cure = "measure where these parameters act differently, or check the constraint"
        elif verdict is ParameterVerdict.DETERMINED and (source := _known_before(parameter, half, level)):
            verdict = ParameterVerdict.INSENSITIVE
            sentence = f"the data are insensitive to it: the interval is that of its {source} ({figure})"
            cure = "measure where it acts more, if it matters to know it better"
        elif verdict is ParameterVerdict.DETERMINED and reason:
            verdict, sentence = ParameterVerdict.NOT_CONFIRMED, f"{figure}; not confirmed, because {reason}"
            cure = "search from more starts" if "converged" in reason else "mend what the test shows, then fit again"
        elif verdict is ParameterVerdict.DETERMINED:
            sentence, cure = f"determined to {figure}", ""
        elif blamed := _blamed(estimate, d, correlation[i]):
            verdict, sentence = ParameterVerdict.COMBINED, f"only in combination with {blamed[0]} ({figure})"
            cure = f"measure {blamed[0]} to better than {blamed[1]}, and state it in the noise of the data"
        elif verdict is ParameterVerdict.COMBINED:
            others = _partners(estimate, i, correlation[i])
            sentence = f"only in combination{f' with {join_words(others)}' if others else ''} ({figure})"
            cure = "measure at another rail pressure or energising time, or state a prior of one of them"
        else:
            sentence = f"the data are insensitive to it ({figure})"
            cure = "measure it on the part, or at points where it has more effect; the fitted value has no meaning"
        assessments.append(Assessment(verdict, sentence, cure, half))
    return assessments


def _known_before(parameter: Parameter, half: float, level: float) -> str:
    """Source of an interval that the data do not narrow: "prior" or "bounds"; empty if they do."""
    sizes = {"bounds": 0.5 * level * (parameter.upper - parameter.lower)}
    if parameter.prior is not None:
        sizes["prior"] = float(special.ndtri(0.5 * (1.0 + level))) * parameter.prior.sigma
    source = min(sizes, key=sizes.__getitem__)
    return source if half > LEAST_NARROWED * sizes[source] else ""


def _percent(half: float, value: float) -> str:
    if not np.isfinite(half):
        return "no interval"
    if half > MOST_TOLD * value > 0.0:
        return f"more than ± {100.0 * MOST_TOLD:g} %"
    return f"± {significant(100.0 * half / value, 2)} %" if value > 0.0 else f"± {significant(half, 2)}"


def _constraint(estimate: Estimate, column: int) -> str:
    """Active constraint of the parameter: relation of two parameters, or names in a longer sum; empty if inactive."""
    names, feasible = estimate.likelihood.names, FeasibleSet.of(estimate.likelihood.space)
    for i in np.flatnonzero(feasible.active(estimate.unit, near=1e-4)[: feasible.constraints]):
        row = feasible.rows[i]
        if row[column] != 0.0:
            above, below = np.flatnonzero(row > 0.0).tolist(), np.flatnonzero(row < 0.0).tolist()
            if len(above) == len(below) == 1:
                return f"{names[below[0]]} < {names[above[0]]}"
            return f"between {join_words([names[i] for i in np.flatnonzero(row).tolist()])}"
    return ""


def _blamed(estimate: Estimate, d: int, correlation: Floats) -> tuple[str, str] | None:
    """Quantity of the bench that causes most of a parameter's variance, and its standard deviation as text."""
    if d == len(correlation):
        return None
    strongest = d + int(np.argmax(np.abs(correlation[d:])))
    parameter = estimate.likelihood.space.parameters[strongest]
    if correlation[strongest] ** 2 <= MOSTLY or parameter.prior is None:
        return None
    return parameter.name, quantity(parameter.prior.sigma, parameter.unit, 2)


def _partners(estimate: Estimate, column: int, correlation: Floats) -> list[str]:
    """Parameters that imitate this one best."""
    related = np.abs(correlation)
    related[column] = 0.0
    order = np.argsort(-related, kind="stable")[:MOST_NAMED]
    return [estimate.likelihood.names[i] for i in order if related[i] >= NAMED]
