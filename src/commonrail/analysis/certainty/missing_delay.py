"""Delay of the meter that a study lacks: likelihood-ratio test, and the smallest delay that it would find.

The parameters imitate most of a delay, along a curved path: at the values that a fit without the delay ends at, what is
left of it points nowhere in particular, and a test of derivatives there has little power. All parameters are therefore
fitted anew with the delay free, and the noise is estimated from what that fit leaves: with the noise of the fit
without it, an autoregression takes the delay for noise.

Quantities that a study states as uncertain are fitted in both, with their standard deviations as priors. Of a delay
that is stated with the deviation s, the test then finds what is beyond: the fall of 2 ln L by a delay δ with the
standard error σ is δ²/(s² + σ²), the square of a normal variable where the delay is as stated.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.analysis.certainty.ascent import Ascent, climb
from commonrail.analysis.certainty.covariance import Covariance, covariance_of
from commonrail.analysis.certainty.estimate import Estimate
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.uncertain import wider, with_uncertain_free
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.kinds import DataSet, Role, of_role
from commonrail.observation.meter import Meter
from commonrail.observation.quantities import is_of_meter, parts_of

__all__ = ["POWER", "MissingDelay", "cost_of", "covariance_at", "missing_delay", "visible_delay"]


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
    meters = {data.meter.name: data.meter for data in fitted if data.meter is not None and DELAY in data.seen}
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
    plain = data.with_noise(replace(data.noise, uncertain={}))
    return plain if data.bounds is None or data.meter is not None else plain.with_meter(Meter(UNNAMED))


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
