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

from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.base.text import quantity
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.study import Study
from commonrail.data.noise import Correlation
from commonrail.plugins.certainty.estimate import Estimate, estimate
from commonrail.plugins.certainty.likelihood import Likelihood, prior_slopes_at
from commonrail.plugins.certainty.missing import Missing
from commonrail.plugins.certainty.noise_fit import Block, agreed, as_normal, fit_noise, spread, unequal
from commonrail.plugins.certainty.nuisance import with_uncertain_free

# Slow drift of a record: what it explains of the residuals, and what it moves the estimates by.

DRIFT, HALF_PERIODS = "drift", 3  # cosines of half a period to one and a half over the record
LEAST_DRIFTING = 50  # samples, from which the asymptotic distribution is used; chosen


def drift_courses(block: Block) -> Floats:
    """Constant and cosines (1 + `HALF_PERIODS`, n) over the record, in the unit of the residuals."""
    times = block.places[:, 0] - block.places[:, 0].min()
    phase = np.pi * times / max(float(np.ptp(times)), 1e-300)
    return np.asarray(np.cos(np.arange(HALF_PERIODS + 1)[:, None] * phase) * block.offset)


def drift_probability(block: Block, errors: Floats, used: float) -> float:
    """Probability of what a drift explains, its amplitudes and the noise that then remains estimated together.

    Autoregressive noise follows a drift, and its innovations show none: the likelihoods of both are compared, each
    order paying twice (AIC), with the χ² distribution of the four amplitudes.

    `errors` (n,): residuals of the block; `used`: parameters that the block pays for.
    """
    courses = drift_courses(block)
    sampled = errors != 0.0  # exact agreement is no sample
    if np.count_nonzero(sampled) < LEAST_DRIFTING:
        return 1.0
    weights, *_ = np.linalg.lstsq(courses[:, sampled].T, errors[sampled], rcond=None)
    rest = np.where(sampled, errors - weights @ courses, 0.0)
    before, after = fit_noise(block, errors, used), fit_noise(block, rest, used)
    if before.law is not after.law or block.noise.sigma is not None:
        return 1.0
    orders = after.autoregression.order - before.autoregression.order
    fall = 2.0 * np.count_nonzero(sampled) * math.log(before.scale / after.scale) - 2.0 * orders
    return float(special.chdtrc(len(courses), max(fall, 0.0)))


def with_drift(found: Estimate, drifting: Sequence[str]) -> Estimate:
    """The estimate, its covariance with what the drift of data sets moves the parameters by.

    The amplitude is that of the part of the drift that the parameters do not imitate, the noise removed.

    `drifting`: names of the data sets whose residuals drift.
    """
    likelihood = found.likelihood
    blocks = [block for block in likelihood.blocks if block.name in drifting and block.ordered]
    if not blocks:
        return found
    shifts = []
    for block in blocks:
        courses = drift_courses(block)
        amplitude = _amplitude(found.slopes[:, block.rows], found.errors[block.rows], courses)
        shifts.append(spread(block, amplitude * courses, likelihood.size))
    return found.with_errors(found.position_shifts(np.vstack(shifts)))


def _amplitude(slopes: Floats, errors: Floats, courses: Floats) -> float:
    """Root mean square amplitude of courses (k, n) in residuals (n,) whose derivatives (d, n) a fit has followed.

    By the part of the courses that the parameters do not imitate: the squares of its products with the residuals are,
    on average, those of courses of independent amplitudes and of white noise.
    """
    base, _ = np.linalg.qr((slopes / np.maximum(np.abs(slopes).max(axis=1, keepdims=True), 1e-300)).T)
    apart = courses - (courses @ base) @ base.T
    left = np.linalg.lstsq(apart.T, errors, rcond=None)[0] @ apart
    noise = float(np.var(errors - left))
    by_drift = float(np.sum((apart @ errors) ** 2)) - noise * float(np.sum(apart**2))
    return math.sqrt(max(by_drift, 0.0) / max(float(np.sum((apart @ apart.T) ** 2)), 1e-300))


IMITATED = 1e-6  # part of a suspect that the parameters leave unexplained, below which nothing can be said of it
LEVEL = 0.01  # false alarms of all tests of a fit together
DRIFT_COST = 4.0  # its tests are made at a quarter of the level, which leaves the other tests their power; chosen


class LackOfFit(NamedTuple):
    """Tests of one data set."""

    name: str  # data set, `CURVES`, or a quantity that was fitted as stated
    # probability that noise explains as much as delay, bandwidth, gain and offset do, or the delay of all curves
    score: float
    # probability of residuals so large with the stated standard deviation; None where it is estimated
    size: float | None
    suspect: str  # quantity of the meter that by itself explains most
    found: bool  # the residuals are no noise, at a level shared by all tests of the fit
    sentence: str  # what was found, empty for nothing


def lack_of_fit(
    estimate: Estimate,
    delay: Missing | None = None,
    *,
    priors_from: int | None = None,
    level: float | None = None,
) -> list[LackOfFit]:
    """Tests of each data set of a fit, and of a delay, each at a level; that of `level_of` by default.

    All together, with that of friction, raise a false alarm in 1 % of the fits. `delay`: of `missing_delay`; without it
    a delay is tested by its derivative alone. `priors_from`: first of the last parameters, whose priors are what a
    study states as uncertain; none by default.
    """
    likelihood = estimate.likelihood
    level = level_of(estimate, delay is not None) if level is None else level
    held = _stated(estimate, len(estimate.unit) if priors_from is None else priors_from)
    found = [_of_block(estimate, i, level, held) for i in range(len(likelihood.blocks))]
    return [*found, *([] if delay is None else [of_missing(delay, level)])]


def of_missing(missing: Missing, level: float) -> LackOfFit:
    """Test of a quantity that the model lacks, as those of the residuals."""
    found = missing.probability < level
    sentence = f"{missing.words}, explains the curves better" if found else ""
    return LackOfFit(missing.name, missing.probability, None, missing.quantity, found, sentence)


def level_of(estimate: Estimate, delayed: bool, stated: int = 0) -> float:
    """Level of each test of a fit.

    `delayed`: true if a delay and friction have tests of their own; `stated`: quantities that are fitted as stated.
    """
    return LEVEL / (sum(1 + noise.known for noise in estimate.likelihood.noises) + 2 * delayed + stated)


def beyond_stated(estimate: Estimate, first: int, level: float) -> list[LackOfFit]:
    """Tests of the parameters from the column `first` on: is each where a study states it?

    A probability is that of a value as far from the stated one under its normal law, or its half about an end. Data
    that say little leave the value near what is stated, which raises fewer alarms.
    """
    likelihood = estimate.likelihood
    which = likelihood.priors.columns >= first
    distances = likelihood.priors.residuals(likelihood.space.from_unit(estimate.unit[None]))[0][which]
    tests = []
    for column, distance in zip(likelihood.priors.columns[which], np.abs(distances).tolist(), strict=True):
        parameter = likelihood.space.parameters[column]
        probability = math.erfc(distance / math.sqrt(2.0))
        size = quantity(float(estimate.point[column]), parameter.unit, 2)
        words = (
            f"the fit asks for {parameter.name} of about {size}, {distance:.1f} standard deviations from what is stated"
        )
        found = probability < level
        tests.append(LackOfFit(parameter.name, probability, None, parameter.name, found, words if found else ""))
    return tests


class _Held(NamedTuple):
    """Uncertain quantities as a study states them."""

    changes: Floats  # (k, n), whitened changes by those that are no parameters
    distances: Floats  # (m,), distances of all from what is stated, in standard deviations
    slopes: Floats  # (m, d + k), their derivatives


def _stated(estimate: Estimate, first: int) -> _Held:
    """Uncertain quantities, among the parameters from the column `first` on and beside them.

    Each has its standard deviation as a further value, so that a test finds it only where it is larger than stated. A
    quantity of z standard deviations beside the parameters changes the residuals by z times its first change and z²
    times its second one, whose root mean square is √3.
    """
    likelihood, d = estimate.likelihood, len(estimate.unit)
    many = len(estimate.shifts)
    changes = likelihood.whiten(np.vstack([estimate.shifts, estimate.second_changes]))
    widths = np.repeat([1.0, np.sqrt(3.0)], many)
    which = likelihood.priors.columns >= first
    prior_slopes = prior_slopes_at(likelihood, estimate.unit)[which]
    distances = likelihood.priors.residuals(likelihood.space.from_unit(estimate.unit[None]))[0][which]
    beside = np.hstack([np.zeros((2 * many, d)), np.diag(1.0 / widths)])
    among = np.hstack([prior_slopes, np.zeros((len(prior_slopes), 2 * many))])
    return _Held(changes, np.concatenate([np.zeros(2 * many), distances]), np.vstack([beside, among]))


def _of_block(estimate: Estimate, index: int, level: float, held: _Held) -> LackOfFit:
    likelihood = estimate.likelihood
    block, noise = likelihood.blocks[index], likelihood.noises[index]
    errors, slopes = estimate.errors[block.rows], estimate.slopes[:, block.rows]
    innovations = noise.whiten(errors)
    robust = np.sqrt(noise.density.weight(innovations))  # outliers count as they do in the fit
    suspects = meter_changes(block, errors)
    changes = robust * noise.whiten(np.array(list(suspects.values())))
    tangents = robust * np.vstack([noise.whiten(slopes), held.changes[:, block.rows]])
    wide = np.hstack([tangents, held.slopes.T])
    values = np.append(robust * innovations, held.distances)
    score, suspect = _score(values, wide, list(suspects), changes, agreed(errors))
    judged = noise.known and block.shots is None
    free_noise = block.ordered and block.shots is None and block.noise.correlation is not Correlation.WHITE
    used = agreed(errors) + estimate.covariance.used[index]
    size = _size(as_normal(noise.law, innovations), used, noise.freedom) if judged else None
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
    elif noise.power:
        whole = noise.whiten(noise.whole)
        off = abs(float(whole @ innovations)) / float(np.linalg.norm(whole)) / noise.density.deviation
        if 2.0 * special.stdtr(block.noise.scatter_freedom, -off) < level:
            sentence = f"{block.name} is off as a whole by {off:.1f} times what shots and noise scatter by"
    return LackOfFit(block.name, score, size, suspect, bool(sentence), sentence)


def meter_changes(block: Block, errors: Floats) -> dict[str, Floats]:
    """Changes (n,) of the residuals by each quantity of the meter, the model's values being residuals without data."""
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

    `innovations` (n + k,): with the distances of `_Held`; `tangents` (d, n + k): whitened derivatives of the
    parameters, and of what the study states as uncertain; `suspects` (m, n): whitened derivatives of the meter's
    quantities; `exact`: values that are no samples of the noise.
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

    `innovations` (n,): or the magnitudes of normal variables in their place; `used`: parameters that the data set pays
    for, and values that are no samples of the noise; `known`: degrees of freedom of the noise; infinite where it is
    exactly known.
    """
    freedom, squares = max(len(innovations) - used, 1.0), float(np.sum(innovations**2))
    if np.isfinite(known):
        return float(special.betainc(0.5 * known, 0.5 * freedom, known / (known + squares)))
    return float(special.chdtrc(freedom, squares))


# Tests for lack of fit once more, with what a study states as uncertain free within its standard deviation.
#
# A delay of two microseconds bends the path that the parameters imitate it along: what is left of it at the fitted
# values is neither its derivative nor its second one, and a test that knows these two takes it for a fault of the
# model. Where such a test finds something, the uncertain quantities are fitted too, with their standard deviations as
# priors, and the test is made there, and one of each quantity: is it where the study states it?

BEGINS = np.array([0.0, -1.5, 1.5])  # standard deviations of all uncertain quantities that the search begins at


def assess_residuals(
    study: Study,
    found: Estimate,
    delay: Missing | None,
    threads: int | None = None,
    *,
    priors_from: int | None = None,
) -> tuple[list[LackOfFit], int]:
    """Tests for lack of fit of an estimate, and the points simulated for them.

    `found`: of the study; `priors_from`: as for `lack_of_fit`.
    """
    first = len(found.unit) if priors_from is None else priors_from
    level = level_of(found, delay is not None, len(found.unit) - first)
    tests = lack_of_fit(found, delay, priors_from=first, level=level)
    stated = beyond_stated(found, first, level)
    free = with_uncertain_free(study) if found.likelihood.nuisances and any(test.found for test in tests) else None
    if free is None:
        return [*tests, *stated], 0
    wide = Likelihood.of(free, threads)
    try:
        freed = estimate(wide, _starts(wide, found))
    except SimulationError:
        return [*tests, *stated], wide.simulated
    again = lack_of_fit(freed, delay, priors_from=first, level=level)
    merged = [min(pair, key=lambda test: test.found) for pair in zip(tests, again, strict=True)]
    return [*merged, *beyond_stated(freed, first, level)], freed.simulated


def _starts(wide: Likelihood, found: Estimate) -> Floats:
    """Positions (k, d + m): the fitted values, and those that imitate other uncertain quantities in a linear model."""
    d = len(found.unit)
    priors = [parameter.prior for parameter in wide.space.parameters[d:]]
    middle = np.array([prior.value for prior in priors if prior is not None])
    widths = np.array([prior.sigma for prior in priors if prior is not None])
    move = found.covariance.nuisances.sum(axis=0)
    starts = FeasibleSet.of(found.likelihood.space).within(
        np.tile(found.unit, (len(BEGINS), 1)), found.unit + BEGINS[:, None] * move
    )
    points = np.column_stack([found.likelihood.space.from_unit(starts), middle + BEGINS[:, None] * widths])
    return np.clip(wide.space.to_unit(points), 0.0, 1.0)
