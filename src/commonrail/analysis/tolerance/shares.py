"""Share of each dimension in the variance of the quantity, by regression on the parts: no simulation is added.

The quantity is fitted by a sum of cubic polynomials, one of each dimension. The share of a dimension is the covariance
of its polynomial with the quantity over the variance of the quantity (Li et al. 2010): with independent dimensions its
first-order Sobol' index, and with correlated ones too the shares and the rest sum to 1. The rest is interactions, and
steps that a cubic does not follow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.analysis.tolerance.tolerances import Tolerances
from commonrail.arrays import Floats, IndexArray

__all__ = ["DEGREE", "GROUPS", "Shares", "VarianceShares"]


DEGREE = 3  # of a dimension's polynomial
GROUPS = 16  # of parts, each left out in turn for the intervals
WIDE = np.array([0.025, 0.975])  # shares of the parts at which the scaled dimension is -1 and 1


class Shares(NamedTuple):
    """Shares of the variance at one operating point, per dimension.

    Attributes
    ----------
    value, low, high : (d,)
        Share of the variance, and its interval (jackknife over groups of parts).
    rest : float
        Share that is in no dimension alone.
    swing : (d,)
        Quantity at the value below which 97.5 % of the parts lie less that at 2.5 %, all else the same [m³].
    halved : (d,)
        Standard deviation of the quantity if the deviations of this dimension were half as large [m³].
    """

    value: Floats
    low: Floats
    high: Floats
    rest: float
    swing: Floats
    halved: Floats


class _Fit(NamedTuple):
    """Shares, swings and halved standard deviations (d,), and the share of the rest."""

    shares: Floats
    swing: Floats
    halved: Floats
    rest: float


class VarianceShares:
    """Sums from which the shares follow, collected block by block.

    Parameters
    ----------
    tolerances : Tolerances
    centre : (points,)
        Quantity about which sums are taken, so that rounding does not matter [m³].
    """

    def __init__(self, tolerances: Tolerances, centre: Floats) -> None:
        ends = np.stack([dimension.distribution.at(WIDE) for dimension in tolerances.dimensions])
        self._middle, self._reach = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
        self._centre, self._d = centre, len(ends)
        columns = 1 + DEGREE * self._d
        self._products = np.zeros((GROUPS, len(centre), columns, columns))
        self._sums = np.zeros((GROUPS, len(centre), columns))
        self._squares = np.zeros((GROUPS, len(centre)))

    def add(self, group: int, values: Floats, quantities: Floats) -> None:
        """Collect parts; a quantity that is NaN does not count.

        Parameters
        ----------
        group : int
            From 0 to `GROUPS` − 1.
        values : (n, dimensions)
            [SI].
        quantities : (n, points)
            [m³].
        """
        scaled = (values - self._middle) / self._reach
        powers = [np.ones((len(values), 1)), scaled]
        for _ in range(1, DEGREE):
            powers.append(powers[-1] * scaled)
        terms = np.hstack(powers)
        everything = terms.T @ terms
        for k, column in enumerate((quantities - self._centre).T):
            there = np.isfinite(column)
            own, known = (terms, column) if there.all() else (terms[there], column[there])
            self._products[group, k] += everything if len(own) == len(terms) else own.T @ own
            self._sums[group, k] += own.T @ known
            self._squares[group, k] += float(known @ known)

    def shares(self, k: int, confidence: float) -> Shares | None:
        """Shares at operating point k; None where too few parts are there, or the quantity does not scatter.

        Parameters
        ----------
        k : int
        confidence : float
            Probability of the intervals.
        """
        from scipy.special import stdtrit  # slow to import

        sums = [self._products[:, k], self._sums[:, k], self._squares[:, k]]
        whole = self._fit(*(part.sum(axis=0) for part in sums))
        if whole is None:
            return None
        used = [g for g in range(GROUPS) if self._products[g, k, 0, 0] > 0.0]
        others = [self._fit(*(part.sum(axis=0) - part[g] for part in sums)) for g in used]
        found = np.array([other.shares for other in others if other is not None])
        n = len(found)
        if n < 2:
            return None
        spread = np.sqrt((n - 1.0) / n * np.sum((found - found.mean(axis=0)) ** 2, axis=0))
        reach = float(stdtrit(n - 1, 0.5 + 0.5 * confidence)) * spread
        return Shares(whole.shares, whole.shares - reach, whole.shares + reach, whole.rest, whole.swing, whole.halved)

    def _fit(self, products: Floats, sums: Floats, squares: Floats) -> _Fit | None:
        """Least squares from sums."""
        n, d = float(products[0, 0]), self._d
        variance = float(squares) / n - (float(sums[0]) / n) ** 2 if n else 0.0
        if n < 2 * len(sums) or not variance > 0.0:
            return None
        means = products[0, 1:] / n
        covariances = products[1:, 1:] / n - np.outer(means, means)
        with_quantity = sums[1:] / n - means * float(sums[0]) / n
        slopes: Floats = np.asarray(np.linalg.lstsq(covariances, with_quantity, rcond=1e-12)[0], dtype=np.float64)
        by_degree = (slopes * with_quantity).reshape(DEGREE, d).sum(axis=0)
        own = [_quadratic(covariances, slopes, np.arange(j, DEGREE * d, d)) for j in range(d)]
        odd = slopes.reshape(DEGREE, d)[::2].sum(axis=0)
        halved = np.sqrt(np.maximum(variance - by_degree + 0.25 * np.array(own), 0.0))
        shares = by_degree / variance
        return _Fit(shares, 2.0 * odd, halved, float(1.0 - shares.sum()))


def _quadratic(covariances: Floats, slopes: Floats, columns: IndexArray) -> float:
    """Variance of one dimension's polynomial."""
    return float(slopes[columns] @ covariances[np.ix_(columns, columns)] @ slopes[columns])
