"""Derivatives over the width of the intervals: differences between points three standard errors to both sides.

A likelihood ripples where timing moves samples on steep flanks, the more so where correlated noise is whitened: within
a fraction of a standard error its slope differs from that over the whole interval. Derivatives at a point then state
errors that are too small. Differences along the principal axes of the covariance, as long as the interval itself,
average the ripple; they and the covariance that follows from them are repeated until both agree.
"""

from __future__ import annotations

import numpy as np

from commonrail.analysis.certainty.covariance import Covariance
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.least_squares import FeasibleSet

__all__ = ["secant_slopes", "wider"]


REACH = 3.0  # standard errors; chosen, beyond the two at which an interval of 95 % ends
LONGEST = 0.1  # of the range of a parameter: beyond it curvature counts, which the ripple is not
SHORTEST = 0.1  # of the reach, below which bounds and constraints leave no difference to be taken


def secant_slopes(own: Likelihood, unit: Floats, errors: Floats, slopes: Floats, covariance: Covariance) -> Floats:
    """Derivatives (d, n) of the residuals with respect to the positions, from differences along the principal axes.

    2 d points are simulated in one batch, within the bounds and straight constraints (see `FeasibleSet`). Along an axis
    that these close, or where a simulation fails, the given derivatives stay; so do those of parameters that nothing
    holds.

    Parameters
    ----------
    own : Likelihood
        With its noise.
    unit : (d,)
        Position between the bounds.
    errors : (n,)
        Residuals there.
    slopes : (d, n)
        Derivatives at the point.
    covariance : Covariance
        By noise.
    """
    held = np.isfinite(np.diag(covariance.noise))
    values, vectors = np.linalg.eigh(covariance.noise[np.ix_(held, held)])
    good = values > 0.0
    if not good.all() or not held.any():
        return slopes
    axes = np.zeros((len(values), len(unit)))
    axes[:, held] = (vectors * np.sqrt(values)).T
    reach = np.minimum(REACH, LONGEST / np.maximum(np.abs(axes).max(axis=1), 1e-300))
    feasible = FeasibleSet.of(own.space)
    ahead, behind = (np.minimum(reach, _distance(feasible, unit, sign * axes)) for sign in (1.0, -1.0))
    points = np.concatenate([unit + ahead[:, None] * axes, unit - behind[:, None] * axes])
    found = own.residuals(own.space.from_unit(np.clip(points, 0.0, 1.0)))  # cuts rounding only
    difference = found[: len(axes)] - found[len(axes) :]
    local = axes @ slopes
    usable = (ahead + behind > SHORTEST * reach) & np.isfinite(difference).all(axis=1)
    length = np.where(usable, ahead + behind, 1.0)
    along = np.where(usable[:, None], difference / length[:, None], local)
    result = slopes.copy()
    result[held] = np.linalg.solve(axes[:, held], along - axes[:, ~held] @ slopes[~held])
    return result


def _distance(feasible: FeasibleSet, unit: Floats, axes: Floats) -> Floats:
    """Farthest multiples (k,) of axes (k, d) that bounds and constraints allow from a position (d,)."""
    rates = axes @ feasible.rows.T
    left = np.maximum(feasible.rows @ unit - feasible.floor, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(rates < 0.0, left / -rates, np.inf).min(axis=1))


def wider(found: Covariance, local: Covariance) -> Covariance:
    """The covariance by differences, no parameter's error smaller than by the derivatives at the point.

    Parameters
    ----------
    found : Covariance
        By differences over the interval.
    local : Covariance
        By derivatives at the point.
    """
    both = np.isfinite(np.diag(found.noise)) & np.isfinite(np.diag(local.noise))
    variances = np.where(both, np.diag(found.noise), 1.0)
    scale = np.sqrt(np.maximum(np.where(both, np.diag(local.noise), 1.0) / np.maximum(variances, 1e-300), 1.0))
    return found._replace(noise=found.noise * np.outer(scale, scale))
