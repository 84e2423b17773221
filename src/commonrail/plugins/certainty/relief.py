"""Share of the error that one more free value, or a wider bound, would take away, from the derivatives of the fit.

A test says whether a value explains something; the relief says whether freeing it is worth a fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import lsq_linear

from commonrail.base.arrays import Bools, Floats
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import prior_slopes_at

TINY = 1e-12  # least room of a move, which the solver needs


class Relief:
    """Linear refits of an estimate, with the weights of its fit.

    Parameters stay between their bounds. One at a bound stays there, unless its bound or its prior is what is examined.
    """

    def __init__(self, estimate: Estimate) -> None:
        self._estimate, likelihood = estimate, estimate.likelihood
        at = zip(likelihood.space.parameters, estimate.point.tolist(), strict=True)
        self._at_bound = np.array([parameter.is_at_bound(value) for parameter, value in at])
        innovations = likelihood.whiten(estimate.errors)
        self._weights = np.sqrt(likelihood.weights(innovations))
        self._values = np.append(self._weights * innovations, likelihood.prior_residuals(estimate.unit))
        self._slopes = self._whiten(estimate.slopes)
        self._slopes[:, likelihood.size :] = prior_slopes_at(likelihood, estimate.unit).T
        self._ends = -estimate.unit, 1.0 - estimate.unit  # farthest moves of the positions
        self._before = self._refit(self._slopes, estimate.slopes, ~self._at_bound, self._ends)

    def of_values(self, changes: Floats) -> float:
        """Relief by further values, which change the residuals by (k, n)."""
        more = np.ones(len(changes), bool)
        return self._relief(
            np.vstack([self._slopes, self._whiten(changes)]),
            np.vstack([self._estimate.slopes, changes]),
            np.append(~self._at_bound, more),
            tuple(np.append(end, more * sign * np.inf) for end, sign in zip(self._ends, (-1.0, 1.0), strict=True)),
        )

    def of_bounds(self, first: int) -> float:
        """Relief by bounds of the `first` parameters that were met, if they lay a range farther out."""
        met = self._at_bound & (np.arange(len(self._at_bound)) < first)
        if not met.any():
            return 0.0
        is_upper = self._estimate.unit > 0.5
        low, high = np.where(met & ~is_upper, -1.0, self._ends[0]), np.where(met & is_upper, 1.0, self._ends[1])
        return self._relief(self._slopes, self._estimate.slopes, ~self._at_bound | met, (low, high))

    def of_prior(self, column: int) -> float:
        """Relief by a parameter without its prior, whose bounds come from the prior."""
        slopes, moving = self._slopes.copy(), ~self._at_bound
        slopes[column, self._estimate.likelihood.size :], moving[column] = 0.0, True
        low, high = (end.copy() for end in self._ends)
        low[column], high[column] = -np.inf, np.inf
        return self._relief(slopes, self._estimate.slopes, moving, (low, high))

    def _whiten(self, changes: Floats) -> Floats:
        likelihood = self._estimate.likelihood
        whitened = self._weights * likelihood.whiten(changes)
        return np.pad(whitened, ((0, 0), (0, len(self._values) - likelihood.size)))

    def _refit(self, whitened: Floats, changes: Floats, moving: Bools, ends: Sequence[Floats]) -> Floats:
        """Mean squares (blocks,) of the residuals after a linear fit of the moving columns."""
        size = np.linalg.norm(whitened, axis=1)
        used = moving & (size > 0.0)
        moves = np.zeros(len(size))
        if used.any():
            low, high = (np.where(size > 0.0, end * size, end)[used] for end in ends)
            scaled = whitened[used].T / size[used]
            low, high = np.minimum(low, -TINY), np.maximum(high, TINY)
            moves[used] = lsq_linear(scaled, -self._values, (low, high)).x / size[used]
        errors = self._estimate.errors + moves @ changes
        return np.array([np.mean(errors[block.rows] ** 2) for block in self._estimate.likelihood.blocks])

    def _relief(self, whitened: Floats, changes: Floats, moving: Bools, ends: Sequence[Floats]) -> float:
        """One less the root of the mean ratio of mean squares; curves together count as much as maps together."""
        ratios = self._refit(whitened, changes, moving, ends) / np.maximum(self._before, 1e-300)
        is_curve = np.array([block.ordered for block in self._estimate.likelihood.blocks])
        kinds = [ratios[kind].mean() for kind in (is_curve, ~is_curve) if kind.any()]
        return max(0.0, 1.0 - float(np.sqrt(np.mean(kinds))))
