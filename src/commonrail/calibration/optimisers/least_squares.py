"""Damped least squares within bounds and constraints: several descents side by side, each of their steps one batch.

Levenberg–Marquardt: a step z minimises |r + J z|² + λ z·D z, D being the diagonal of JᵀJ, among the steps that bounds
and linear constraints allow (least-distance programming: Lawson, Hanson, Solving Least Squares Problems, 1974,
chapter 23). Several dampings λ are tried at once. Losses other than squares enter by weights of the residuals
(iteratively reweighted). Where parameters are many, a second difference along each step bends it along the valley in
which it creeps otherwise (geodesic acceleration: Transtrum, Sethna 2012, arXiv:1201.5885).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from enum import StrEnum
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from commonrail.base.arrays import Bools, Floats, IndexArray, Ints
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.optimisers.base import Question, Trials, asked, inside
from commonrail.calibration.space import Space


class DescentLoss(StrEnum):
    """Loss of a residual; `scale` smooths the absolute value only."""

    SQUARES = "squares"
    """r²."""

    ABSOLUTE = "absolute errors"
    """sqrt(r² + scale²) − scale, which is |r| for residuals far above the scale."""

    SOFT = "soft L1"
    """2 (sqrt(1 + r²) − 1)."""

    def values(self, residuals: Floats, scale: float) -> Floats:
        """Loss of each residual."""
        if self is DescentLoss.SQUARES:
            return residuals * residuals
        if self is DescentLoss.SOFT:
            return 2.0 * (np.sqrt(1.0 + residuals * residuals) - 1.0)
        return np.sqrt(residuals * residuals + scale * scale) - scale

    def sums(self, residuals: Floats, scale: float) -> Floats:
        """Sum (…,) of the losses of residuals (…, m); +inf where one is not finite."""
        with np.errstate(invalid="ignore", over="ignore"):
            total = np.sum(self.values(residuals, scale), axis=-1)
        return np.where(np.isfinite(total), total, np.inf)

    def weights(self, residuals: Floats, scale: float) -> Floats:
        """Weights w with which the slope of Σ w r², w held, is that of the loss."""
        if self is DescentLoss.SQUARES:
            return np.ones_like(residuals)
        if self is DescentLoss.SOFT:
            return 1.0 / np.sqrt(1.0 + residuals * residuals)
        return 0.5 / np.sqrt(residuals * residuals + scale * scale)

    def curvature(self, residuals: Floats, scale: float) -> Floats:
        """Mean curvature (k,) of the loss of residuals (k, m) over that of Σ w r², which is above it: from 1/4 to 1."""
        if self is DescentLoss.SQUARES:
            return np.ones(len(residuals))
        width = 1.0 if self is DescentLoss.SOFT else scale
        root = np.sqrt(residuals * residuals + width * width)
        share = np.sum(width * width / (root * root * root), axis=1) / np.sum(1.0 / root, axis=1)
        return np.asarray(np.clip(share, 0.25, 1.0))

    @property
    def units(self) -> float:
        """2 ln L per residual for a relative change of the sum: 2 for a Laplace distribution of errors, else 1."""
        return 2.0 if self is DescentLoss.ABSOLUTE else 1.0


def recognised(costs: Floats, residuals: Floats) -> DescentLoss:
    """Loss whose sums over residuals come nearest to an objective, or are it; squares where none can be compared.

    `costs` (n,): objective of candidates; `residuals` (n, m): their residuals.
    """
    usable = np.isfinite(costs) & np.isfinite(residuals).all(axis=1)

    def distance(loss: DescentLoss) -> float:
        return float(np.sum(np.abs(loss.sums(residuals[usable], 0.0) - costs[usable])))

    return min(DescentLoss, key=distance)


class LossSum(NamedTuple):
    """Sum of losses of residuals, a `Criterion` of least squares; the scale is that of `DescentLoss`."""

    loss: DescentLoss = DescentLoss.SQUARES
    scale: float = 1.0

    @classmethod
    def near(cls, loss: DescentLoss, residuals: Floats) -> LossSum:
        """Sum whose absolute values are smoothed over half of the mean magnitude of residuals (m,)."""
        return cls(loss, max(0.5 * float(np.mean(np.abs(residuals))), 1e-300))

    def innovations(self, residuals: Floats, unit: Floats) -> Floats:
        """The residuals."""
        return residuals

    def tangents(self, slopes: Floats, unit: Floats) -> Floats:
        """The derivatives of the residuals."""
        return slopes

    def costs(self, innovations: Floats) -> Floats:
        """Sums of the losses."""
        return self.loss.sums(innovations, self.scale)

    def weights(self, innovations: Floats) -> Floats:
        """Weights of the residuals."""
        return self.loss.weights(innovations, self.scale)

    def curvature(self, innovations: Floats) -> Floats:
        """Curvature of the losses over that of the weighted squares."""
        return self.loss.curvature(innovations, self.scale)


Result = TypeVar("Result")
Questions = Generator[Trials, Floats, Result]
"""Questions for residuals come out, answers are sent in."""

FIRST_DAMPING = 1e-3  # relative to the diagonal of JᵀWJ
DAMPINGS = (1e-10, 1e6)  # a descent is stuck beyond the larger one
FACTORS = (0.1, 10.0)  # dampings tried at once, of the one that was best before
RAISED = 3.0  # times the largest factor, where no step lowers the cost
FLAT = 1e-9  # of the largest diagonal element of JᵀWJ: damping of a parameter that residuals hardly depend on
UNDAMPED = 1e-9  # damping of the step whose gain tells if a descent has arrived
SMALL_STEPS = 2  # steps in a row with no more than a small gain, at which a descent ends
PROBE = 0.1  # share of a step at which its second difference is taken
MOST_BENT = 1.5  # acceleration over step, above which the second difference is not believed
SLACK = 1e-9  # distance beyond a bound or constraint that is forgiven, in unit coordinates
_ROUNDING = 1e-12


class Criterion(Protocol):
    """Cost that descents lower: a sum of losses of innovations, which are linear in the residuals."""

    def innovations(self, residuals: Floats, unit: Floats) -> Floats:
        """Innovations (…, m) of residuals (…, n) at unit coordinates (…, d); not finite where the residuals are not."""

    def tangents(self, slopes: Floats, unit: Floats) -> Floats:
        """Derivatives (k, d, m) of the innovations by those of the residuals (k, d, n) at unit coordinates (k, d)."""

    def costs(self, innovations: Floats) -> Floats:
        """Cost (…,) of innovations (…, m); +inf where one is not finite."""

    def weights(self, innovations: Floats) -> Floats:
        """Weights w (k, m) with which the slope of Σ w u², w fixed, is that of the cost."""

    def curvature(self, innovations: Floats) -> Floats:
        """Curvature (k,) of the cost over that of Σ w u²."""


class Rules(NamedTuple):
    """Rules of an iteration."""

    difference: float | Floats  # width of the one-sided differences, in unit coordinates
    least_gain: float  # fall of the cost that counts as none
    factors: tuple[float, ...] = FACTORS  # dampings tried at once, of the one that was best before
    bent: bool = True  # use geodesic acceleration
    free: Bools | None = None  # (k, d) bool, parameters that each descent moves; all by default


class Descents(NamedTuple):
    """State of k descents."""

    unit: Floats  # (k, d), their points, unit coordinates
    residuals: Floats  # (k, n), residuals there; not finite where the start could not be simulated
    # (k, d, n), one-sided derivatives of the residuals there, zero for fixed parameters; NaN where they are not known
    slopes: Floats
    damping: Floats  # (k,)
    small: Ints  # (k,) int, steps in a row with no more than a small gain
    running: Bools  # (k,) bool
    # (k,), fall of the cost that a full step from the last point but one, or the last, was predicted to bring
    gain: Floats

    @classmethod
    def begin(cls, unit: Floats, residuals: Floats, slopes: Floats | None = None) -> Descents:
        """New descents from points (k, d) with residuals (k, n); those that cannot be simulated end at once."""
        count, d = unit.shape
        if slopes is None:
            slopes = np.full((count, d, residuals.shape[1]), np.nan)
        running = np.asarray(np.isfinite(residuals).all(axis=1))
        small, gain = np.zeros(count, int), np.full(count, np.inf)
        return cls(unit.copy(), residuals.copy(), slopes.copy(), np.full(count, FIRST_DAMPING), small, running, gain)

    def at(self, rows: IndexArray | Bools) -> Descents:
        """Copies of some of the descents."""
        return Descents._make(array[rows] for array in self)

    def joined(self, others: Descents) -> Descents:
        """These descents and others behind them."""
        return Descents._make(np.concatenate(pair) for pair in zip(self, others, strict=True))

    def record(self) -> dict[str, Any]:
        """Part of a state; derivatives would be most of it, and are taken anew."""
        return {name: array.copy() for name, array in self._asdict().items() if name != "slopes"}

    @classmethod
    def recorded(cls, state: Mapping[str, Any], dimension: int) -> Descents:
        """Descents from their part of a state.

        Raises `ConfigurationError` if they are not whole or lie outside the bounds.
        """
        unit, residuals, damping, gain = (
            np.array(state[name], dtype=float) for name in ("unit", "residuals", "damping", "gain")
        )
        small, running = np.array(state["small"], dtype=np.int64), np.array(state["running"], dtype=np.bool_)
        count = len(unit)
        if unit.shape != (count, dimension) or residuals.shape[:1] != (count,) or residuals.ndim != 2:
            raise ConfigurationError("state: its descents are incomplete; use an intact state")
        if {array.shape for array in (damping, gain, small, running)} != {(count,)}:
            raise ConfigurationError("state: its descents are incomplete; use an intact state")
        if not inside(unit):
            raise ConfigurationError("state: its descents lie outside the bounds; use an intact state")
        begun = cls.begin(unit, residuals)
        return begun._replace(damping=damping, small=small, running=running, gain=gain)

    def without_slopes(self) -> Descents:
        """The same, to be differentiated anew, as those from a `record` are."""
        return self._replace(slopes=np.full_like(self.slopes, np.nan))


class FeasibleSet(NamedTuple):
    """Bounds and linear constraints ``rows @ unit >= floor`` in unit coordinates.

    The rows of the constraints come first, then 2 d rows of the bounds. A constraint that has a parameter on a
    logarithmic scale is curved in unit coordinates and not among them: `limits` linearises it, and `within` keeps to
    all constraints.
    """

    rows: Floats  # (m, d)
    floor: Floats  # (m,)
    constraints: int  # number of rows that are constraints
    space: Space

    @classmethod
    def of(cls, space: Space) -> FeasibleSet:
        """Feasible set of a space."""
        polytope, count = space.polytope, len(space.rows)
        straight = ~(polytope.rows[:count] != 0.0)[:, space.logarithmic].any(axis=1)
        keep = np.concatenate([straight, np.ones(len(polytope.rows) - count, bool)])
        return cls(polytope.rows[keep], polytope.floor[keep], int(np.count_nonzero(straight)), space)

    def keep(self, unit: Floats) -> Bools:
        """Return which points (…, d) satisfy the rows."""
        return np.asarray((unit @ self.rows.T >= self.floor - SLACK).all(axis=-1))

    def active(self, unit: Floats, near: float = 1e-6) -> Bools:
        """Mask (m,) of the rows that a point (d,) touches."""
        return np.asarray(self.rows @ unit - self.floor <= near)

    def limits(self, unit: Floats) -> tuple[Floats, Floats]:
        """Rows and smallest values that steps from a feasible point (d,) must keep, curved constraints linearised."""
        rows, least = self.rows, self.floor - self.rows @ unit
        space, log = self.space, self.space.logarithmic
        curved = space.rows.matrix[:, log].any(axis=1)
        if curved.any():
            x = space.from_unit(unit)
            ratio = np.where(log, space.upper, 1.0) / np.where(log, space.lower, 1.0)
            linear = space.rows.matrix[curved] * np.where(log, x * np.log(ratio), space.upper - space.lower)
            size = np.linalg.norm(linear, axis=1)
            rows = np.vstack([linear / size[:, None], rows])
            least = np.concatenate([-space.slack(x)[curved] / size, least])
        return rows, np.minimum(least, 0.0)

    def within(self, start: Floats, unit: Floats) -> Floats:
        """Points (n, d) within the bounds, those that break a constraint pulled back to feasible ones (n, d)."""
        inside, space = np.clip(unit, 0.0, 1.0), self.space
        if not space.constrained:
            return inside
        broken = ~space.satisfies(space.from_unit(inside))
        if broken.any():
            anchors = np.clip(start[broken], 0.0, 1.0)
            pulled = space.pull_back(space.from_unit(anchors), space.from_unit(inside[broken]))
            rounded = np.clip(space.to_unit(pulled), 0.0, 1.0)
            feasible = space.satisfies(space.from_unit(rounded))  # the way to unit coordinates and back rounds
            inside[broken] = np.where(feasible[:, None], rounded, anchors)
        return inside


def constrained_step(metric: Floats, step: Floats, rows: Floats, least: Floats) -> Floats:
    """Step z with ``rows @ z >= least`` that is nearest to a wanted one in a metric; zero where rounding leaves none.

    `metric` (d, d): positive definite; `step` (d,): wanted; `rows` (m, d); `least` (m,).
    """
    short = least - rows @ step
    if not (short > _ROUNDING).any():
        return step
    from scipy.optimize import nnls  # slow to import

    inverse = np.linalg.inv(np.linalg.cholesky(metric))
    system = np.vstack([(rows @ inverse.T).T, short])
    target = np.zeros(len(system))
    target[-1] = 1.0
    try:
        weights, _ = nnls(system, target)
    except RuntimeError:  # more exchanges than it allows itself
        return np.zeros_like(step)
    rest = system @ weights - target
    if abs(rest[-1]) <= _ROUNDING:
        return np.zeros_like(step)
    return np.asarray(step + inverse.T @ (-rest[:-1] / rest[-1]))


class Model(NamedTuple):
    """Quadratic models of the cost about k points: c − 2 force·z + z·H z."""

    innovations: Floats  # (k, m)
    cost: Floats  # (k,)
    # (k, d, m), derivatives of the innovations, and these times the weights of the innovations
    tangents: Floats
    weighted: Floats
    hessian: Floats  # (k, d, d), H; that of a parameter that does not move is coupled with no other
    force: Floats  # (k, d)
    free: Bools  # (k, d) bool
    limits: list[tuple[Floats, Floats]]  # what steps from each point must keep, see `constrained_step`

    @classmethod
    def of(cls, feasible: FeasibleSet, criterion: Criterion, now: Descents, free: Bools | None = None) -> Model:
        """Models about the points of descents, whose slopes are known."""
        innovations = criterion.innovations(now.residuals, now.unit)
        tangents = criterion.tangents(now.slopes, now.unit)
        weighted = tangents * criterion.weights(innovations)[:, None, :]
        # einsum rather than a product of matrices: its sums do not depend on the number of threads
        hessian = np.einsum("kim,kjm->kij", weighted, tangents) * criterion.curvature(innovations)[:, None, None]
        force = -np.einsum("kim,km->ki", weighted, innovations)
        if free is None:
            free = np.ones(now.unit.shape, bool)
        hessian[~(free[:, :, None] & free[:, None, :])] = 0.0
        force[~free] = 0.0
        diagonal = np.einsum("kii->ki", hessian)  # a view
        largest = np.maximum(diagonal.max(axis=1, keepdims=True, initial=0.0), 1e-300)
        diagonal[...] = np.where(diagonal > 0.0, diagonal, largest)  # what nothing depends on stays
        limits = [feasible.limits(point) for point in now.unit]
        return cls(innovations, criterion.costs(innovations), tangents, weighted, hessian, force, free, limits)

    def at(self, rows: IndexArray) -> Model:
        """Some of the models."""
        return Model._make([*(array[rows] for array in self[:-1]), [self.limits[i] for i in rows]])

    def damped(self, damping: Floats) -> Floats:
        """H with damped diagonals (k, t, d, d) for dampings (k, t)."""
        diagonal = np.einsum("kii->ki", self.hessian)
        diagonal = np.maximum(diagonal, FLAT * diagonal.max(axis=1, keepdims=True))
        added = damping[:, :, None] * diagonal[:, None, :]
        return np.asarray(self.hessian[:, None] + added[..., None] * np.eye(diagonal.shape[1]))

    def solve(self, metrics: Floats, force: Floats) -> Floats:
        """Steps (k, t, d) by metrics (k, t, d, d) and forces (k, t, d) or (k, 1, d), without limits."""
        right_hand_sides = np.broadcast_to(force[..., None], (*metrics.shape[:3], 1))
        return np.asarray(np.linalg.solve(metrics, right_hand_sides)[..., 0])

    def limited(self, metrics: Floats, steps: Floats) -> Floats:
        """Allowed steps (k, t, d) nearest to wanted ones in metrics (k, t, d, d)."""
        allowed = steps.copy()
        for k, (rows, least) in enumerate(self.limits):
            for t in np.flatnonzero((steps[k] @ rows.T < least).any(axis=1)):
                free = np.flatnonzero(self.free[k])
                metric = metrics[k, t][np.ix_(free, free)]
                allowed[k, t, free] = constrained_step(metric, steps[k, t, free], rows[:, free], least)
        return allowed

    def full_step(self) -> tuple[Floats, Floats]:
        """Steps (k, d) to the minimum of each model among the allowed ones, and the fall of the cost by it (k,)."""
        metric = self.damped(np.full((len(self.hessian), 1), UNDAMPED))
        step = self.limited(metric, self.solve(metric, self.force[:, None]))[:, 0]
        return step, 2.0 * np.sum(self.force * step, axis=1) - np.einsum("ki,kij,kj->k", step, metric[:, 0], step)


def advance(space: Space, descents: Descents, criterion: Criterion, rules: Rules) -> Questions[Descents]:
    """One iteration of each running descent.

    The questions: unknown differences of all descents; those that failed, to the other side; a probe on each damped
    step, if steps are bent; the steps. The best step of a descent is taken if it lowers the cost.
    """
    after = descents.at(np.arange(len(descents.unit)))
    which = np.flatnonzero(after.running)
    if not len(which):
        return after
    feasible = FeasibleSet.of(space)
    free = None if rules.free is None else rules.free[which]
    new = np.isnan(after.slopes[which, 0, 0])
    if new.any():
        width = np.broadcast_to(rules.difference, len(after.unit))[which[new]]
        own_free = None if free is None else free[new]
        points = after.unit[which[new]], after.residuals[which[new]]
        after.slopes[which[new]] = yield from differences(space, *points, width, own_free)
    now = after.at(which)
    model = Model.of(feasible, criterion, now, free)
    after.gain[which] = model.full_step()[1]
    going = after.gain[which] > rules.least_gain
    after.running[which] = going
    which, now, model = which[going], now.at(going), model.at(np.flatnonzero(going))
    if not len(which):
        return after
    factors = np.array(rules.factors)
    metrics = model.damped(now.damping[:, None] * factors)
    steps = model.limited(metrics, model.solve(metrics, model.force[:, None]))
    if rules.bent:
        steps = yield from _bent(space, criterion, now, model, metrics, steps)
    shape = steps.shape
    ends = feasible.within(np.repeat(now.unit, shape[1], axis=0), (now.unit[:, None] + steps).reshape(-1, shape[2]))
    residuals = (yield _asked(space, ends)).reshape(*shape[:2], -1)
    ends = ends.reshape(shape)
    costs = criterion.costs(criterion.innovations(residuals, ends))
    best, rows = costs.argmin(axis=1), np.arange(len(which))
    fall = model.cost - costs[rows, best]
    better = fall > 0.0
    taken = which[better], (rows[better], best[better])
    after.unit[taken[0]], after.residuals[taken[0]], after.slopes[taken[0]] = (
        ends[taken[1]],
        residuals[taken[1]],
        np.nan,
    )
    factor = np.where(better, factors[best], RAISED * factors[-1])
    after.damping[which] = np.maximum(now.damping * factor, DAMPINGS[0])
    after.small[which] = np.where(better & (fall <= rules.least_gain), now.small + 1, 0)
    after.running[which] = (after.small[which] < SMALL_STEPS) & (after.damping[which] <= DAMPINGS[1])
    return after


def differences(
    space: Space, unit: Floats, residuals: Floats, width: Floats, free: Bools | None = None
) -> Questions[Floats]:
    """Derivatives (k, d, n) of residuals, forward, or backward at an upper bound and where that fails.

    `unit` (k, d); `residuals` (k, n): at the points; `width` (k,): of the differences, in unit coordinates; `free` (k,
    d) bool: parameters whose derivatives are asked for, all by default. The others are zero, as those that fail are.
    """
    rows, columns = np.nonzero(np.ones(unit.shape, bool) if free is None else free)
    each, sign = np.arange(len(rows)), np.where(unit[rows, columns] + width[rows] > 1.0, -1.0, 1.0)
    points = unit[rows]
    points[each, columns] += sign * width[rows]
    shifted = (yield _asked(space, points)).copy()
    other = unit[rows, columns] - sign * width[rows]
    redo = ~np.isfinite(shifted).all(axis=1) & (other >= 0.0) & (other <= 1.0)
    if redo.any():
        points[redo, columns[redo]] = other[redo]
        shifted[redo] = yield _asked(space, points[redo])
    slopes = np.zeros((*unit.shape, residuals.shape[1]))
    with np.errstate(invalid="ignore"):
        quotients = (shifted - residuals[rows]) / (points[each, columns] - unit[rows, columns])[:, None]
    slopes[rows, columns] = np.where(np.isfinite(quotients).all(axis=1, keepdims=True), quotients, 0.0)
    return slopes


def _bent(
    space: Space, criterion: Criterion, now: Descents, model: Model, metrics: Floats, steps: Floats
) -> Questions[Floats]:
    """Allowed steps (k, t, d) with half of their geodesic acceleration, straight where that is not believed."""
    probes = np.clip(now.unit[:, None] + PROBE * steps, 0.0, 1.0)
    residuals = (yield _asked(space, probes.reshape(-1, steps.shape[2]))).reshape(*steps.shape[:2], -1)
    change = criterion.innovations(residuals, probes) - model.innovations[:, None]
    second = 2.0 / PROBE * (change / PROBE - np.einsum("ktd,kdm->ktm", steps, model.tangents))
    is_finite = np.isfinite(second).all(axis=2, keepdims=True)
    force = -np.einsum("kdm,ktm->ktd", model.weighted, np.where(is_finite, second, 0.0))
    force[np.broadcast_to(~model.free[:, None], force.shape)] = 0.0
    acceleration = model.solve(metrics, force)
    share = np.linalg.norm(acceleration, axis=2) / np.maximum(np.linalg.norm(steps, axis=2), 1e-300)
    half = np.where(share < MOST_BENT, 0.5, 0.0)[..., None]
    return model.limited(metrics, steps + half * acceleration)


def _asked(space: Space, unit: Floats) -> Trials:
    return asked(space.from_unit(unit), Question.RESIDUALS)


def answered(questions: Questions[Result], residuals: Callable[[Floats], Floats]) -> Result:
    """Result of questions that a function answers.

    `residuals`: residuals (m, n) of points (m, d) in SI.
    """
    try:
        trials = next(questions)
        while True:
            trials = questions.send(residuals(trials.x))
    except StopIteration as stop:
        return stop.value  # type: ignore[no-any-return]
