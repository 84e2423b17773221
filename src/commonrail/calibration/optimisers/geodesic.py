"""Iterations of damped least squares with geodesic acceleration within bounds and constraints, side by side.

A second difference along each damped step bends it along the valley in which it creeps otherwise (Transtrum, Sethna
2012, arXiv:1201.5885). Bounds and linear constraints hold exactly: a step is the minimum of its model among them.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Bools, Floats, IndexArray, Ints
from commonrail.calibration.optimisers.base import Trials, Wanted
from commonrail.calibration.optimisers.losses import DescentLoss
from commonrail.calibration.optimisers.quadratic import constrained_minimum
from commonrail.calibration.optimisers.verdict import SMALL_GAIN, noise_of
from commonrail.calibration.space import Space
from commonrail.elementary import norm, product
from commonrail.linear import cholesky, solve_lower, solve_upper

__all__ = ["Ends", "Rules", "advance"]

Work = Generator[Trials, Floats, "Ends"]

FIRST_DAMPING = 1e-3  # relative to the diagonal of JᵀWJ
FACTORS = np.array([0.1, 10.0])  # dampings tried at once, of the one that was best before
DAMPINGS = (1e-10, 1e6)  # beyond the larger one a descent is stuck
PROBE = 0.1  # share of a step at which its second difference is taken
BENT = 1.5  # ratio of acceleration to velocity above which the second difference is not believed
UNDAMPED = 1e-9  # relative to the diagonal: of the full step whose gain tells if a descent has arrived
SMALL_STEPS = 2  # steps in a row with no more than a small gain before a descent ends


class Rules(NamedTuple):
    """Loss that descents lower, its scale, and the forward difference as a share of each range."""

    loss: DescentLoss
    scale: float
    difference: float


class Ends(NamedTuple):
    """State of k descents.

    Attributes
    ----------
    unit : (k, d)
        Their points, unit coordinates.
    residuals : (k, m)
        Residuals there; not finite where the start could not be simulated.
    damping : (k,)
    small : (k,) int
        Steps in a row with no more than a small gain.
    running : (k,) bool
    gain : (k,)
        Change of 2 ln L that a full step from the last point but one, or the last, was predicted to gain.
    """

    unit: Floats
    residuals: Floats
    damping: Floats
    small: Ints
    running: Bools
    gain: Floats

    @classmethod
    def begin(cls, unit: Floats, residuals: Floats) -> Ends:
        """New descents from points (k, d) with residuals (k, m); those that cannot be simulated end at once."""
        count = len(unit)
        running = np.asarray(np.isfinite(residuals).all(axis=1))
        full = np.full(count, np.inf)
        return cls(unit.copy(), residuals.copy(), np.full(count, FIRST_DAMPING), np.zeros(count, int), running, full)

    def joined(self, others: Ends) -> Ends:
        """These descents and others behind them."""
        mine, theirs = self._asdict(), others._asdict()
        return Ends(**{name: np.concatenate([mine[name], theirs[name]]) for name in mine})

    def noise(self, rules: Rules) -> float:
        """Change of the loss that changes 2 ln L by 1, by the residuals of the best descent."""
        count, parameters = self.residuals.shape[1], self.unit.shape[1]
        return noise_of(float(np.min(self.sums(rules))), count, parameters, rules.loss.units)

    def sums(self, rules: Rules) -> Floats:
        """Loss (k,) of each descent."""
        return rules.loss.sums(self.residuals, rules.scale)


class _Model(NamedTuple):
    """Loss about a point: Jacobian (m, d), weights (m,), H (d, d), slope (d,), and what steps must keep."""

    jacobian: Floats
    weights: Floats
    hessian: Floats
    slope: Floats
    rows: Floats
    least: Floats

    def damped(self, damping: float) -> Floats:
        """H with the damped diagonal (d, d)."""
        diagonal = np.diag(self.hessian)
        return self.hessian + np.diag(damping * np.maximum(diagonal, 1e-9 * max(float(diagonal.max()), 1e-300)))

    def step(self, metric: Floats, wanted: Floats | None = None) -> Floats:
        """Minimum of the model with a damped H among the allowed steps, or the allowed step nearest to a wanted one."""
        gradient = self.slope if wanted is None else -product(metric, wanted[:, None])[:, 0]
        return constrained_minimum(metric, gradient, self.rows, self.least)

    @property
    def gain(self) -> float:
        """Fall of the loss that the model predicts for the full step within the constraints."""
        step = self.step(self.damped(UNDAMPED))
        return -float(np.sum(step * (2.0 * self.slope + product(self.hessian, step[:, None])[:, 0])))


def advance(space: Space, ends: Ends, rules: Rules) -> Work:
    """One iteration of each running descent: questions for residuals come out, answers are sent in.

    The questions: all differences of all descents; those that failed, to the other side; a probe on each damped step;
    the damped and bent steps. The best step of a descent is taken if it lowers the loss.

    Parameters
    ----------
    space : Space
    ends : Ends
        At least one descent is running.
    rules : Rules

    Returns
    -------
    Ends
    """
    after = Ends(**{name: part.copy() for name, part in ends._asdict().items()})
    noise = ends.noise(rules)
    running = np.flatnonzero(ends.running)
    slopes = yield from _slopes(space, ends, running, rules.difference)
    models = {i: _model(space, ends, i, j, rules) for i, j in zip(running.tolist(), slopes, strict=True)}
    for i, model in models.items():
        after.gain[i] = model.gain / noise
        after.running[i] = after.gain[i] > SMALL_GAIN
    going = [i for i in models if after.running[i]]
    if not going:
        return after
    steps = yield from _steps(space, ends, going, models)
    x = np.concatenate([_inside(space, ends.unit[i], steps[i]) for i in going])
    told = (yield _asked(space, x)).reshape(len(going), len(FACTORS), -1)
    costs = rules.loss.sums(told, rules.scale)
    before = ends.sums(rules)
    for i, points, found, cost in zip(going, x.reshape(len(going), len(FACTORS), -1), told, costs, strict=True):
        winner = int(np.argmin(cost))
        gained = (float(before[i]) - float(cost[winner])) / noise
        if gained > 0.0:
            after.unit[i], after.residuals[i] = points[winner], found[winner]
            after.damping[i] = max(ends.damping[i] * FACTORS[winner], DAMPINGS[0])
            after.small[i] = ends.small[i] + 1 if gained <= SMALL_GAIN else 0
        else:
            after.damping[i] = ends.damping[i] * FACTORS[-1] * 3.0
        after.running[i] = after.small[i] < SMALL_STEPS and after.damping[i] <= DAMPINGS[1]
    return after


def _slopes(
    space: Space, ends: Ends, running: IndexArray, difference: float
) -> Generator[Trials, Floats, list[Floats]]:
    """Jacobians (m, d) of the running descents, all differences in one question; zero columns where both sides fail."""
    unit, base = ends.unit[running], ends.residuals[running]
    steps = np.where(unit + difference <= 1.0, difference, -difference)
    count, d = unit.shape

    def points(widths: Floats) -> Floats:
        return unit[:, None, :] + widths[:, :, None] * np.eye(d)

    told = (yield _asked(space, points(steps).reshape(-1, d))).reshape(count, d, -1).copy()
    failed = ~np.isfinite(told).all(axis=2)
    other = unit - steps
    redo = failed & (other >= 0.0) & (other <= 1.0)
    if redo.any():
        told[redo] = yield _asked(space, points(-steps)[redo])
        steps = np.where(redo, -steps, steps)
    with np.errstate(invalid="ignore"):
        found = (told - base[:, None, :]) / steps[:, :, None]
    found = np.where(np.isfinite(found).all(axis=2, keepdims=True), found, 0.0)
    return [one.T for one in found]


def _model(space: Space, ends: Ends, i: int, jacobian: Floats, rules: Rules) -> _Model:
    residuals = ends.residuals[i]
    weights = rules.loss.weights(residuals, rules.scale)
    weighted = weights[:, None] * jacobian
    bend = rules.loss.bend(residuals, rules.scale)
    hessian = bend * np.array([np.sum(weighted * column[:, None], axis=0) for column in jacobian.T])
    slope = np.sum(weighted * residuals[:, None], axis=0)
    flat = ~(np.diag(hessian) > 0.0)
    hessian[flat, flat] = max(float(np.diag(hessian).max(initial=0.0)), 1e-300)  # what nothing depends on stays
    return _Model(jacobian, weights, hessian, slope, *_limits(space, ends.unit[i]))


def _limits(space: Space, unit: Floats) -> tuple[Floats, Floats]:
    """Rows and smallest values of what steps (d,) from a feasible point must keep: bounds, linear constraints."""
    eye = np.eye(len(unit))
    rows, least = [eye, -eye], [-unit, unit - 1.0]
    if len(space.rows):
        x, width = space.from_unit(unit), 1e-6
        slope = np.where(
            space.logarithmic,
            (space.from_unit(np.minimum(unit + width, 1.0)) - space.from_unit(np.maximum(unit - width, 0.0)))
            / (np.minimum(unit + width, 1.0) - np.maximum(unit - width, 0.0)),
            space.upper - space.lower,
        )
        linear = space.rows.matrix * slope
        size = np.sum(np.abs(linear), axis=1)
        rows.append(linear / size[:, None])
        least.append(-np.maximum(space.slack(x), 0.0) / size)
    return np.vstack(rows), np.concatenate(least)


def _steps(
    space: Space, ends: Ends, going: list[int], models: dict[int, _Model]
) -> Generator[Trials, Floats, dict[int, Floats]]:
    """Damped and bent steps (dampings, d) of each descent that goes on."""
    metrics = {i: [models[i].damped(float(ends.damping[i] * factor)) for factor in FACTORS] for i in going}
    straight = {i: np.array([models[i].step(metric) for metric in metrics[i]]) for i in going}
    probes = np.concatenate([np.clip(ends.unit[i] + PROBE * straight[i], 0.0, 1.0) for i in going])
    told = (yield _asked(space, probes)).reshape(len(going), len(FACTORS), -1)
    steps = {}
    for i, found in zip(going, told, strict=True):
        bent = [
            _bent(models[i], metric, ends.residuals[i], velocity, probed)
            for metric, velocity, probed in zip(metrics[i], straight[i], found, strict=True)
        ]
        steps[i] = np.array(bent)
    return steps


def _bent(model: _Model, metric: Floats, residuals: Floats, velocity: Floats, probed: Floats) -> Floats:
    """Step (d,) with half of its geodesic acceleration, within the constraints; straight where that is not believed.

    Parameters
    ----------
    model : _Model
    metric : (d, d)
        Damped H of the step.
    residuals : (m,)
        At the point.
    velocity : (d,)
        Straight step.
    probed : (m,)
        Residuals at `PROBE` of it.
    """
    if not np.isfinite(probed).all():
        return velocity
    along = product(model.jacobian, velocity[:, None])[:, 0]
    second = 2.0 / PROBE * ((probed - residuals) / PROBE - along)
    lower = cholesky(metric)
    right = np.sum((model.weights * second)[:, None] * model.jacobian, axis=0)
    acceleration = -solve_upper(lower.T, solve_lower(lower, right))
    if not norm(acceleration) < BENT * max(norm(velocity), 1e-300):
        return velocity
    return model.step(metric, velocity + 0.5 * acceleration)


def _asked(space: Space, unit: Floats) -> Trials:
    return Trials(space.from_unit(unit), np.ones(len(unit), bool), Wanted.RESIDUALS)


def _inside(space: Space, unit: Floats, steps: Floats) -> Floats:
    """Ends (n, d) of steps from a feasible point (d,), or the last feasible points on the way there."""
    there = np.clip(unit + steps, 0.0, 1.0)
    if not space.constrained:
        return there
    own = space.from_unit(np.tile(unit, (len(there), 1)))
    inside = np.clip(space.to_unit(space.pull_back(own, space.from_unit(there))), 0.0, 1.0)
    return np.where(space.satisfies(space.from_unit(inside))[:, None], inside, unit)
