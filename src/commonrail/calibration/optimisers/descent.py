"""Iterations of damped least squares within bounds, for several descents side by side."""

from __future__ import annotations

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Bools, Floats, IndexArray, Ints
from commonrail.calibration.optimisers.base import Trials, Wanted
from commonrail.calibration.space import Space
from commonrail.elementary import product
from commonrail.linear import cholesky, solve_lower, solve_upper

__all__ = ["DAMPING", "DIFFERENCES", "Descents", "iterate"]


# Forward differences as shares of the range, one stage each. Quantities jump where a valve or a needle bounces once
# more: a small step measures such a jump or none, a large one the mean slope across many of them.
DIFFERENCES = (1e-2, 3e-3, 1e-3)
DAMPING = 1e-2  # of a descent that begins, relative to the diagonal of JᵀJ
LEAST_DAMPING = 1e-7

# Dampings that are tried at once, as factors of the one that was best before: eight fill a SIMD block.
FACTORS = 4.0 ** np.arange(-3.0, 5.0)
CONSTRAINT_WEIGHT = 1e2  # residual of a constraint that is broken by all that its row can vary by within the bounds
LEAST_GAIN = 1e-4  # relative fall of the cost below which the next stage begins


class Descents(NamedTuple):
    """State of k descents.

    Attributes
    ----------
    unit : (k, d)
        Their points, unit coordinates.
    damping : (k,)
    stage : (k,) int
        Index of the difference step in `DIFFERENCES`; beyond it the descent has ended.
    iteration : (k,) int
        Iterations of the stage done.
    """

    unit: Floats
    damping: Floats
    stage: Ints
    iteration: Ints

    @classmethod
    def begin(cls, unit: Floats) -> Descents:
        """New descents from points (k, d)."""
        none = np.zeros(len(unit), np.int64)
        return cls(unit.copy(), np.full(len(unit), DAMPING), none, none.copy())

    def running(self, stages: int) -> Bools:
        """Mask (k,) of those that have not done so many stages."""
        return self.stage < stages

    def ended(self, mask: Bools) -> Descents:
        """The same, those of a mask (k,) at the end of all stages."""
        return self._replace(stage=np.where(mask, len(DIFFERENCES), self.stage))

    def of(self, chosen: IndexArray) -> Descents:
        """Some of the descents."""
        return Descents(self.unit[chosen], self.damping[chosen], self.stage[chosen], self.iteration[chosen])

    def restarted(self) -> Descents:
        """The same points and dampings at the beginning of the first stage."""
        none = np.zeros_like(self.stage)
        return self._replace(stage=none, iteration=none.copy())


class _Model(NamedTuple):
    """Residuals (m,) at a point and their derivatives (m, d) in unit coordinates."""

    residuals: Floats
    jacobian: Floats

    def step(self, unit: Floats, damping: float) -> Floats:
        """Point (d,) within the bounds to which a damped Gauss–Newton step leads.

        Parameters that a step would carry over a bound are held there, and the step of the others is solved anew.
        """
        transposed = self.jacobian.T
        gradient, hessian = product(transposed, self.residuals[:, None])[:, 0], product(transposed, self.jacobian)
        diagonal = np.diag(hessian)
        hessian = hessian + np.diag(damping * np.maximum(diagonal, 1e-6 * diagonal.max(initial=1e-300)))
        there, free = unit.copy(), np.ones(len(unit), bool)
        for _ in range(len(unit)):
            moved = there - unit
            right = -(gradient + product(hessian[:, ~free], moved[~free][:, None])[:, 0])[free]
            lower = cholesky(hessian[np.ix_(free, free)])
            proposed = unit[free] + solve_upper(lower.T, solve_lower(lower, right))
            outside = (proposed < 0.0) | (proposed > 1.0)
            there[free] = np.clip(proposed, 0.0, 1.0)
            if not outside.any():
                break
            free[np.flatnonzero(free)[outside]] = False
            if not free.any():
                break
        return there


def iterate(space: Space, descents: Descents, stages: int, most: int) -> Generator[Trials, Floats, Descents]:
    """One iteration of each running descent: questions for residuals come out, answers are sent in.

    All differences of all descents are one question, those that failed and are taken to the other side a second one,
    and all damped steps the last. The best step of a descent is taken if it lowers the sum of squares.

    Parameters
    ----------
    space : Space
    descents : Descents
        At least one of them is running.
    stages : int
        Stages after which a descent stands still.
    most : int
        Largest number of iterations of a stage.

    Returns
    -------
    Descents
    """
    running = np.flatnonzero(descents.running(stages))
    models = yield from _models(space, descents.of(running))
    trials = [
        _pulled(space, unit, np.array([model.step(unit, damping * factor) for factor in FACTORS]))
        for unit, damping, model in zip(descents.unit[running], descents.damping[running], models, strict=True)
    ]
    told = yield _asked(space, np.concatenate(trials))
    costs = _squares(_extended(space, np.concatenate(trials), told)).reshape(len(running), -1)
    after = descents.of(np.arange(len(descents.unit)))
    for row, model, points, cost in zip(running.tolist(), models, trials, costs, strict=True):
        before = float(_squares(model.residuals[None, :])[0])
        winner = int(np.argmin(cost))
        better = cost[winner] < before
        after.iteration[row] += 1
        if better:
            after.unit[row] = points[winner]
            after.damping[row] = max(descents.damping[row] * FACTORS[winner], LEAST_DAMPING)
        stalled = not cost[winner] < (1.0 - LEAST_GAIN) * before
        if stalled or after.iteration[row] >= most:
            after.stage[row] += 1
            after.iteration[row] = 0
    return after


def _models(space: Space, descents: Descents) -> Generator[Trials, Floats, list[_Model]]:
    """Residuals and Jacobians at the points of descents, all differences in one question."""
    d = space.dimension
    widths = np.array(DIFFERENCES)[descents.stage][:, None]
    steps = np.where(descents.unit + widths <= 1.0, widths, -widths)  # (k, d)
    points = descents.unit[:, None, :] + np.concatenate([np.zeros((len(steps), 1, d)), _diagonal(steps)], axis=1)
    flat = points.reshape(-1, d)
    told = _extended(space, flat, (yield _asked(space, flat))).reshape(len(steps), d + 1, -1)
    base, values = told[:, 0], told[:, 1:]
    other = descents.unit - steps
    failed: Bools = np.any(~np.isfinite(values), axis=2) & np.isfinite(base).all(axis=1, keepdims=True)
    redo = failed & (other >= 0.0) & (other <= 1.0)
    if redo.any():
        again = descents.unit[:, None, :] - _diagonal(steps)
        values[redo] = _extended(space, again[redo], (yield _asked(space, again[redo])))
        steps = np.where(redo, -steps, steps)
    with np.errstate(invalid="ignore"):
        slopes = (values - base[:, None, :]) / steps[:, :, None]
    slopes = np.where(np.isfinite(slopes).all(axis=2, keepdims=True), slopes, 0.0)
    return [_Model(residuals, jacobian.T) for residuals, jacobian in zip(base, slopes, strict=True)]


def _diagonal(steps: Floats) -> Floats:
    """Steps (k, d) of one parameter each, (k, d, d)."""
    return steps[:, :, None] * np.eye(steps.shape[1])


def _asked(space: Space, unit: Floats) -> Trials:
    return Trials(space.from_unit(unit), np.ones(len(unit), bool), Wanted.RESIDUALS)


def _extended(space: Space, unit: Floats, told: Floats) -> Floats:
    """Residuals (n, m) and those of broken constraints behind them."""
    return np.hstack([told, CONSTRAINT_WEIGHT * space.shortfall(space.from_unit(unit))])


def _squares(residuals: Floats) -> Floats:
    """Sum of squares (n,) of residuals (n, m); +inf where one is not finite."""
    total = np.sum(residuals**2, axis=1)
    return np.where(np.isfinite(total), total, np.inf)


def _pulled(space: Space, unit: Floats, trials: Floats) -> Floats:
    """Trials (n, d) pulled to the last feasible point on their way from a feasible point (d,), unit coordinates."""
    if not space.constrained:
        return trials
    x, own = space.from_unit(trials), space.from_unit(unit)
    inside = space.pull_back(np.tile(own, (len(x), 1)), x)
    pulled = np.clip(space.to_unit(inside), 0.0, 1.0)
    # the way to unit coordinates and back rounds
    return np.where(space.satisfies(space.from_unit(pulled))[:, None], pulled, unit)
