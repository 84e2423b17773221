"""Starts of the chains and independent proposals, from a multivariate t distribution about the most likely values."""

from __future__ import annotations

from typing import Any

import numpy as np

from commonrail.analysis.certainty.estimate import Estimate
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.least_squares import FeasibleSet

__all__ = ["Surrogate", "bounded", "local_surrogate"]


FREEDOM = 5.0  # degrees of freedom: tails wider than those of the posterior
WIDEST = 12.0**-0.5  # standard deviation of a position between the bounds of which nothing is known
_LEAST = 1e-10  # eigenvalue over the largest
_STEPS = 30  # of a walk for each parameter: chosen; the starts need no more than to lie apart


class Surrogate:
    """Multivariate t distribution of positions.

    Parameters
    ----------
    centre : (d,)
    covariance : (d, d)
        Of the normal distribution with the same scale.
    """

    def __init__(self, centre: Floats, covariance: Floats) -> None:
        self.centre = centre
        values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
        scale = np.sqrt(np.maximum(values, _LEAST * max(float(values.max(initial=0.0)), 1e-300)))
        self._root, self._inverse = vectors * scale, vectors / scale

    def draw(self, many: int, random: Any, wider: float = 1.0) -> Floats:
        """Positions (many, d).

        Parameters
        ----------
        many : int
        random : numpy.random.RandomState
        wider : float
            Factor of all distances from the centre.
        """
        normal = random.standard_normal((many, len(self.centre)))
        stretched = normal / np.sqrt(random.chisquare(FREEDOM, many) / FREEDOM)[:, None]
        return np.asarray(self.centre + wider * stretched @ self._root.T)

    def spread(self, feasible: FeasibleSet, many: int, random: Any, wider: float = 1.0) -> Floats:
        """Positions (many, d) spread evenly over the part of an ellipsoid that bounds and linear constraints leave.

        By hit-and-run walks (Smith 1984) from a point off the feasible. Where the centre touches an ordering of many
        parameters nearly all draws of the distribution itself break it. The whole ellipsoid, uniformly filled, has the
        covariance of the distribution times the square of `wider`.

        Parameters
        ----------
        feasible : FeasibleSet
        many : int
        random : numpy.random.RandomState
        wider : float
            Factor of all distances from the centre.
        """
        d = len(self.centre)
        radius = wider * np.sqrt(d + 2.0)  # a ball's variance along an axis is radius²/(d + 2)
        inward = (feasible.space.to_unit(feasible.space.centre) - self.centre) @ self._inverse
        inward *= min(0.5, 0.5 * radius / max(float(np.linalg.norm(inward)), 1e-300))
        ball, rows = np.tile(inward, (many, 1)), feasible.rows @ self._root
        floor = feasible.floor - feasible.rows @ self.centre
        for _ in range(_STEPS * d):
            along = random.standard_normal((many, d))
            along /= np.linalg.norm(along, axis=1)[:, None]
            first, last = _chord(ball, along, radius)
            reach, rate = np.minimum(floor - ball @ rows.T, 0.0), along @ rows.T
            with np.errstate(divide="ignore", invalid="ignore"):
                steps = reach / rate
            first = np.maximum(first, np.where(rate > 0.0, steps, -np.inf).max(axis=1))
            last = np.minimum(last, np.where(rate < 0.0, steps, np.inf).min(axis=1))
            ball += (first + (last - first) * random.random_sample(many))[:, None] * along
        return np.asarray(self.centre + ball @ self._root.T)

    def log_density(self, unit: Floats) -> Floats:
        """Logarithm (m,) without its constant."""
        squares = np.sum(((unit - self.centre) @ self._inverse) ** 2, axis=1)
        return np.asarray(-0.5 * (FREEDOM + len(self.centre)) * np.log1p(squares / FREEDOM))

    def propose(self, coords: Floats, random: Any) -> tuple[Floats, Floats]:
        """Proposals that do not depend on the walkers' places, and logarithms of the ratios of their densities."""
        proposed = self.draw(len(coords), random)
        return proposed, self.log_density(coords) - self.log_density(proposed)


def _chord(points: Floats, along: Floats, radius: float) -> tuple[Floats, Floats]:
    """Steps (n,), (n,) to both ends of the chord of a ball through points (n, d) along unit directions (n, d)."""
    middle = -np.sum(points * along, axis=1)
    half = np.sqrt(np.maximum(middle**2 + radius**2 - np.sum(points**2, axis=1), 0.0))
    return middle - half, middle + half


def local_surrogate(estimate: Estimate) -> Surrogate:
    """Distribution of the linear approximation, no wider than the bounds."""
    return Surrogate(estimate.unit, bounded(estimate))


def bounded(estimate: Estimate) -> Floats:
    """Covariance (d, d) of the positions, of which none is known worse than to lie between the bounds."""
    total = np.array(estimate.covariance.total)
    loose = ~np.isfinite(np.diag(total))
    total[loose, :] = total[:, loose] = 0.0
    total[loose, loose] = WIDEST**2
    shrink = np.minimum(1.0, WIDEST / np.sqrt(np.maximum(np.diag(total), 1e-300)))
    return np.asarray(total * np.outer(shrink, shrink))
