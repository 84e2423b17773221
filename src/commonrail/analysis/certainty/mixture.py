"""Second moment of the parameters where further quantities, fitted within their statement, are integrated out.

Friction bends the path of the estimates, and ends at zero: the curvature at the most likely values is no measure of how
far they may be off. With the quantities held, the likelihood of the others is nearly normal. They are therefore drawn
from a proposal about their most likely values, the parameters are fitted with each draw, and the fits are weighted by
posterior over proposal (importance sampling, its proposal adapted once). Draws beyond an end are reflected there.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.analysis.certainty.ascent import Ascent, climb
from commonrail.analysis.certainty.estimate import Estimate
from commonrail.analysis.certainty.laws import unequal
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.arrays import Floats, IndexArray
from commonrail.calibration.optimisers.least_squares import FeasibleSet

__all__ = ["Mixture", "mixture_of"]


DRAWS = 32  # of each of two rounds
TURNS, TOLERANCE = 4, 0.05  # of the fit with each draw
WIDER = 1.5  # first proposal over the deviations by the curvature
ADAPTED, KEPT = 2.0, 0.02  # variance of the second one over that of the weighted draws, and share of the first in it
LEAST = 12.0  # draws that the weights must be worth
SEED = 1
_FIRM = 1e-12


class Mixture(NamedTuple):
    """Fits with drawn quantities.

    Attributes
    ----------
    moment : (d, d)
        Second moment about the most likely values, in positions.
    effective : float
        Number of draws that the weights are worth.
    simulated : int
        Points simulated.
    """

    moment: Floats
    effective: float
    simulated: int

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

    Parameters
    ----------
    whole : Estimate
        Of all parameters.
    d : int
    """
    own = whole.likelihood.with_noises(whole.likelihood.noises)
    random = np.random.default_rng(SEED)
    local = whole.covariance.inverse[d:, d:] + _FIRM * np.eye(len(whole.unit) - d)
    centre, spread = whole.unit[d:], WIDER**2 * local
    proposals: list[tuple[Floats, Floats]] = []
    rounds: list[_Round] = []
    for _ in range(2):
        proposals.append((centre, spread))
        drawn = _reflected(centre + _even(random, len(centre)) @ np.linalg.cholesky(spread).T)
        rounds.append(_fitted(own, whole, drawn, rounds))
        every = _Round(*(np.concatenate(parts) for parts in zip(*rounds, strict=True)))
        weights = _weights(every, proposals)
        if not weights.any():
            return Mixture(np.zeros((d, d)), 0.0, own.simulated)
        centre = weights @ every.drawn
        off = every.drawn - centre
        spread = ADAPTED * (weights * off.T) @ off + KEPT * local
    away = every.fitted - whole.unit[:d]
    moment = (weights * away.T) @ away + np.einsum("k,kij->ij", weights, every.covariances)
    return Mixture(moment, float(1.0 / np.sum(weights**2)), own.simulated)


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

    Parameters
    ----------
    drawn : (k, m)
    centre : (m,)
    spread : (m, m)
        Covariance of the normal distribution.
    """
    inverse, root = np.linalg.inv(spread), np.sqrt(np.linalg.det(spread))
    total = np.zeros(len(drawn))
    for ends in itertools.product((0.0, 1.0, 2.0), repeat=drawn.shape[1]):  # the draw itself, and its two images
        shown = np.where(np.array(ends) == 0.0, drawn, np.where(np.array(ends) == 1.0, -drawn, 2.0 - drawn))
        off = shown - centre
        total += np.exp(-0.5 * np.einsum("ki,ij,kj->k", off, inverse, off)) / root
    return total


def _fitted(own: Likelihood, whole: Estimate, drawn: Floats, rounds: list[_Round]) -> _Round:
    """Fits with draws (k, m), each begun along the tangent from the nearest fit that there is.

    Parameters
    ----------
    own : Likelihood
    whole : Estimate
    drawn : (k, m)
    rounds : list of _Round
        Former ones.
    """
    m = drawn.shape[1]
    d = len(whole.unit) - m
    near_drawn = np.vstack([whole.unit[None, d:], *(one.drawn for one in rounds)])
    near_fitted = np.vstack([whole.unit[None, :d], *(one.fitted for one in rounds)])
    variance = np.diag(whole.covariance.inverse)[d:] + _FIRM
    which = np.argmin(np.sum((drawn[:, None] - near_drawn) ** 2 / variance, axis=2), axis=1)
    wanted = near_fitted[which] + (drawn - near_drawn[which]) @ _following(whole, d)
    anchors = np.column_stack([near_fitted[which], drawn])
    starts = FeasibleSet.of(own.space).within(anchors, np.column_stack([np.clip(wanted, 0.0, 1.0), drawn]))
    starts[:, d:] = drawn
    held = np.tile(np.arange(d, d + m), (len(drawn), 1))
    ends = climb(own, starts, held, turns=TURNS, tolerance=TOLERANCE)
    metric = _metric(own, whole, ends, held)
    blind = ~(np.einsum("kii->ki", metric) > 0.0).all(axis=1)  # derivatives that cannot be simulated are zero
    metric[blind] = np.eye(d)
    beyond = whole.covariance.beyond[:d]
    covariances = np.linalg.inv(metric) * np.outer(beyond, beyond)
    return _Round(drawn, ends.unit[:, :d], np.where(blind, np.inf, _costs(own, whole, ends)), covariances)


def _following(whole: Estimate, d: int) -> Floats:
    """Moves (m, d) of the first d parameters with the last ones."""
    inverse = whole.covariance.inverse
    return np.asarray(np.linalg.lstsq(inverse[d:, d:], inverse[d:, :d], rcond=None)[0])


def _costs(own: Likelihood, whole: Estimate, ends: Ascent) -> Floats:
    """−2 ln L (k,) with each block's cost scaled as its law asks; +inf where a simulation failed.

    Parameters
    ----------
    own : Likelihood
    whole : Estimate
    ends : Ascent
    """
    costs = own.block_costs(own.whiten(ends.errors)) @ whole.covariance.ratios
    costs = costs + own.priors.costs(own.space.from_unit(ends.unit))
    return np.where(np.isfinite(costs) & np.isfinite(ends.cost), costs, np.inf)


def _metric(own: Likelihood, whole: Estimate, ends: Ascent, held: IndexArray) -> Floats:
    """Information (k, d, d) on the parameters by data and priors, with the held ones known.

    Parameters
    ----------
    own : Likelihood
    whole : Estimate
    ends : Ascent
    held : (k, m)
    """
    d = len(whole.unit) - held.shape[1]
    free = np.arange(len(whole.unit)) < d
    slopes = own.slopes(ends.unit, ends.errors, np.tile(free, (len(held), 1)))[:, :d]
    tangents, innovations = own.whiten(slopes), own.whiten(whole.errors)
    metric = np.zeros((len(slopes), d, d))
    for block, noise, ratio in zip(own.blocks, own.noises, whole.covariance.ratios, strict=True):
        slope = ratio * max(float(noise.density.slope(unequal(innovations[block.rows])).mean()), 0.05)
        part = tangents[:, :, block.rows]
        metric += slope * part @ part.transpose(0, 2, 1)
    pulls = own.prior_slopes(whole.unit)[:, :d]
    metric += pulls.T @ pulls + _FIRM * np.einsum("kii->k", metric)[:, None, None] * np.eye(d)
    return metric
