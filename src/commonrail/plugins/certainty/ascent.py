"""Ascent to the most likely values by damped least squares of the innovations, from many starts in one batch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.stages import tell
from commonrail.calibration.optimisers.least_squares import Descents, FeasibleSet, Model, Rules, advance, answered
from commonrail.plugins.certainty.likelihood import Likelihood, prior_slopes_at

FACTORS = (0.03, 1.0, 30.0)  # dampings tried side by side, times the current one
FEW = 5  # free parameters, up to which steps are straight: bending them saves no step and costs a third of the points


class Ascent(NamedTuple):
    """Ends of ascents."""

    unit: Floats  # (k, d), positions between the bounds
    cost: Floats  # (k,), −2 ln of likelihood and priors, without constants; +inf where the start failed
    errors: Floats  # (k, n), residuals there
    slopes: Floats  # (k, d, n), one-sided derivatives there, zero for a fixed parameter; NaN where they are not known

    @property
    def best(self) -> Ascent:
        """The one that ends highest."""
        best = int(np.argmin(self.cost))
        return Ascent(*(row[best : best + 1] for row in self))


class _Criterion(NamedTuple):
    """−2 ln of likelihood and priors, for damped least squares; innovations end with the residuals of the priors."""

    likelihood: Likelihood

    def innovations(self, residuals: Floats, unit: Floats) -> Floats:
        complete = np.isfinite(residuals).all(axis=-1, keepdims=True)
        data = np.where(complete, self.likelihood.whiten(np.where(complete, residuals, 0.0)), np.nan)
        return np.concatenate([data, self.likelihood.prior_residuals(unit)], axis=-1)

    def tangents(self, slopes: Floats, unit: Floats) -> Floats:
        priors = [prior_slopes_at(self.likelihood, point).T for point in unit]
        return np.concatenate([self.likelihood.whiten(slopes), np.array(priors).reshape(*unit.shape, -1)], axis=2)

    def costs(self, innovations: Floats) -> Floats:
        likelihood, n = self.likelihood, self.likelihood.size
        cost = likelihood.block_costs(innovations[..., :n]).sum(axis=-1) + np.sum(innovations[..., n:] ** 2, axis=-1)
        return np.where(np.isfinite(cost), cost, np.inf)

    def weights(self, innovations: Floats) -> Floats:
        return self.likelihood.weights(innovations)

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
    """Ascend from positions (k, d) within the constraints to the most likely values that each leads to.

    `likelihood`: with its noise; `fixed` (h,): parameters that stay; `errors` (k, n), `slopes` (k, d, n): at the
    positions, if they are known, as in `Ascent`; `turns`: largest number of steps; `tolerance`: fall of −2 ln L that
    counts as none: an ascent ends where the linear model promises no more, or two steps in a row bring no more.
    """
    if errors is None:
        errors = likelihood.residuals(likelihood.space.from_unit(unit))
    free = np.ones(unit.shape, bool)
    if fixed is not None:
        free[:, fixed] = False
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
