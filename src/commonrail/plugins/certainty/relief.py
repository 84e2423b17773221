"""Share of the error that one more free value, or a wider bound, would take away, from the derivatives of the fit.

A test says whether a value explains something; the relief says whether freeing it is worth a fit.
"""

from __future__ import annotations

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import prior_slopes_at


class Relief:
    """Linear refits of an estimate with the weights of its fit, in which parameters at a bound stay there."""

    def __init__(self, estimate: Estimate) -> None:
        self._estimate, likelihood = estimate, estimate.likelihood
        at = zip(likelihood.space.parameters, estimate.point.tolist(), strict=True)
        self._moving = np.array([not parameter.is_at_bound(value) for parameter, value in at])
        innovations = likelihood.whiten(estimate.errors)
        self._weights = np.sqrt(likelihood.weights(innovations))
        self._values = np.append(self._weights * innovations, likelihood.prior_residuals(estimate.unit))
        self._slopes = self._whiten(estimate.slopes)
        self._slopes[:, likelihood.size :] = prior_slopes_at(likelihood, estimate.unit).T
        self._before = self._misfits(self._slopes[self._moving], estimate.slopes[self._moving])

    def of_values(self, changes: Floats) -> float:
        """Relief by further values, which change the residuals by (k, n)."""
        moving = self._moving
        return self._relief(
            np.vstack([self._slopes[moving], self._whiten(changes)]),
            np.vstack([self._estimate.slopes[moving], changes]),
        )

    def of_bounds(self) -> float:
        """Relief by all bounds that were met, if they were wider."""
        return 0.0 if self._moving.all() else self._relief(self._slopes, self._estimate.slopes)

    def of_prior(self, column: int) -> float:
        """Relief by a parameter without its prior."""
        slopes = self._slopes.copy()
        slopes[column, self._estimate.likelihood.size :] = 0.0
        return self._relief(slopes[self._moving], self._estimate.slopes[self._moving])

    def _whiten(self, changes: Floats) -> Floats:
        likelihood = self._estimate.likelihood
        whitened = self._weights * likelihood.whiten(changes)
        return np.pad(whitened, ((0, 0), (0, len(self._values) - likelihood.size)))

    def _misfits(self, whitened: Floats, changes: Floats) -> Floats:
        """Mean squares (blocks,) of the residuals after a linear fit."""
        moves = np.linalg.lstsq(whitened.T, -self._values, rcond=None)[0]
        errors = self._estimate.errors + moves @ changes
        return np.array([np.mean(errors[block.rows] ** 2) for block in self._estimate.likelihood.blocks])

    def _relief(self, whitened: Floats, changes: Floats) -> float:
        """One less the root of the mean ratio of mean squares; curves together count as much as maps together."""
        ratios = self._misfits(whitened, changes) / np.maximum(self._before, 1e-300)
        is_curve = np.array([block.ordered for block in self._estimate.likelihood.blocks])
        kinds = [ratios[kind].mean() for kind in (is_curve, ~is_curve) if kind.any()]
        return max(0.0, 1.0 - float(np.sqrt(np.mean(kinds))))
