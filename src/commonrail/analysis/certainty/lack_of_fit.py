"""Tests for lack of fit: residuals that are no noise, or larger than the noise is known to be.

Score test: the innovations of a data set are regressed on the whitened derivatives of the parameters and of a delay, a
bandwidth, a gain and an offset of the meter; an F test asks if the last explain more than noise does. A slow drift has
tests of its own. Autocorrelation alone cannot tell a meter with coloured noise from a wrong model; this test can. It
does not see what the parameters imitate: it never licenses an interval, see the sensitivity to each uncertain quantity
for that.

A delay, which parameters imitate best, has a test of its own, see `missing_delay`; so has friction of the
guides, see `missing_friction`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.analysis.certainty.block import Block
from commonrail.analysis.certainty.drift import DRIFT, drift_courses, drift_probability
from commonrail.analysis.certainty.estimate import Estimate
from commonrail.analysis.certainty.laws import agreed, as_normal, unequal
from commonrail.analysis.certainty.missing_delay import MissingDelay
from commonrail.arrays import Floats
from commonrail.kinds.noise import Correlation
from commonrail.units import to_text

__all__ = ["LEVEL", "LackOfFit", "beyond_stated", "lack_of_fit", "level_of"]


IMITATED = 1e-6  # part of a suspect that the parameters leave unexplained, below which nothing can be said of it
LEVEL = 0.01  # false alarms of all tests of a fit together
DRIFT_COST = 4.0  # its tests are made at a quarter of the level, which leaves the other tests their power; chosen
CURVES = "all curves"  # name of the test of a delay that they share


class LackOfFit(NamedTuple):
    """Tests of one data set.

    Attributes
    ----------
    name : str
        Data set, `CURVES`, or a quantity that was fitted as stated.
    score : float
        Probability that noise explains as much as delay, bandwidth, gain and offset do, or the delay of all curves.
    size : float or None
        Probability of residuals so large with the stated standard deviation; None where it is estimated.
    suspect : str
        Quantity of the meter that by itself explains most.
    found : bool
        The residuals are no noise, at a level shared by all tests of the fit.
    sentence : str
        What was found, empty for nothing.
    """

    name: str
    score: float
    size: float | None
    suspect: str
    found: bool
    sentence: str


def lack_of_fit(
    estimate: Estimate,
    delay: MissingDelay | None = None,
    *,
    priors_from: int | None = None,
    level: float | None = None,
) -> list[LackOfFit]:
    """Tests of each data set of a fit, and of a delay.

    All together, with that of friction, raise a false alarm in 1 % of the fits.

    Parameters
    ----------
    estimate : Estimate
    delay : MissingDelay, optional
        Of `missing_delay`; without it a delay is tested by its derivative alone.
    priors_from : int, optional
        First of the last parameters, whose priors are what a study states as uncertain; none by default.
    level : float, optional
        Of each test; that of `level_of` by default.
    """
    own = estimate.likelihood
    level = level_of(estimate, delay is not None) if level is None else level
    held = _stated(estimate, len(estimate.unit) if priors_from is None else priors_from)
    found = [_of_block(estimate, i, level, held) for i in range(len(own.blocks))]
    if delay is None:
        return found
    stated = any(nuisance.key == "delay" for nuisance in own.nuisances)
    return [*found, _of_delay(delay, level, "is beyond what the study states" if stated else "the study lacks")]


def level_of(estimate: Estimate, delayed: bool, stated: int = 0) -> float:
    """Level of each test of a fit.

    Parameters
    ----------
    estimate : Estimate
    delayed : bool
        True if a delay and friction have tests of their own.
    stated : int
        Quantities that are fitted as stated.
    """
    return LEVEL / (sum(1 + noise.known for noise in estimate.likelihood.noises) + 2 * delayed + stated)


def beyond_stated(estimate: Estimate, first: int, level: float) -> list[LackOfFit]:
    """Tests of the parameters from the column `first` on: is each where a study states it?

    A probability is that of a value as far from the stated one under its normal law, or its half about an end. Data
    that say little leave the value near what is stated, which raises fewer alarms.
    """
    own = estimate.likelihood
    which = own.priors.columns >= first if len(own.priors) else np.zeros(0, bool)
    pulls = own.priors.residuals(own.space.from_unit(estimate.unit[None]))[0][which]
    tests = []
    for column, pull in zip(own.priors.columns[which] if len(which) else [], np.abs(pulls).tolist(), strict=True):
        parameter = own.space.parameters[column]
        probability = math.erfc(pull / math.sqrt(2.0))
        size = to_text(float(estimate.point[column]), parameter.unit, 2)
        words = f"the fit asks for {parameter.name} of about {size}, {pull:.1f} standard deviations from what is stated"
        found = probability < level
        tests.append(LackOfFit(parameter.name, probability, None, parameter.name, found, words if found else ""))
    return tests


def _of_delay(delay: MissingDelay, level: float, words: str) -> LackOfFit:
    """Test of the delay that all curves share.

    Parameters
    ----------
    delay : MissingDelay
    level : float
    words : str
        What the delay is to the study.
    """
    found = delay.probability < level
    size = to_text(delay.delay, "s", 2)
    sentence = f"a delay of the meter of about {size}, which {words}, explains the curves better"
    return LackOfFit(CURVES, delay.probability, None, "delay", found, sentence if found else "")


class _Held(NamedTuple):
    """Uncertain quantities as a study states them.

    Attributes
    ----------
    changes : (k, n)
        Whitened changes by those that are no parameters.
    distances : (m,)
        Distances of all from what is stated, in standard deviations.
    slopes : (m, d + k)
        Their derivatives.
    """

    changes: Floats
    distances: Floats
    slopes: Floats


def _stated(estimate: Estimate, first: int) -> _Held:
    """Uncertain quantities, among the parameters from the column `first` on and beside them.

    Each has its standard deviation as a further value, so that a test finds it only where it is larger than stated. A
    quantity of z standard deviations beside the parameters changes the residuals by z times its first change and z²
    times its second one, whose root mean square is √3.
    """
    own, d = estimate.likelihood, len(estimate.unit)
    many = len(estimate.shifts)
    changes = own.whiten(np.vstack([estimate.shifts, estimate.bends]))
    widths = np.repeat([1.0, np.sqrt(3.0)], many)
    which = own.priors.columns >= first if len(own.priors) else np.zeros(0, bool)
    pulls = own.prior_slopes(estimate.unit)[which]
    distances = own.priors.residuals(own.space.from_unit(estimate.unit[None]))[0][which]
    beside = np.hstack([np.zeros((2 * many, d)), np.diag(1.0 / widths)])
    among = np.hstack([pulls, np.zeros((len(pulls), 2 * many))])
    return _Held(changes, np.concatenate([np.zeros(2 * many), distances]), np.vstack([beside, among]))


def _of_block(estimate: Estimate, index: int, level: float, held: _Held) -> LackOfFit:
    own = estimate.likelihood
    block, noise = own.blocks[index], own.noises[index]
    errors, slopes = estimate.errors[block.rows], estimate.slopes[:, block.rows]
    innovations = noise.whiten(errors)
    robust = np.sqrt(noise.density.weight(innovations))  # outliers count as they do in the fit
    suspects = _suspects(block, errors)
    changes = robust * noise.whiten(np.array(list(suspects.values())))
    tangents = robust * np.vstack([noise.whiten(slopes), held.changes[:, block.rows]])
    wide = np.hstack([tangents, held.slopes.T])
    values = np.append(robust * innovations, held.distances)
    score, suspect = _score(values, wide, list(suspects), changes, agreed(errors))
    judged = noise.known and block.shots is None
    free_noise = block.ordered and block.shots is None and block.noise.correlation is not Correlation.WHITE
    size = (
        _size(as_normal(noise.law, innovations), agreed(errors) + estimate.covariance.used[index], noise.freedom)
        if judged
        else None
    )
    if block.ordered:
        drifts = robust * noise.whiten(drift_courses(block)[1:])
        drifting, _ = _score(values, wide, [DRIFT] * len(drifts), drifts, agreed(errors))
        if free_noise:
            drifting = min(drifting, drift_probability(block, errors, float(estimate.covariance.used[index])))
        if drifting * DRIFT_COST < min(score, level):
            score, suspect = drifting * DRIFT_COST, DRIFT
    sentence = ""
    if score < level:
        sentence = f"the residuals of {block.name} are no noise: a {suspect} of the meter would explain much of them"
    elif size is not None and size < level:
        ratio = float(np.sqrt(np.mean(unequal(innovations) ** 2))) / noise.density.deviation
        sentence = f"the residuals of {block.name} are {ratio:.2f} times as large as the noise is stated to be"
    return LackOfFit(block.name, score, size, suspect, bool(sentence), sentence)


def _suspects(block: Block, errors: Floats) -> dict[str, Floats]:
    """Changes of the residuals by each quantity of the meter; the model's values are residuals without the data."""
    shown = errors - block.at_zero
    if not block.ordered:
        return {"gain": shown, "offset": block.offset}
    times = block.places[:, 0]
    slope = np.gradient(shown, times)
    return {"delay": -slope, "bandwidth": np.gradient(slope, times), "gain": shown, "offset": block.offset}


def _score(
    innovations: Floats, tangents: Floats, names: Sequence[str], suspects: Floats, exact: int
) -> tuple[float, str]:
    """Probability of the F test, and the name of the suspect that explains most by itself.

    Parameters
    ----------
    innovations : (n + k,)
        With the distances of `_Held`.
    tangents : (d, n + k)
        Whitened derivatives of the parameters, and of what the study states as uncertain.
    names : sequence of str
    suspects : (m, n)
        Whitened derivatives of the meter's quantities.
    exact : int
        Values that are no samples of the noise.
    """
    suspects = np.pad(suspects, ((0, 0), (0, len(innovations) - suspects.shape[1])))
    base = _basis(tangents)
    rest = innovations - base @ (base.T @ innovations)
    apart = suspects - (suspects @ base) @ base.T
    imitated = np.linalg.norm(apart, axis=1) < IMITATED * np.maximum(np.linalg.norm(suspects, axis=1), 1e-300)
    apart, left = apart[~imitated], [name for name, gone in zip(names, imitated, strict=True) if not gone]
    freedom = len(innovations) - exact - base.shape[1] - len(left)
    if not left or freedom < 1:
        return 1.0, ""
    more = _basis(apart)
    explained = float(np.sum((more.T @ rest) ** 2))
    unexplained = max(float(np.sum(rest**2)) - explained, 1e-300)
    share = unexplained / (unexplained + explained)
    alone = np.abs(apart @ rest) / np.linalg.norm(apart, axis=1)
    return float(special.betainc(0.5 * freedom, 0.5 * more.shape[1], share)), left[int(np.argmax(alone))]


def _basis(rows: Floats) -> Floats:
    """Orthonormal columns (n, k) that span rows (m, n)."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    unit = rows[length[:, 0] > 0.0] / length[length[:, 0] > 0.0]
    _, values, vectors = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(vectors[values > 1e-8 * values.max(initial=0.0)].T)


def _size(innovations: Floats, used: float, known: float) -> float:
    """Probability of a sum of squares as large as this by the stated noise.

    Parameters
    ----------
    innovations : (n,)
        Or the magnitudes of normal variables in their place.
    used : float
        Parameters that the data set pays for, and values that are no samples of the noise.
    known : float
        Degrees of freedom of the noise; infinite where it is exactly known.
    """
    freedom, squares = max(len(innovations) - used, 1.0), float(np.sum(innovations**2))
    if np.isfinite(known):
        return float(special.betainc(0.5 * known, 0.5 * freedom, known / (known + squares)))
    return float(special.chdtrc(freedom, squares))
