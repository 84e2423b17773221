"""Tests for lack of fit: residuals that are not noise, or larger than the noise is known to be.

Score test: the innovations of a fit are regressed on the whitened derivatives of its parameters and of suspects; an F
test asks if the suspects explain more than noise does. Suspects are the quantities of each meter, of a data set alone,
and then each value that the fit leaves fixed, by itself. A test does not see what the parameters imitate: it never
licenses an interval.

All tests of a fit together raise a false alarm in 1 % of the fits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arguments import COUNTS
from commonrail.base.arrays import Floats
from commonrail.base.record import Key
from commonrail.base.text import quantity, significant
from commonrail.calibration.objective import Objective
from commonrail.calibration.study import Study
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.physics.variants import unread_parameters
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import prior_slopes_at
from commonrail.plugins.certainty.noise_fit import SHARE_GAIN, Block, agreed, as_normal, row_weights, unequal
from commonrail.plugins.certainty.relief import Relief
from commonrail.plugins.certainty.uncertain import ASSUMED

LEVEL = 0.01  # false alarms of all tests of a fit together
IMITATED = 1e-6  # part of a suspect that the parameters leave unexplained, below which nothing can be said of it
FIXED = "fixed values"  # name of the test of what the fit leaves fixed
BEYOND = "beyond what is stated"  # suspect of the test of an uncertain quantity
DISCREPANCY = "discrepancy"  # suspect of the test for an error of the model


class LackOfFit(NamedTuple):
    """Tests of one data set, of an uncertain quantity, or of all fixed values."""

    name: str  # data set, uncertain quantity, or `FIXED`
    score: float  # probability that noise explains as much as the suspects do
    # probability of residuals so large with the stated standard deviation; None where it is estimated
    size: float | None
    suspect: str  # the one that by itself explains most
    detected: Annotated[bool, Key("found")]  # the residuals are not noise, at a level shared by all tests of the fit
    sentence: str  # what it looks like, empty for nothing
    relief: float = 0.0  # share of the error that freeing the suspect is expected to take away


def lack_of_fit(estimate: Estimate, first: int, fixed: Mapping[str, Floats] | None = None) -> list[LackOfFit]:
    """Tests of each data set, of each uncertain quantity, of the model's error, and of fixed values.

    `first`: number of the study's own parameters, which those that are uncertain follow; `fixed`: changes (n,) of the
    residuals by each fixed value, see `fixed_changes`.
    """
    likelihood, relief = estimate.likelihood, Relief(estimate)
    many = sum(1 + noise.stated + bool(noise.scatter) for noise in likelihood.noises) + len(estimate.unit) - first + 1
    level = LEVEL / many
    tests = [_of_block(estimate, i, level, relief) for i in range(len(likelihood.blocks))]
    tests += _beyond_stated(estimate, first, level, relief)
    if share := max(noise.share for noise in likelihood.noises):
        # its gain of 2 ln L is at least this: the largest probability by chi-squared of one degree of freedom
        size = significant(100.0 * share, 2)
        words = f"the model is off by about {size} % of the values in a way that no free parameter mends"
        tests.append(LackOfFit(DISCREPANCY, float(special.chdtrc(1, SHARE_GAIN)), None, DISCREPANCY, True, words))
    if fixed:
        tests.append(_of_fixed(estimate, fixed, level, relief))
    return tests


def _beyond_stated(estimate: Estimate, first: int, level: float, relief: Relief) -> list[LackOfFit]:
    """Tests of the parameters from the column `first` on: is each where it is stated, or usually is?

    A probability is that of a value as far from the stated one under its normal law. Data that say little leave the
    value near what is stated, which raises fewer alarms.
    """
    likelihood, tests = estimate.likelihood, []
    distances = likelihood.priors.residuals(likelihood.space.from_unit(estimate.unit[None]))[0]
    for column, distance in zip(likelihood.priors.columns, np.abs(distances).tolist(), strict=True):
        if column < first:
            continue
        parameter = likelihood.space.parameters[column]
        probability = math.erfc(distance / math.sqrt(2.0))
        size = quantity(float(estimate.point[column]), parameter.unit, 2)
        whose = "a bench usually has" if parameter.source == ASSUMED else "is stated"
        words = (
            f"the data look like {parameter.name} of about {size}, {distance:.1f} standard deviations from what {whose}"
        )
        alarm = probability < level
        gain = relief.of_prior(column) if alarm else 0.0
        tests.append(LackOfFit(parameter.name, probability, None, BEYOND, alarm, words if alarm else "", gain))
    return tests


def _of_block(estimate: Estimate, index: int, level: float, relief: Relief) -> LackOfFit:
    """Tests of a data set: quantities of its meter, its size, and what it is off by as a whole."""
    likelihood = estimate.likelihood
    block, noise = likelihood.blocks[index], likelihood.noises[index]
    errors, slopes = estimate.errors[block.rows], estimate.slopes[:, block.rows]
    innovations = noise.whiten(errors)
    robust = np.sqrt(noise.density.weight(innovations))  # outliers count as they do in the fit
    suspects = meter_changes(block, errors)
    pulls = prior_slopes_at(likelihood, estimate.unit)
    distances = likelihood.priors.residuals(likelihood.space.from_unit(estimate.unit[None]))[0]
    values = np.append(robust * innovations, distances)
    tangents = np.hstack([robust * noise.whiten(slopes), pulls.T])
    changes = robust * noise.whiten(np.array(list(suspects.values())))
    score, suspect, _ = _score(values, tangents, list(suspects), changes, agreed(errors))
    judged = noise.stated and block.shots is None
    used = agreed(errors) + estimate.covariance.used[index]
    size = _size(as_normal(noise.law, innovations), used, noise.freedom) if judged else None
    sentence = ""
    if score < level:
        sentence = f"the residuals of {block.name} are not noise: they look like the meter's {suspect}"
    elif size is not None and size < level:
        ratio = float(np.sqrt(np.mean(unequal(innovations) ** 2))) / noise.density.deviation
        sentence = f"the residuals of {block.name} are {ratio:.2f} times as large as the noise is stated to be"
    elif noise.scatter:
        shift = _off_as_a_whole(block, noise.scatter, errors, estimate, index)
        if 2.0 * special.stdtr(block.noise.scatter_freedom, -shift) < level:
            sentence = f"{block.name} is off as a whole by {shift:.1f} times what shots and noise scatter by"
    gain = 0.0
    if sentence and suspect:
        change = np.zeros((1, likelihood.size))
        change[0, block.rows] = suspects[suspect]
        gain = relief.of_values(change)
    return LackOfFit(block.name, score, size, suspect, bool(sentence), sentence, gain)


def _off_as_a_whole(block: Block, scatter: float, errors: Floats, estimate: Estimate, index: int) -> float:
    """Size of what all values of a block are off by together, in standard deviations."""
    noise = estimate.likelihood.noises[index]
    common = noise.whiten(scatter * (errors - block.at_zero))
    size = float(np.linalg.norm(common)) * noise.density.deviation
    return abs(float(common @ noise.whiten(errors))) / size if size else 0.0


def meter_changes(block: Block, errors: Floats) -> dict[str, Floats]:
    """Changes (n,) of the residuals by each quantity of the meter, the model's values being residuals without data."""
    shown = errors - block.at_zero
    if not block.ordered:
        return {"gain": shown, "offset": block.offset}
    times = block.places[:, 0]
    slope = np.gradient(shown, times)
    return {"delay": -slope, "bandwidth": np.gradient(slope, times), "gain": shown, "offset": block.offset}


# Fixed values of the injector, each a suspect by itself.

CHANGE = 0.01  # of a value
ZEROS = {"plunger_needle.friction": 1.0, "plunger_needle.viscous": 0.5}  # changes of what is zero in most models [SI]
NAMED = 3  # suspects that are named


def fixed_changes(study: Study, estimate: Estimate, threads: int | None = None) -> dict[str, Floats]:
    """Changes (n,) of the residuals by each value that the fit leaves fixed, from one batch of simulations.

    `study`: with its uncertain quantities free, see `with_uncertain_free`; one whose change cannot be simulated is
    left out.
    """
    injector, space = study.injector, estimate.likelihood.space
    left_out = {*space.names, *COUNTS, *unread_parameters(injector.variant)}
    steps = {
        name: CHANGE * value if value else ZEROS.get(name, 0.0)
        for name, value in {**injector.values, FUEL_TEMPERATURE: injector.values[FUEL_TEMPERATURE]}.items()
        if name not in left_out
    }
    steps = {name: step for name, step in steps.items() if step}
    names = [*space.names, *steps]
    objective = Objective(injector, names, study.data, study.time_step, threads, same_bits=study.same_bits)
    base = np.append(estimate.point, [injector.values[name] for name in steps])
    points = np.tile(base, (1 + len(steps), 1))
    points[np.arange(1, len(points)), len(space.names) + np.arange(len(steps))] += list(steps.values())
    roots = np.sqrt(np.concatenate([row_weights(data) for data in objective.data]))
    residuals = objective.residuals(points)[:, : len(roots)] / roots
    changes = residuals[1:] - residuals[0]
    return {
        name: change for name, change in zip(steps, changes, strict=True) if np.isfinite(change).all() and change.any()
    }


def _of_fixed(estimate: Estimate, fixed: Mapping[str, Floats], level: float, relief: Relief) -> LackOfFit:
    """Test of fixed values, each by itself: the least probability times their number (Bonferroni)."""
    likelihood = estimate.likelihood
    innovations = likelihood.whiten(estimate.errors)
    robust = np.ones_like(innovations)
    for block, noise in zip(likelihood.blocks, likelihood.noises, strict=True):
        robust[block.rows] = np.sqrt(noise.density.weight(innovations[block.rows]))
    distances = likelihood.priors.residuals(likelihood.space.from_unit(estimate.unit[None]))[0]
    values = np.append(robust * innovations, distances)
    tangents = np.hstack([robust * likelihood.whiten(estimate.slopes), prior_slopes_at(likelihood, estimate.unit).T])
    changes = robust * likelihood.whiten(np.array(list(fixed.values())))
    exact = sum(agreed(estimate.errors[block.rows]) for block in likelihood.blocks)
    _, suspect, shares = _score(values, tangents, list(fixed), changes, exact)
    if not shares:
        return LackOfFit(FIXED, 1.0, None, "", False, "")
    probability = min(1.0, len(shares) * min(shares.values()))
    alarm = probability < level
    order = sorted(shares, key=shares.__getitem__)[:NAMED]
    likely = [name for name in order if shares[name] < 10.0 * shares[order[0]] + 1e-300]
    words = f"the residuals look like another {' or '.join(likely)}, which is fixed" if alarm else ""
    gain = relief.of_values(fixed[suspect][None]) if alarm else 0.0
    return LackOfFit(FIXED, probability, None, suspect, alarm, words, gain)


def _score(
    innovations: Floats, tangents: Floats, names: Sequence[str], suspects: Floats, exact: int
) -> tuple[float, str, dict[str, float]]:
    """Probability of the F test of all suspects, the one that explains most, and the probability of each by itself.

    `innovations` (n + k,): with the distances of the priors; `tangents` (d, n + k): whitened derivatives of the
    parameters; `suspects` (m, n): whitened changes by each; `exact`: values that are no samples of the noise.
    """
    suspects = np.pad(suspects, ((0, 0), (0, len(innovations) - suspects.shape[1])))
    base = _basis(tangents)
    rest = innovations - base @ (base.T @ innovations)
    orthogonal = suspects - (suspects @ base) @ base.T
    imitated = np.linalg.norm(orthogonal, axis=1) < IMITATED * np.maximum(np.linalg.norm(suspects, axis=1), 1e-300)
    orthogonal, left = orthogonal[~imitated], [name for name, gone in zip(names, imitated, strict=True) if not gone]
    freedom = len(innovations) - exact - base.shape[1]
    if not left or freedom - len(left) < 1:
        return 1.0, "", {}
    total = float(np.sum(rest**2))
    if not total > 0.0:
        return 1.0, "", {}
    alone = (orthogonal @ rest) ** 2 / np.sum(orthogonal**2, axis=1)
    shares = np.clip((total - alone) / max(total, 1e-300), 0.0, 1.0)
    single = special.betainc(0.5 * (freedom - 1), 0.5, shares)
    more = _basis(orthogonal)
    explained = min(float(np.sum((more.T @ rest) ** 2)), total)
    share = (total - explained) / max(total, 1e-300)
    together = float(special.betainc(0.5 * (freedom - more.shape[1]), 0.5 * more.shape[1], share))
    return together, left[int(np.argmax(alone))], dict(zip(left, single.tolist(), strict=True))


def _basis(rows: Floats) -> Floats:
    """Orthonormal columns (n, k) that span rows (m, n)."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    unit = rows[length[:, 0] > 0.0] / length[length[:, 0] > 0.0]
    _, values, vectors = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(vectors[values > 1e-8 * values.max(initial=0.0)].T)


def _size(innovations: Floats, used: float, scale_freedom: float) -> float:
    """Probability of a sum of squares as large as this by the stated noise.

    `innovations` (n,): or the magnitudes of normal variables in their place; `used`: parameters that the data set pays
    for, and values that are no samples of the noise; `scale_freedom`: degrees of freedom of the noise; infinite
    where it is exactly known.
    """
    freedom, squares = max(len(innovations) - used, 1.0), float(np.sum(innovations**2))
    if np.isfinite(scale_freedom):
        return float(special.betainc(0.5 * scale_freedom, 0.5 * freedom, scale_freedom / (scale_freedom + squares)))
    return float(special.chdtrc(freedom, squares))


def withdrawal(estimate: Estimate, tests: Sequence[LackOfFit], refusal: str = "") -> str:
    """Reason why no parameter may be called determined; empty if there is none. `refusal`: of the draws."""
    if not estimate.settled:
        if estimate.starts > 1 and estimate.agreeing < 2:
            return f"the search has not converged: {estimate.agreeing} of {estimate.starts} starts agree"
        return "the search has not converged: a better fit is near"
    alarms = (
        test.sentence for test in tests if test.detected and test.suspect != DISCREPANCY
    )  # it is in the intervals
    return refusal or next(alarms, "")
