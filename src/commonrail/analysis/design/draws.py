"""Draws of the parameters that the data leave open, so that a plan does not depend on one point estimate."""

from __future__ import annotations

import numpy as np

from commonrail.analysis.certainty.estimate import Estimate
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.least_squares import FeasibleSet

__all__ = ["BOUNDED", "laplace_draws", "posterior_draws", "prior_information", "slope_weights"]


# Information on a position that is known to lie between its bounds and no more: a uniform distribution has the
# variance 1/12.
BOUNDED = 12.0


def prior_information(likelihood: Likelihood, unit: Floats) -> Floats:
    """Information (d, d) of priors and bounds on the positions, at a position (d,)."""
    pulls = likelihood.prior_slopes(unit)
    return np.asarray(pulls.T @ pulls + BOUNDED * np.eye(len(unit)))


def slope_weights(estimate: Estimate) -> Floats:
    """Information of an innovation (n,) of each value's law over that of the Gaussian one."""
    own, found = estimate.likelihood, np.ones(estimate.likelihood.size)
    innovations = own.whiten(estimate.errors)
    for block, noise in zip(own.blocks, own.noises, strict=True):
        found[block.rows] = max(float(noise.density.slope(innovations[block.rows]).mean()), 0.05)
    return found


def laplace_draws(estimate: Estimate, many: int, seed: int) -> Floats:
    """Positions (s, d): the most likely ones, then draws of the normal distribution that the curvature there gives.

    Draws beyond bounds and constraints are pulled back to them.

    Parameters
    ----------
    estimate : Estimate
    many : int
    seed : int
    """
    own, unit = estimate.likelihood, estimate.unit
    tangents = own.whiten(estimate.slopes)
    information = (tangents * slope_weights(estimate)) @ tangents.T + prior_information(own, unit)
    moves = estimate.covariance.nuisances
    covariance = np.linalg.inv(information) + np.where(np.isfinite(moves), moves, 0.0).T @ moves
    normal = np.random.default_rng(seed).standard_normal((many - 1, len(unit)))
    drawn = unit + normal @ np.linalg.cholesky(covariance).T
    inside = FeasibleSet.of(own.space).within(np.repeat(unit[None], many - 1, axis=0), drawn)
    return np.vstack([unit, inside])


def posterior_draws(estimate: Estimate, points: Floats, many: int, seed: int) -> Floats:
    """Positions (s, d): the most likely ones, then draws from the posterior, none twice.

    Parameters
    ----------
    estimate : Estimate
    points : (m, d)
        Drawn from the posterior [SI].
    many : int
        Largest number s.
    seed : int
        Of the choice among them.
    """
    chosen = np.random.default_rng(seed).permutation(len(points))[: many - 1]
    return np.vstack([estimate.unit, estimate.likelihood.space.to_unit(points[chosen])])
