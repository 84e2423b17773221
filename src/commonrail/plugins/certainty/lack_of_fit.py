"""Tests for lack of fit: residuals that are not noise, or are larger than the known noise.

Score test: the innovations of a fit are regressed on the whitened derivatives of its parameters and of suspects; an F
test shows whether the suspects explain more than noise does. Suspects are the quantities of a data set's meter,
together, and each fixed value of the model, separately. Errors that the parameters can imitate stay hidden, so a passed
test does not validate an interval. All tests of a fit together raise a false alarm in 1 % of the fits.
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
from commonrail.plugins.certainty.noise_fit import SHARE_GAIN, Block, as_normal, count_exact, row_weights, samples_of
from commonrail.plugins.certainty.relief import Relief
from commonrail.plugins.certainty.uncertain import ASSUMED

LEVEL = 0.01  # false alarms of all tests of a fit together
IMITATED = 1e-6  # least unexplained part of a suspect; a smaller part cannot be tested
FIXED = "fixed values"  # name of the test of fixed values
BEYOND = "beyond what is stated"  # suspect of the test of an uncertain quantity
DISCREPANCY = "discrepancy"  # suspect of the test for an error of the model


class LackOfFit(NamedTuple):
    """Tests of one data set, of an uncertain quantity, or of all fixed values."""

    name: str  # data set, uncertain quantity, or `FIXED`
    score: float  # probability that noise explains as much as the suspects do
    size: float | None  # probability of residuals so large with the stated deviation; None if it is estimated
    suspect: str  # the suspect that explains most by itself
    detected: Annotated[bool, Key("found")]  # the residuals are not noise, at a level shared by all tests of the fit
    sentence: str  # what the residuals look like; empty if nothing is detected
    relief: float = 0.0  # share of the error that freeing the suspect is expected to take away


def lack_of_fit(estimate: Estimate, first: int, fixed: Mapping[str, Floats] | None = None) -> list[LackOfFit]:
    """Tests of each data set, of each uncertain quantity, of the model's error, and of fixed values.

    `first`: number of the study's own parameters, before the uncertain quantities; `fixed`: result of `fixed_changes`.
    """
    likelihood, relief = estimate.likelihood, Relief(estimate)
    many = sum(1 + noise.stated + bool(noise.scatter) for noise in likelihood.noises) + len(estimate.unit) - first + 1
    level = LEVEL / many
    tests = [_of_block(estimate, i, level, relief) for i in range(len(likelihood.blocks))]
    tests += _beyond_stated(estimate, first, level, relief)
    if share := max(noise.share for noise in likelihood.noises):
        # upper limit of the probability, from the least gain of 2 ln L by chi-squared with one degree of freedom
        size = significant(100.0 * share, 2)
        words = f"the model is off by about {size} % of the values in a way that no free parameter mends"
        tests.append(LackOfFit(DISCREPANCY, float(special.chdtrc(1, SHARE_GAIN)), None, DISCREPANCY, True, words))
    return tests + ([_of_fixed(estimate, fixed, level, relief)] if fixed else [])


def _beyond_stated(estimate: Estimate, first: int, level: float, relief: Relief) -> list[LackOfFit]:
    """Tests of the parameters from the column `first` on: does each agree with its stated or usual value?

    The probability of a value as far from the stated one, by its normal law. Data that say little raise fewer alarms.
    """
    likelihood, tests = estimate.likelihood, []
    distances = np.abs(likelihood.prior_residuals(estimate.unit)).tolist()
    for column, distance in zip(likelihood.priors.columns, distances, strict=True):
        if column < first:
            continue
        parameter, words = likelihood.space.parameters[column], ""
        probability = math.erfc(distance / math.sqrt(2.0))
        if probability < level:
            size = quantity(float(estimate.point[column]), parameter.unit, 2)
            whose = "a bench usually has" if parameter.source == ASSUMED else "is stated"
            words = (
                f"the data look like {parameter.name} of about {size}, {distance:.1f} standard deviations from what "
            )
            words += whose
        gain = relief.of_prior(column) if words else 0.0
        tests.append(LackOfFit(parameter.name, probability, None, BEYOND, bool(words), words, gain))
    return tests


def _of_block(estimate: Estimate, index: int, level: float, relief: Relief) -> LackOfFit:
    """Tests of a data set: quantities of its meter, its size, and its common error."""
    block, noise = estimate.likelihood.pairs[index]
    errors, sentence = estimate.errors[block.rows], ""
    innovations = noise.whiten(errors)
    suspects = meter_changes(block, errors)
    score, suspect, _ = _score(estimate, [block], suspects)
    judged = noise.stated and block.shots is None
    used = count_exact(errors) + estimate.covariance.used[index]
    size = _size(as_normal(noise.law, innovations), used, noise.freedom) if judged else None
    if score < level:
        sentence = f"the residuals of {block.name} are not noise: they look like the meter's {suspect}"
    elif size is not None and size < level:
        ratio = float(np.sqrt(np.mean(samples_of(innovations) ** 2))) / noise.density.deviation
        sentence = f"the residuals of {block.name} are {ratio:.2f} times as large as the noise is stated to be"
    elif noise.scatter:
        common = noise.whiten(noise.scatter * (errors - block.at_zero))  # a standard deviation of all values together
        length = float(np.linalg.norm(common)) * noise.density.deviation
        shift = abs(float(common @ innovations)) / length if length else 0.0
        if 2.0 * special.stdtr(block.noise.scatter_freedom, -shift) < level:
            sentence = f"{block.name} is off as a whole by {shift:.1f} times what shots and noise scatter by"
    gain = 0.0
    if sentence and suspect:
        change = np.zeros((1, estimate.likelihood.size))
        change[0, block.rows] = suspects[suspect]
        gain = relief.of_values(change)
    return LackOfFit(block.name, score, size, suspect, bool(sentence), sentence, gain)


def meter_changes(block: Block, errors: Floats) -> dict[str, Floats]:
    """Changes (n,) of the residuals by each quantity of the meter."""
    shown = errors - block.at_zero
    if not block.ordered:
        return {"gain": shown, "offset": block.offset}
    times = block.places[:, 0]
    slope = np.gradient(shown, times)
    return {"delay": -slope, "bandwidth": np.gradient(slope, times), "gain": shown, "offset": block.offset}


CHANGE = 0.01  # of a value
ZEROS = {"plunger_needle.friction": 1.0, "plunger_needle.viscous": 0.5}  # changes of values that are often zero [SI]
NAMED = 3  # suspects that are named


def fixed_changes(study: Study, estimate: Estimate, threads: int | None = None) -> dict[str, Floats]:
    """Changes (n,) of the residuals by each fixed value whose change can be simulated.

    `study`: result of `with_uncertain_free`.
    """
    injector, space = study.injector, estimate.likelihood.space
    left_out = {*space.names, *COUNTS, *unread_parameters(injector.variant)}
    values = {**injector.values, FUEL_TEMPERATURE: injector.values[FUEL_TEMPERATURE]}
    steps = {name: CHANGE * value if value else ZEROS.get(name, 0.0) for name, value in values.items()}
    steps = {name: step for name, step in steps.items() if step and name not in left_out}
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
    _, suspect, shares = _score(estimate, estimate.likelihood.blocks, fixed)
    if not shares:
        return LackOfFit(FIXED, 1.0, None, "", False, "")
    probability, words = min(1.0, len(shares) * min(shares.values())), ""
    if probability < level:
        order = sorted(shares, key=shares.__getitem__)[:NAMED]
        likely = [name for name in order if shares[name] < 10.0 * shares[order[0]] + 1e-300]
        words = f"the residuals look like another {' or '.join(likely)}, which is fixed"
    gain = relief.of_values(fixed[suspect][None]) if words else 0.0
    return LackOfFit(FIXED, probability, None, suspect, bool(words), words, gain)


def _score(
    estimate: Estimate, blocks: Sequence[Block], suspects: Mapping[str, Floats]
) -> tuple[float, str, dict[str, float]]:
    """Probability of the F test of all suspects, the suspect that explains most, and the probability of each suspect.

    `suspects`: changes of the residuals of neighbouring blocks. Outliers are weighted as in the fit; the priors are
    additional values.
    """
    likelihood, rows = estimate.likelihood, slice(blocks[0].rows.start, blocks[-1].rows.stop)
    innovations = likelihood.whiten(estimate.errors)
    robust = np.sqrt(likelihood.weights(innovations))
    values = np.append((robust * innovations)[rows], likelihood.prior_residuals(estimate.unit))
    slopes = (robust * likelihood.whiten(estimate.slopes))[:, rows]
    base = _basis(np.hstack([slopes, prior_slopes_at(likelihood, estimate.unit).T]))
    changes = np.zeros((len(suspects), likelihood.size))
    changes[:, rows] = list(suspects.values())
    changes = (robust * likelihood.whiten(changes))[:, rows]
    changes = np.pad(changes, ((0, 0), (0, len(values) - changes.shape[1])))
    rest = values - base @ (base.T @ values)
    orthogonal = changes - (changes @ base) @ base.T
    imitated = np.linalg.norm(orthogonal, axis=1) < IMITATED * np.maximum(np.linalg.norm(changes, axis=1), 1e-300)
    orthogonal, names = orthogonal[~imitated], [name for name, gone in zip(suspects, imitated, strict=True) if not gone]
    freedom = len(values) - sum(count_exact(estimate.errors[b.rows]) for b in blocks) - base.shape[1]
    total = float(np.sum(rest**2))
    if not names or freedom - len(names) < 1 or not total > 0.0:
        return 1.0, "", {}
    alone = (orthogonal @ rest) ** 2 / np.sum(orthogonal**2, axis=1)
    shares = np.clip((total - alone) / max(total, 1e-300), 0.0, 1.0)
    single = special.betainc(0.5 * (freedom - 1), 0.5, shares)
    more = _basis(orthogonal)
    explained = min(float(np.sum((more.T @ rest) ** 2)), total)
    share = (total - explained) / max(total, 1e-300)
    together = float(special.betainc(0.5 * (freedom - more.shape[1]), 0.5 * more.shape[1], share))
    return together, names[int(np.argmax(alone))], dict(zip(names, single.tolist(), strict=True))


def _basis(rows: Floats) -> Floats:
    """Orthonormal columns (n, k) that span rows (m, n)."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    unit = rows[length[:, 0] > 0.0] / length[length[:, 0] > 0.0]
    _, values, vectors = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(vectors[values > 1e-8 * values.max(initial=0.0)].T)


def _size(innovations: Floats, used: float, scale_freedom: float) -> float:
    """Probability of a sum of squares as large as that of innovations (n,), by the stated noise.

    `used`: degrees of freedom taken by the fit, plus values that are not samples; `scale_freedom`: of the noise scale.
    """
    freedom, squares = max(len(innovations) - used, 1.0), float(np.sum(innovations**2))
    if np.isfinite(scale_freedom):
        return float(special.betainc(0.5 * scale_freedom, 0.5 * freedom, scale_freedom / (scale_freedom + squares)))
    return float(special.chdtrc(freedom, squares))


def withdrawal(estimate: Estimate, tests: Sequence[LackOfFit], refusal: str = "") -> str:
    """Reason why no parameter is called determined, or empty; `refusal`: reason to reject the draws."""
    if not estimate.settled:
        if estimate.starts > 1 and estimate.agreeing < 2:
            return f"the search has not converged: {estimate.agreeing} of {estimate.starts} starts agree"
        return "the search has not converged: a better fit is near"
    alarms = (t.sentence for t in tests if t.detected and t.suspect != DISCREPANCY)  # intervals include a discrepancy
    return refusal or next(alarms, "")
