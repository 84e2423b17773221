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
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Floats
from commonrail.base.units import to_text
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Role
from commonrail.data.kinds import of_role
from commonrail.data.noise import Correlation
from commonrail.physics.meters import Meter, is_of_meter, parts_of
from commonrail.plugins.certainty.ascent import Ascent, climb
from commonrail.plugins.certainty.covariance import Covariance, covariance_of, moved_by
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise import Block, agreed, as_normal, fit_noise, unequal
from commonrail.plugins.certainty.nuisance import wider, with_uncertain_free

# Delay of the meter that a study lacks: likelihood-ratio test, and the smallest delay that it would find.
#
# The parameters imitate most of a delay, along a curved path: at the values that a fit without the delay ends at, what
# is left of it points nowhere in particular, and a test of derivatives there has little power. All parameters are
# therefore fitted anew with the delay free, and the noise is estimated from what that fit leaves: with the noise of
# the fit without it, an autoregression takes the delay for noise.
#
# Quantities that a study states as uncertain are fitted in both, with their standard deviations as priors. Of a delay
# that is stated with the deviation s, the test then finds what is beyond: the fall of 2 ln L by a delay δ with the
# standard error σ is δ²/(s² + σ²), the square of a normal variable where the delay is as stated.

DELAY = "delay"
UNNAMED = "unnamed"  # meter of a curve that has none
LARGEST = 50e-6  # delay that is looked for, to both sides [s]
BEGINS = np.array([-4e-6, -2e-6, 0.0, 2e-6, 4e-6])  # delays that the search begins at [s]
HELD = 6  # steps with the delay held
FREED = 2  # of the ends of these, from which the delay is free
ROUNDS = 2  # of noise given residuals, with the delay free
TOLERANCE = 0.05  # of an ascent; a test at 1 % asks for falls of 6.6 and more
POWER = 0.9  # probability with which `visible_delay` is found
# Share of the square of the distance that searches on a rippled likelihood see: two beds of virtual benches, of which
# 81 and 82 % found what 90 % should.
SEEN = 0.82
PARTS = np.array([0.3, 1.0])  # of the linear move by a delay, at which the search for its imitation begins
TRIALS, CLOSE = 4, 0.1  # of the search for the visible delay, and relative distance at which it ends
FIRST = 1e-6  # delay tried first [s]


class MissingDelay(NamedTuple):
    """Test of a delay.

    Attributes
    ----------
    delay : float
        Most likely delay [s] beyond what the study has.
    probability : float
        Probability that noise alone gains as much by a delay.
    point : (d,)
        Parameters [SI] that belong to the delay.
    simulated : int
        Points simulated.
    """

    delay: float
    probability: float
    point: Floats
    simulated: int


def missing_delay(study: Study, estimate: Estimate, threads: int | None = None) -> MissingDelay | None:
    """Likelihood-ratio test of a delay that all curves share, each behind the meter that it has.

    Parameters
    ----------
    study : Study
    estimate : Estimate
        Of its parameters, without the delay.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Returns
    -------
    MissingDelay or None
        None where no data set is a course in time, or a delay is free.
    """
    both = _with_delay(study, estimate, threads)
    if both is None:
        return None
    wide, d = both.wide, len(estimate.unit)
    start, column = np.append(both.unit, 0.5)[None], np.array([len(both.unit)])
    noisy = wide.with_noises(estimate.likelihood.noises)
    free = _freed(noisy, start)
    used = [noisy]
    for _ in range(ROUNDS):
        known, slopes = covariance_at(noisy, free)
        noisy = wide.estimated(free.errors[0], known.used.tolist(), known.root.T @ slopes)
        free = climb(noisy, free.unit, errors=free.errors, slopes=slopes[None], turns=10, tolerance=TOLERANCE)
        used.append(noisy)
    known, _ = covariance_at(noisy, free)
    starts = np.vstack([start, _as_stated(both, free.unit)]) if both.stated else start
    held = _best(climb(noisy, starts, np.repeat(column, len(starts)), tolerance=TOLERANCE))
    point = wide.space.from_unit(free.unit)[0]
    fall = cost_of(noisy, known, held) - cost_of(noisy, known, free)
    freedom = min(noise.freedom for block, noise in zip(noisy.blocks, noisy.noises, strict=True) if block.ordered)
    return MissingDelay(float(point[-1]), _probability(fall, freedom), point[:d], sum(own.simulated for own in used))


def visible_delay(study: Study, estimate: Estimate, level: float, threads: int | None = None) -> tuple[float, int]:
    """Smallest delay [s] that the test finds with the probability `POWER`, and the points simulated; NaN for none.

    The model's own curves at the estimate, with a delay, are the data; what a fit without the delay leaves of it in
    units of the noise is the square of the distance that the test sees.

    Parameters
    ----------
    study : Study
    estimate : Estimate
    level : float
        Of the test.
    threads : int, optional
        As for `missing_delay`.
    """
    both = _with_delay(study, estimate, threads)
    if both is None:
        return float("nan"), 0
    own, wide, unit, d = both.own, both.wide, both.unit, len(estimate.unit)
    point, along = own.space.from_unit(unit), np.zeros(len(unit))
    wanted = float(special.ndtri(1.0 - 0.5 * level) + special.ndtri(POWER)) ** 2 / SEEN
    feasible, delay, simulated = FeasibleSet.of(own.space), FIRST, 0
    for _ in range(TRIALS):
        ends = wide.residuals(np.column_stack([np.tile(point, (2, 1)), [0.0, delay]]))
        shift = ends[1] - ends[0]
        moved = _with_data(own, point, -estimate.errors - shift)
        # linear; the path is curved
        along[:d] = -(estimate.moved(shift[None]) / estimate.likelihood.scaled(estimate.unit))[0]
        starts = feasible.within(np.tile(unit, (len(PARTS), 1)), unit + PARTS[:, None] * along)
        share = float(climb(moved, starts, tolerance=TOLERANCE).cost.min()) / wanted
        simulated += moved.simulated + 2
        if not share > 0.0:
            return float("nan"), simulated
        delay = min(delay / float(np.sqrt(share)), LARGEST)
        if abs(np.sqrt(share) - 1.0) < CLOSE:
            break
    return delay, simulated


class _Both(NamedTuple):
    """Likelihoods without and with the delay.

    Attributes
    ----------
    own : Likelihood
        With the noise of the estimate, its uncertain quantities among its parameters.
    wide : Likelihood
        With a delay of all curves as its last parameter; its noise is not known.
    unit : (d,)
        Position of the estimate among the parameters of the first.
    stated : list of int
        Columns of the delays that the study states as uncertain.
    """

    own: Likelihood
    wide: Likelihood
    unit: Floats
    stated: list[int]


def _with_delay(study: Study, estimate: Estimate, threads: int | None) -> _Both | None:
    """Likelihoods without and with a delay; None if one is free, or no data set is a course in time."""
    own, unit = estimate.likelihood, estimate.unit
    free = {parts_of(name)[1] for name in own.names if is_of_meter(name)}
    if DELAY in free or not any(block.ordered for block in own.blocks):
        return None
    if own.nuisances:
        stated = with_uncertain_free(study)
        if stated is None:
            return None
        study, own = stated, Likelihood.of(stated, threads).with_noises(own.noises)
        unit = np.append(unit, own.space.to_unit(own.space.reference)[len(unit) :])
    fitted = [_behind_a_meter(data) for data in of_role(study.data, Role.FIT)]
    meters = {data.meter.name: data.meter for data in fitted if data.meter is not None and DELAY in data.meter_inputs}
    names = {meter.parameter(DELAY): meter.values.get(DELAY, 0.0) for meter in meters.values()}
    new = {name: present for name, present in names.items() if name not in own.names}
    space = wider(own.space, [_delay(name, present) for name, present in new.items()])
    all_free = Likelihood.of(replace(study, data=tuple(fitted), space=space), threads)
    columns, present = [space.names.index(name) for name in names], np.array(list(new.values()))

    def residuals(points: Floats) -> Floats:
        values = np.column_stack([points[:, :-1], np.tile(present, (len(points), 1))])
        values[:, columns] += points[:, -1:]
        return all_free.residuals(values)

    stated_delays = [own.names.index(name) for name in names if name in own.names]
    return _Both(own, all_free.with_space(wider(own.space, [_delay(DELAY, 0.0)]), residuals), unit, stated_delays)


def _as_stated(both: _Both, unit: Floats) -> Floats:
    """Positions (1, d + 1) with the delay of the test among those that the study states, as far as their bounds go.

    A search from the fitted values need not find them, and what it misses would count for the delay.
    """
    space = both.wide.space
    point = space.from_unit(unit)
    point[:, both.stated] += point[:, -1:]
    point[:, -1] = 0.0
    return np.clip(space.to_unit(point), 0.0, 1.0)


def _behind_a_meter(data: DataSet) -> DataSet:
    """A data set without uncertain quantities; a curve without a meter has a neutral one."""
    plain = data.changed(noise=replace(data.noise, uncertain={}))
    return plain if data.bounds is None or data.meter is not None else plain.changed(meter=Meter(UNNAMED))


def _delay(name: str, present: float) -> Parameter:
    return Parameter(name, present, present - LARGEST, present + LARGEST, "s", mark="E", source="test for lack of fit")


def _with_data(own: Likelihood, point: Floats, shift: Floats) -> Likelihood:
    """The likelihood, with its noise, of data that make the residuals larger by a shift (n,).

    Priors lie about a point (d,) [SI]: a conflict between them and the measured data is none of the simulated ones.
    """
    parameters = [
        parameter if parameter.prior is None else replace(parameter, prior=replace(parameter.prior, value=float(at)))
        for parameter, at in zip(own.space.parameters, point, strict=True)
    ]
    space = Space(parameters, own.space.rows if len(own.space.rows) else (), own.space.products)
    moved = own.with_space(space, lambda points: own.residuals(points) + shift)
    return moved.with_noises(own.noises)


def _freed(noisy: Likelihood, start: Floats) -> Ascent:
    """Best of some ascents with the delay free, from the best of short ones with the delay held at a value of its own.

    Parameters and delay form several maxima, a few microseconds apart. Fewer held steps, or starts that a linear model
    moves ahead, end in the wrong one under correlated noise.
    """
    starts = np.repeat(start, len(BEGINS), axis=0)
    starts[:, -1] += BEGINS / (2.0 * LARGEST)
    column = np.full(len(BEGINS), start.shape[1] - 1)
    held = climb(noisy, starts, column, turns=HELD, tolerance=TOLERANCE)
    near = np.argsort(held.cost, kind="stable")[:FREED]
    near = near[np.isfinite(held.cost[near])]
    return _best(climb(noisy, held.unit[near], errors=held.errors[near], tolerance=TOLERANCE))


def _best(ends: Ascent) -> Ascent:
    best = int(np.argmin(ends.cost))
    return Ascent(*(part[best : best + 1] for part in ends))


def covariance_at(own: Likelihood, at: Ascent) -> tuple[Covariance, Floats]:
    """Covariance and derivatives (d, n) at the end of an ascent."""
    slopes = at.slopes[0]
    if np.isnan(slopes[0, 0]):
        slopes = own.slopes(at.unit, at.errors)[0]
    nothing = np.zeros((0, own.size))
    return covariance_of(own, slopes, at.errors[0], nothing, own.prior_slopes(at.unit[0])), slopes


def cost_of(own: Likelihood, known: Covariance, at: Ascent) -> float:
    """−2 ln L with each block's cost scaled as its law asks."""
    costs = own.block_costs(own.whiten(at.errors[0]))
    return float(known.ratios @ costs + own.priors.costs(own.space.from_unit(at.unit))[0])


def _probability(fall: float, freedom: float) -> float:
    """Probability of a fall of the cost as large as this without a delay: F with one degree of freedom."""
    return 2.0 * float(special.stdtr(min(freedom, 1e9), -math.sqrt(max(fall, 0.0))))


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

    Parameters
    ----------
    block : Block
    errors : (n,)
        Residuals of the block.
    used : float
        Parameters that the block pays for.
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

    Parameters
    ----------
    found : Estimate
    drifting : sequence of str
        Names of the data sets whose residuals drift.
    """
    own = found.likelihood
    blocks = [block for block in own.blocks if block.name in drifting and block.ordered]
    if not blocks:
        return found
    shifts = np.zeros((len(blocks) * (HALF_PERIODS + 1), own.size))
    for i, block in enumerate(blocks):
        courses = drift_courses(block)
        amplitude = _amplitude(found.slopes[:, block.rows], found.errors[block.rows], courses)
        shifts[i * len(courses) : (i + 1) * len(courses), block.rows] = amplitude * courses
    tangents, innovations = own.whiten(found.slopes), own.whiten(found.errors)
    known = found.covariance
    moves = moved_by(own, known.inverse, tangents, innovations, own.whiten(shifts))
    return replace(found, covariance=known._replace(discrepancy=known.discrepancy + moves.T @ moves))


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


# Friction of the guides that a model lacks: likelihood-ratio test by a fit with the friction free.
#
# The parameters imitate most of what friction does to a curve, along a curved path, and the tests of the meter see
# little of the rest. All parameters are therefore fitted anew with the friction free, from zero upwards, as in
# `missing_delay`.
#
# Uncertain quantities are fitted beside it. Friction that a study states as uncertain about zero is no longer missing:
# it is fitted within its statement, see `within`.

# Dry and viscous friction of each guide, and how much is looked for [N], [N s/m]; assumed, six times what is usual.
FRICTION = {"plunger_needle.friction": (30.0, "N"), "plunger_needle.viscous": (12.0, "N s/m")}
FRICTION_STARTS = np.array([[0.1, 0.1], [0.3, 0.05]])  # shares of these that the search begins at
GUIDES = "guides"  # name of the test


class MissingFriction(NamedTuple):
    """Test of friction.

    Attributes
    ----------
    dry, viscous : float
        Most likely friction of each guide [N], [N s/m].
    probability : float
        Largest probability that noise alone gains as much by friction.
    point : (d,)
        Parameters [SI] that belong to it.
    simulated : int
        Points simulated.
    """

    dry: float
    viscous: float
    probability: float
    point: Floats
    simulated: int

    def judged(self, level: float) -> LackOfFit:
        """Test as those of the residuals, at a level."""
        found = self.probability < level
        size = f"{to_text(self.dry, 'N', 2)} and {to_text(self.viscous, 'N s/m', 2)}"
        sentence = f"friction in the guides of about {size}, which the model lacks, explains the curves better"
        return LackOfFit(GUIDES, self.probability, None, "friction", found, sentence if found else "")


def missing_friction(study: Study, estimate: Estimate, threads: int | None = None) -> MissingFriction | None:
    """Likelihood-ratio test of friction in the guides of plunger and needle.

    Parameters
    ----------
    study : Study
    estimate : Estimate
        Of its parameters.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Returns
    -------
    MissingFriction or None
        None where no data set is a course in time, or the model has such friction: fixed, free or stated as uncertain.
    """
    own, unit = estimate.likelihood, estimate.unit
    if not _is_missing(study, own):
        return None
    if own.nuisances:
        free = with_uncertain_free(study)
        if free is None:
            return None
        study, own = free, Likelihood.of(free, threads).with_noises(own.noises)
        unit = np.append(unit, own.space.to_unit(own.space.reference)[len(unit) :])
    more = [
        Parameter(name, 0.0, 0.0, most, symbol, mark="E", source="test for lack of fit")
        for name, (most, symbol) in FRICTION.items()
    ]
    wide = Likelihood.of(replace(study, space=wider(own.space, more)), threads)
    found = _with_friction_free(wide, own, unit)
    if found is None:
        return None
    noisy, at, simulated = found
    before = noisy.simulated
    known, _ = covariance_at(noisy, at)
    without = own.with_noises(noisy.noises)
    held = climb(without, unit[None], errors=estimate.errors[None], tolerance=TOLERANCE)
    fall = max(cost_of(without, known, held) - cost_of(noisy, known, at), 0.0)
    freedom = min(noise.freedom for block, noise in zip(noisy.blocks, noisy.noises, strict=True) if block.ordered)
    point, d = wide.space.from_unit(at.unit)[0], len(estimate.unit)
    simulated += noisy.simulated - before + without.simulated
    dry, viscous = float(point[-2]), float(point[-1])
    return MissingFriction(dry, viscous, _friction_probability(fall, freedom), point[:d], simulated)


def _is_missing(study: Study, own: Likelihood) -> bool:
    """True if the model has no friction, fixed, free or uncertain, and the study curves that it could be seen in."""
    known = {*own.names, *(nuisance.key for nuisance in own.nuisances)}
    none = all(name not in known and study.injector.values.get(name) == 0.0 for name in FRICTION)
    return none and any(block.ordered for block in own.blocks)


def _with_friction_free(wide: Likelihood, own: Likelihood, unit: Floats) -> tuple[Likelihood, Ascent, int] | None:
    """Likelihood with the noise that a fit with friction leaves, the end of that fit, and the points simulated.

    Parameters
    ----------
    wide : Likelihood
        With the friction as its last parameters.
    own : Likelihood
        Without, its noise known.
    unit : (d,)
        Position of the fit without friction.
    """
    noisy = wide.with_noises(own.noises)
    starts = np.column_stack([np.tile(unit, (len(FRICTION_STARTS), 1)), FRICTION_STARTS])
    ends = climb(noisy, starts, tolerance=TOLERANCE)
    if not np.isfinite(ends.cost).any():
        return None
    best, simulated = int(np.argmin(ends.cost)), 0
    at = Ascent(*(part[best : best + 1] for part in ends))
    for _ in range(ROUNDS):
        known, slopes = covariance_at(noisy, at)
        simulated += noisy.simulated
        noisy = wide.estimated(at.errors[0], known.used.tolist(), known.root.T @ slopes)
        at = climb(noisy, at.unit, errors=at.errors, slopes=slopes[None], turns=10, tolerance=TOLERANCE)
    return noisy, at, simulated + noisy.simulated


def _friction_probability(fall: float, freedom: float) -> float:
    """Probability of a fall of the cost as large as this: F with two degrees of freedom.

    Friction is never negative, so that it is at most this.
    """
    if freedom > 1e6:
        return math.exp(-0.5 * fall)
    return float(special.fdtrc(2.0, freedom, 0.5 * fall))
