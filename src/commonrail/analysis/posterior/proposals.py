"""Starts of the chains and independent proposals, from a multivariate t distribution about the most likely values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.certainty.estimate import Estimate

__all__ = ["Surrogate", "bounded", "local_surrogate"]

Floats = NDArray[np.float64]

FREEDOM = 5.0  # degrees of freedom: tails wider than those of the posterior
WIDEST = 12.0**-0.5  # standard deviation of a position between the bounds of which nothing is known
_LEAST = 1e-10  # eigenvalue over the largest


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

    def log_density(self, unit: Floats) -> Floats:
        """Logarithm (m,) without its constant."""
        squares = np.sum(((unit - self.centre) @ self._inverse) ** 2, axis=1)
        return np.asarray(-0.5 * (FREEDOM + len(self.centre)) * np.log1p(squares / FREEDOM))

    def propose(self, coords: Floats, random: Any) -> tuple[Floats, Floats]:
        """Proposals that do not depend on the walkers' places, and logarithms of the ratios of their densities."""
        proposed = self.draw(len(coords), random)
        return proposed, self.log_density(coords) - self.log_density(proposed)


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
