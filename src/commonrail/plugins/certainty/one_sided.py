"""Second moment of the parameters where further quantities, fitted within their statement, are integrated out.

Friction bends the path of the estimates, and ends at zero: the curvature at the most likely values is no measure of how
far they may be off. With the quantities held, the likelihood of the others is nearly normal. They are therefore drawn
from a proposal about their most likely values, the parameters are fitted with each draw, and the fits are weighted by
posterior over proposal (importance sampling, its proposal adapted once). Draws beyond an end are reflected there.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Floats, IndexArray
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.study import Study
from commonrail.plugins.certainty.ascent import Ascent, climb
from commonrail.plugins.certainty.covariance import Covariance, shifts_by
from commonrail.plugins.certainty.estimate import Estimate, estimate
from commonrail.plugins.certainty.lack_of_fit import level_of
from commonrail.plugins.certainty.likelihood import Likelihood, forward_slopes, prior_slopes_at
from commonrail.plugins.certainty.nuisance import one_sided, with_uncertain_free

DRAWS = 32  # of each of two rounds
TURNS, TOLERANCE = 4, 0.05  # of the fit with each draw
WIDER = 1.5  # first proposal over the deviations by the curvature
ADAPTED, KEPT = 2.0, 0.02  # variance of the second one over that of the weighted draws, and share of the first in it
LEAST = 12.0  # draws that the weights must be worth
SEED = 1
_FIRM = 1e-12


class Mixture(NamedTuple):
    """Fits with drawn quantities."""

    moment: Floats  # (d, d), second moment about the most likely values, in positions
    effective: float  # number of draws that the weights are worth
    simulated: int  # points simulated

    @property
    def believed(self) -> bool:
        """True if enough draws have weight."""
        return self.effective >= LEAST


class _Round(NamedTuple):
    """Draws (k, m) with the fitted positions (k, d), their costs (k,) and covariances (k, d, d)."""

    drawn: Floats
    fitted: Floats
    costs: Floats
    covariances: Floats


def mixture_of(whole: Estimate, d: int) -> Mixture:
    """Second moment of the first d parameters, the last ones integrated out within their bounds and priors.

    `whole`: of all parameters.
    """
    likelihood = whole.likelihood.with_noises(whole.likelihood.noises)
    random = np.random.default_rng(SEED)
    local = whole.covariance.inverse[d:, d:] + _FIRM * np.eye(len(whole.unit) - d)
    centre, spread = whole.unit[d:], WIDER**2 * local
    proposals: list[tuple[Floats, Floats]] = []
    rounds: list[_Round] = []
    for _ in range(2):
        proposals.append((centre, spread))
        drawn = _reflected(centre + _even(random, len(centre)) @ np.linalg.cholesky(spread).T)
        rounds.append(_fitted(likelihood, whole, drawn, rounds))
        every = _Round(*(np.concatenate(parts) for parts in zip(*rounds, strict=True)))
        weights = _weights(every, proposals)
        if not weights.any():
            return Mixture(np.zeros((d, d)), 0.0, likelihood.simulated)
        centre = weights @ every.drawn
        off = every.drawn - centre
        spread = ADAPTED * (weights * off.T) @ off + KEPT * local
    away = every.fitted - whole.unit[:d]
    moment = (weights * away.T) @ away + np.einsum("k,kij->ij", weights, every.covariances)
    return Mixture(moment, float(1.0 / np.sum(weights**2)), likelihood.simulated)


def _even(random: np.random.Generator, dimension: int) -> Floats:
    """Normal draws (`DRAWS`, dimension), each coordinate evenly spread (Latin hypercube): few draws know the tails."""
    ranks = np.argsort(random.random((DRAWS, dimension)), axis=0)
    quantiles = special.ndtri((np.arange(DRAWS) + 0.5) / DRAWS)
    return np.asarray(quantiles[ranks])


def _reflected(unit: Floats) -> Floats:
    """Positions within their bounds, reflected at the nearer one."""
    inside = np.abs(unit)
    return np.asarray(np.clip(np.where(inside > 1.0, 2.0 - inside, inside), 0.0, 1.0))


def _weights(every: _Round, proposals: list[tuple[Floats, Floats]]) -> Floats:
    """Shares (k,) of the draws: posterior over the mean of all proposals; zero where no fit has a finite cost."""
    density = np.mean([_density(every.drawn, *proposal) for proposal in proposals], axis=0)
    spread = np.linalg.slogdet(every.covariances)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithms = -0.5 * every.costs + 0.5 * spread - np.log(density)
    sound = np.isfinite(logarithms)
    if not sound.any():
        return np.zeros(len(logarithms))
    logarithms = np.where(sound, logarithms, -np.inf)
    found = np.exp(logarithms - logarithms.max())
    return np.asarray(found / found.sum())


def _density(drawn: Floats, centre: Floats, spread: Floats) -> Floats:
    """Density (k,) of reflected normal draws, without its constant of dimension.

    `drawn` (k, m); `centre` (m,); `spread` (m, m): covariance of the normal distribution.
    """
    inverse, root = np.linalg.inv(spread), np.sqrt(np.linalg.det(spread))
    total = np.zeros(len(drawn))
    for ends in itertools.product((0.0, 1.0, 2.0), repeat=drawn.shape[1]):  # the draw itself, and its two images
        shown = np.where(np.array(ends) == 0.0, drawn, np.where(np.array(ends) == 1.0, -drawn, 2.0 - drawn))
        off = shown - centre
        total += np.exp(-0.5 * np.einsum("ki,ij,kj->k", off, inverse, off)) / root
    return total


def _fitted(likelihood: Likelihood, whole: Estimate, drawn: Floats, rounds: list[_Round]) -> _Round:
    """Fits with draws (k, m), each begun along the tangent from the nearest fit that there is.

    `drawn` (k, m); `rounds`: former ones.
    """
    m = drawn.shape[1]
    d = len(whole.unit) - m
    near_drawn = np.vstack([whole.unit[None, d:], *(one.drawn for one in rounds)])
    near_fitted = np.vstack([whole.unit[None, :d], *(one.fitted for one in rounds)])
    inverse = whole.covariance.inverse
    variance = np.diag(inverse)[d:] + _FIRM
    which = np.argmin(np.sum((drawn[:, None] - near_drawn) ** 2 / variance, axis=2), axis=1)
    wanted = near_fitted[which] + (drawn - near_drawn[which]) @ _follow(
        whole.covariance.inverse, slice(d, None), slice(d)
    )
    anchors = np.column_stack([near_fitted[which], drawn])
    starts = FeasibleSet.of(likelihood.space).within(anchors, np.column_stack([np.clip(wanted, 0.0, 1.0), drawn]))
    starts[:, d:] = drawn
    held = np.tile(np.arange(d, d + m), (len(drawn), 1))
    ends = climb(likelihood, starts, held, turns=TURNS, tolerance=TOLERANCE)
    metric = _metric(likelihood, whole, ends, held)
    blind = ~(np.einsum("kii->ki", metric) > 0.0).all(axis=1)  # derivatives that cannot be simulated are zero
    metric[blind] = np.eye(d)
    beyond = whole.covariance.beyond[:d]
    covariances = np.linalg.inv(metric) * np.outer(beyond, beyond)
    return _Round(drawn, ends.unit[:, :d], np.where(blind, np.inf, _costs(likelihood, whole, ends)), covariances)


def _follow(inverse: Floats, moved: slice, others: slice) -> Floats:
    """Moves of other parameters, columns, with each that is moved, rows, by the inverse of the information (d, d)."""
    return np.asarray(np.linalg.lstsq(inverse[moved, moved], inverse[moved, others], rcond=None)[0])


def _costs(likelihood: Likelihood, whole: Estimate, ends: Ascent) -> Floats:
    """−2 ln L (k,) with each block's cost scaled as its law asks; +inf where a simulation failed."""
    costs = likelihood.block_costs(likelihood.whiten(ends.errors)) @ whole.covariance.ratios
    costs = costs + likelihood.priors.costs(likelihood.space.from_unit(ends.unit))
    return np.where(np.isfinite(costs) & np.isfinite(ends.cost), costs, np.inf)


def _metric(likelihood: Likelihood, whole: Estimate, ends: Ascent, held: IndexArray) -> Floats:
    """Information (k, d, d) on the parameters by data and priors, with the held ones known.

    `held` (k, m).
    """
    d = len(whole.unit) - held.shape[1]
    free = np.arange(len(whole.unit)) < d
    slopes = forward_slopes(likelihood, ends.unit, ends.errors, np.tile(free, (len(held), 1)))[:, :d]
    tangents, innovations = likelihood.whiten(slopes), likelihood.whiten(whole.errors)
    metric = np.zeros((len(slopes), d, d))
    for block, noise, ratio in zip(likelihood.blocks, likelihood.noises, whole.covariance.ratios, strict=True):
        part = tangents[:, :, block.rows]
        metric += ratio * noise.mean_slope(innovations[block.rows]) * part @ part.transpose(0, 2, 1)
    prior_slopes = prior_slopes_at(likelihood, whole.unit)[:, :d]
    metric += prior_slopes.T @ prior_slopes + _FIRM * np.einsum("kii->k", metric)[:, None, None] * np.eye(d)
    return metric


# Most likely values where a quantity is uncertain about an end of what it can be, such as friction about zero.
#
# Such a quantity moves the estimates to one side alone, and along a curved path: without it, a fit ends where a linear
# move by a few standard deviations does not hold the truth. It is therefore fitted too, within what is possible and
# with its standard deviation as a prior. What it is uncertain by then is part of the covariance of the parameters,
# whose derivatives let it follow. All other uncertain quantities stay beside the fit, see `nuisance`.

STARTS_WITHIN = (0.1, 0.8)  # standard deviations of the fitted quantities that the starts begin at, in turn


class Within(NamedTuple):
    """Estimate of a study's parameters, and that with its one-sided uncertain quantities among the parameters."""

    study: Study  # whose last parameters are these quantities; the study itself where there are none
    whole: Estimate  # of that study
    found: Estimate  # of the parameters alone, the other quantities at their most likely values
    fitted: Mapping[str, float]  # most likely values [SI] of these quantities
    # the quantities were integrated out; False where too few draws agree with the data, and the wider of these and the
    # curvature at the most likely values was taken
    integrated: bool = True

    @property
    def level(self) -> float:
        """Level of each test of the fit, where a delay and friction have tests of their own."""
        return level_of(self.whole, True, len(self.whole.unit) - len(self.found.unit))


def estimate_within(study: Study, likelihood: Likelihood, starts: Floats, threads: int | None = None) -> Within:
    """Most likely values from several starts, with all that is uncertain about an end of what it can be fitted too.

    `likelihood`: of the study; `starts` (k, d) or (k, d + m): positions between the bounds; of the parameters, or of
    the fitted quantities too. Raises `SimulationError` if the first start cannot be simulated.
    """
    keys = one_sided(study)
    free = with_uncertain_free(study, keys) if keys else None
    if free is None:
        found = estimate(likelihood, starts, other_tops=True)
        return Within(study, found, found, {})
    wide, d = Likelihood.of(free, threads), likelihood.space.dimension
    if starts.shape[1] == d:
        starts = np.column_stack([starts, _begins(wide, d, len(starts))])
    whole = estimate(wide, starts, other_tops=True)
    fitted = dict(zip(wide.names[d:], _rounded(wide, whole.point)[d:].tolist(), strict=True))
    over = mixture_of(whole, d)
    whole = replace(whole, simulated=whole.simulated + over.simulated)
    return Within(free, whole, _alone(likelihood, whole, over), fitted, over.believed)


def _rounded(wide: Likelihood, point: Floats) -> Floats:
    """Values (d + m,) [SI]; those within 1e-9 of their range from their lower bound are that bound."""
    lower, upper = wide.space.lower, wide.space.upper
    return np.where(point - lower < 1e-9 * (upper - lower), lower, point)


def _begins(wide: Likelihood, d: int, many: int) -> Floats:
    """Positions (many, m) of the last parameters, by turns near the stated value and away from it.

    `d`: number of the parameters before them.
    """
    priors = [parameter.prior for parameter in wide.space.parameters[d:]]
    places = [
        np.append(wide.space.reference[:d], [prior.value + side * prior.sigma for prior in priors if prior is not None])
        for side in STARTS_WITHIN
    ]
    unit = np.clip([wide.space.to_unit(place)[d:] for place in places], 0.0, 1.0)
    return np.asarray(unit[np.arange(many) % len(places)])


def _alone(likelihood: Likelihood, whole: Estimate, over: Mixture) -> Estimate:
    """Estimate of the first parameters; the last ones are held, and follow in the derivatives and the covariance.

    `likelihood`: of the first parameters; `whole`: of all.
    """
    d, last = likelihood.space.dimension, whole.point[likelihood.space.dimension :]
    wide = whole.likelihood

    def residuals(points: Floats) -> Floats:
        return wide.residuals(np.column_stack([points, np.tile(last, (len(points), 1))]))

    alone = wide.with_space(likelihood.space, residuals, [nuisance.at(last) for nuisance in wide.nuisances])
    return replace(
        whole,
        likelihood=alone.with_noises(wide.noises),
        unit=whole.unit[:d],
        point=whole.point[:d],
        slopes=whole.slopes[:d] + _follow(whole.covariance.inverse, slice(d), slice(d, None)) @ whole.slopes[d:],
        covariance=_of_first(whole, over, d),
    )


def _of_first(whole: Estimate, over: Mixture, d: int) -> Covariance:
    """Covariance of the first d parameters, whatever the others are.

    What else is uncertain moves them farther where the last ones are held than where these follow, or the other way
    about; a fit cannot tell which, and the larger move counts.
    """
    known = whole.covariance
    likelihood = whole.likelihood
    inverse = np.asarray(np.linalg.pinv(np.linalg.pinv(known.inverse, hermitian=True)[:d, :d], hermitian=True))
    tangents, innovations = likelihood.whiten(whole.slopes[:d]), likelihood.whiten(whole.errors)
    held = shifts_by(likelihood, inverse, tangents, innovations, likelihood.whiten(whole.shifts))
    follow = known.nuisances[:, :d]
    noise = known.noise[:d, :d]
    seen = np.isfinite(np.diag(noise))  # a parameter without effect has an infinite variance
    if seen.any():
        rows = np.ix_(seen, seen)
        moment, local = over.moment[rows], noise[rows]
        noise = noise.copy()
        excess = float(np.max(np.diag(moment) / np.maximum(np.diag(local), 1e-300)))  # of the variances
        noise[rows] = moment if over.believed else max(1.0, excess) * local
    return known._replace(
        inverse=known.inverse[:d, :d],
        noise=noise,
        nuisances=np.where(np.abs(held) > np.abs(follow), held, follow),
        discrepancy=known.discrepancy[:d, :d],
        shares=known.shares[:, :d],
        freedom=known.freedom[:d],
        alone=known.alone[:d],
        beyond=known.beyond[:d],
    )
