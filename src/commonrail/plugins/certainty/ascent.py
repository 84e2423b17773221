"""Ascent to the most likely values by damped least squares of the innovations, from many starts in one batch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.stages import tell
from commonrail.calibration.optimisers.least_squares import Descents, FeasibleSet, Model, Rules, advance, answered
from commonrail.plugins.certainty.covariance import Covariance, covariance_of
from commonrail.plugins.certainty.likelihood import Likelihood, forward_slopes, prior_slopes_at, weights_of

FACTORS = (0.03, 1.0, 30.0)  # dampings tried side by side, times the current one
FEW = 5  # free parameters, up to which steps are straight: bending them saves no step and costs a third of the points


class Ascent(NamedTuple):
    """Ends of ascents."""

    unit: Floats  # (k, d), positions between the bounds
    cost: Floats  # (k,), −2 ln of likelihood and priors, without constants; +inf where the start failed
    errors: Floats  # (k, n), residuals there
    # (k, d, n), one-sided derivatives there; NaN of an ascent that does not know them, zero for a fixed parameter
    slopes: Floats

    @property
    def best(self) -> Ascent:
        """The one that ends highest."""
        best = int(np.argmin(self.cost))
        return Ascent(*(row[best : best + 1] for row in self))


class _Criterion(NamedTuple):
    """−2 ln of likelihood and priors, as damped least squares lowers it; innovations end with those of the priors."""

    likelihood: Likelihood

    def innovations(self, residuals: Floats, unit: Floats) -> Floats:
        likelihood = self.likelihood
        complete = np.isfinite(residuals).all(axis=-1, keepdims=True)
        data = np.where(complete, likelihood.whiten(np.where(complete, residuals, 0.0)), np.nan)
        priors = likelihood.priors.residuals(likelihood.space.from_unit(unit.reshape(-1, unit.shape[-1])))
        return np.concatenate([data, priors.reshape(*unit.shape[:-1], -1)], axis=-1)

    def tangents(self, slopes: Floats, unit: Floats) -> Floats:
        likelihood = self.likelihood
        priors = [prior_slopes_at(likelihood, point).T for point in unit]
        return np.concatenate([likelihood.whiten(slopes), np.array(priors).reshape(*unit.shape, -1)], axis=2)

    def costs(self, innovations: Floats) -> Floats:
        likelihood, n = self.likelihood, self.likelihood.size
        cost = likelihood.block_costs(innovations[..., :n]).sum(axis=-1) + np.sum(innovations[..., n:] ** 2, axis=-1)
        return np.where(np.isfinite(cost), cost, np.inf)

    def weights(self, innovations: Floats) -> Floats:
        weights = np.ones_like(innovations)
        n = self.likelihood.size
        weights[:, :n] = weights_of(self.likelihood, innovations[:, :n])
        return weights

    def curvature(self, innovations: Floats) -> Floats:
        return np.ones(len(innovations))


def climb(
    likelihood: Likelihood,
    unit: Floats,
    fixed: IndexArray | None = None,
    *,
    errors: Floats | None = None,
    slopes: Floats | None = None,
    turns: int = 25,
    tolerance: float = 1e-2,
) -> Ascent:
    """Ascend from positions to the most likely values that each leads to.

    `likelihood`: with its noise; `unit` (k, d): positions between the bounds, within the constraints; `fixed` (k,) or
    (k, h): parameters that each ascent leaves where they are; `errors` (k, n): residuals at the positions, if they are
    known; `slopes` (k, d, n): their one-sided derivatives, as those of `Ascent`; `turns`: largest number of steps;
    `tolerance`: fall of −2 ln L that counts as none: where the linear model promises no more, or two steps in a row
    bring no more, an ascent ends.
    """
    if errors is None:
        errors = likelihood.residuals(likelihood.space.from_unit(unit))
    free = np.ones(unit.shape, bool)
    if fixed is not None:
        free[np.arange(len(unit))[:, None], fixed.reshape(len(unit), -1)] = False
    bent = bool(free.sum(axis=1).max(initial=0) > FEW)
    criterion, rules = _Criterion(likelihood), Rules(likelihood.forward, tolerance, FACTORS, bent, free)
    ends = Descents.begin(unit, errors, slopes)
    for turn in range(turns):
        if not ends.running.any():
            break
        tell("search", turn, turns, f"{ends.running.sum()} of {len(unit)} ascents go on")
        ends = answered(advance(likelihood.space, ends, criterion, rules), likelihood.residuals)
    cost = criterion.costs(criterion.innovations(ends.residuals, ends.unit))
    return Ascent(ends.unit, cost, ends.residuals, ends.slopes)


def linearised(likelihood: Likelihood, unit: Floats, slopes: Floats, errors: Floats) -> Model:
    """Quadratic model of −2 ln of likelihood and priors about a position (d,), by slopes (d, n) and errors (n,)."""
    now = Descents.begin(unit[None], errors[None], slopes[None])
    return Model.of(FeasibleSet.of(likelihood.space), _Criterion(likelihood), now)


def covariance_at(likelihood: Likelihood, end: Ascent) -> tuple[Covariance, Floats]:
    """Covariance and derivatives (d, n) of the residuals at the end of one ascent."""
    slopes = end.slopes[0]
    if np.isnan(slopes[0, 0]):
        slopes = forward_slopes(likelihood, end.unit, end.errors)[0]
    return covariance_of(likelihood, end.unit[0], slopes, end.errors[0]), slopes
