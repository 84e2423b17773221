"""Ascent to the most likely values: Levenberg–Marquardt with geodesic acceleration, many starts in one batch.

The metric is that of the weighted innovations. Each trial step is bent along the valley by a second directional
difference (Transtrum and Sethna 2012) where there are more than a few parameters: with fewer, it saves no step and
costs a third of the simulations. All candidates of a round are simulated together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.steps import Walls, constrained_step
from commonrail.arrays import Floats, IndexArray

__all__ = ["FEW", "Ascent", "climb", "promised_step"]


DAMPINGS = np.array([0.03, 1.0, 30.0])  # tried side by side, times the current one
FIRST, WEAKEST, STRONGEST = 1e-3, 1e-10, 1e8
AHEAD = 0.1  # of a step at which its bend is measured
MOST_BEND = 1.5  # acceleration over step, above which it is left out
FEW = 5  # free parameters, up to which steps are straight
FAILED = 1e6  # innovation of a failed simulation


class Ascent(NamedTuple):
    """Ends of ascents.

    Attributes
    ----------
    unit : (k, d)
        Positions between the bounds.
    cost : (k,)
        −2 ln of likelihood and priors, without constants; +inf where the start failed.
    errors : (k, n)
        Residuals there.
    slopes : (k, d, n)
        One-sided derivatives there; NaN of an ascent that does not know them, zero for a parameter that it holds.
    """

    unit: Floats
    cost: Floats
    errors: Floats
    slopes: Floats


class _Climber:
    """State of ascents that go on together."""

    def __init__(
        self,
        likelihood: Likelihood,
        unit: Floats,
        held: IndexArray | None,
        errors: Floats | None,
        slopes: Floats | None,
    ) -> None:
        self.likelihood, self.held = likelihood, None if held is None else held.reshape(len(unit), -1)
        self.walls = Walls.of(likelihood.space)
        self.unit = unit.copy()
        self.errors = errors.copy() if errors is not None else likelihood.residuals(likelihood.space.from_unit(unit))
        self.wide = self._extended(self.errors, self.unit)
        self.cost = self._cost(self.wide)
        many = len(unit)
        unknown = np.full((many, unit.shape[1], likelihood.size), np.nan)
        self.slopes = unknown if slopes is None else slopes.copy()
        self.damping, self.small = np.full(many, FIRST), np.zeros(many, int)
        self.live, self.gain = np.isfinite(self.cost), np.full(many, np.inf)

    def _extended(self, errors: Floats, unit: Floats) -> Floats:
        """Innovations and pulls of the priors (…, n + p)."""
        own = self.likelihood
        sound = np.isfinite(errors[..., :1])  # a simulation that failed has no value at all
        innovations = np.where(sound, own.whiten(np.where(sound, errors, 0.0)), FAILED)
        d = unit.shape[-1]
        pulls = own.priors.residuals(own.space.from_unit(unit.reshape(-1, d)))
        return np.concatenate([innovations, pulls.reshape(*unit.shape[:-1], -1)], axis=-1)

    def _cost(self, wide: Floats) -> Floats:
        n = self.likelihood.size
        cost = self.likelihood.block_costs(wide[..., :n]).sum(axis=-1) + np.sum(wide[..., n:] ** 2, axis=-1)
        return np.where(np.abs(wide[..., 0]) >= FAILED, np.inf, cost)

    def _weights(self, wide: Floats) -> Floats:
        """Weights of the law of each value (k, n + p)."""
        found = np.ones_like(wide)
        for block, noise in zip(self.likelihood.blocks, self.likelihood.noises, strict=True):
            found[:, block.rows] = noise.density.weight(wide[:, block.rows])
        return found

    def _tangents(self, which: IndexArray) -> Floats:
        """Derivatives (k, d, n + p) of innovations and pulls."""
        own, unit = self.likelihood, self.unit[which]
        new = which[np.isnan(self.slopes[which, 0, 0])]
        if len(new):
            held = None if self.held is None else self.held[new]
            self.slopes[new] = own.jacobian(self.unit[new], central=False, base=self.errors[new], held=held)
        data = own.whiten(self.slopes[which])
        k, d = unit.shape
        pulls = np.zeros((k, d, len(own.priors)))
        if len(own.priors):
            for i, at in enumerate(unit):
                pulls[i] = np.diag(own.scaled(at))[:, own.priors.columns] / own.priors.sigmas
        return np.concatenate([data, pulls], axis=2)

    def _simulated(self, unit: Floats) -> tuple[Floats, Floats]:
        """Residuals and extended innovations of positions (k, trials, d)."""
        k, trials, d = unit.shape
        errors = self.likelihood.residuals(self.likelihood.space.from_unit(unit.reshape(-1, d))).reshape(k, trials, -1)
        return errors, self._extended(errors, unit)

    def turn(self, tolerance: float) -> None:
        """One step of every ascent that goes on."""
        which = np.flatnonzero(self.live)
        tangents, wide = self._tangents(which), self.wide[which]
        weighted = tangents * self._weights(wide)[:, None, :]
        metric, force = weighted @ tangents.transpose(0, 2, 1), -(weighted @ wide[:, :, None])[..., 0]
        if self.held is not None:
            _hold(metric, force, self.held[which])
        self.gain[which] = self._promised(metric, force, which)
        on = self.gain[which] >= tolerance
        self.live[which[~on]] = False
        which, metric, force, tangents, weighted = which[on], metric[on], force[on], tangents[on], weighted[on]
        if not len(which):
            return
        damped = self._damped(metric, which)
        wanted = np.broadcast_to(force[:, None, :, None], (*damped.shape[:3], 1))
        step: Floats = np.asarray(np.linalg.solve(damped, wanted)[..., 0], float)
        if self.unit.shape[1] - (0 if self.held is None else self.held.shape[1]) > FEW:
            step = step + self._bend(which, damped, weighted, tangents, step)
        self._try(which, damped, step, tolerance)

    def _damped(self, metric: Floats, which: IndexArray) -> Floats:
        diagonal = np.einsum("kii->ki", metric)
        diagonal = diagonal + 1e-9 * np.maximum(diagonal.max(axis=1, keepdims=True), 1e-300)
        strength = DAMPINGS * self.damping[which][:, None]
        return np.asarray(metric[:, None] + strength[..., None, None] * _diagonal(diagonal)[:, None])

    def _promised(self, metric: Floats, force: Floats, which: IndexArray) -> Floats:
        """Fall of the cost by an undamped step within the walls."""
        found = np.empty(len(which))
        for i, k in enumerate(which):
            found[i] = promised_step(self.walls, self.unit[k], metric[i], force[i])[1]
        return found

    def _bend(self, which: IndexArray, damped: Floats, weighted: Floats, tangents: Floats, step: Floats) -> Floats:
        """Half the acceleration of each trial step, where it is smaller than the step."""
        ahead = np.clip(self.unit[which][:, None] + AHEAD * step, 0.0, 1.0)
        errors, wide = self._simulated(ahead)
        rise = (wide - self.wide[which][:, None]) / AHEAD
        second = 2.0 / AHEAD * (rise - step @ tangents)
        second = np.where(np.isfinite(errors).all(axis=2, keepdims=True), second, 0.0)
        pull = -np.einsum("kdm,ktm->ktd", weighted, second)
        bend = np.linalg.solve(damped, pull[..., None])[..., 0]
        if self.held is not None:
            for column in self.held[which].T:
                bend[np.arange(len(which)), :, column] = 0.0
        share = np.linalg.norm(bend, axis=-1) / np.maximum(np.linalg.norm(step, axis=-1), 1e-300)
        return np.asarray(np.where(share < MOST_BEND, 0.5, 0.0)[..., None] * bend)

    def _inside(self, which: IndexArray, damped: Floats, step: Floats) -> Floats:
        """Ends of trial steps (k, trials, d), bent along the walls that they would break."""
        start = self.unit[which]
        ends = start[:, None] + step
        for i, t in zip(*np.nonzero(~self.walls.keep(ends)), strict=True):
            free = np.arange(ends.shape[-1])
            if self.held is not None:
                free = np.delete(free, self.held[which[i]])
            least = np.minimum(self.walls.floor - self.walls.rows @ start[i], 0.0)
            own = damped[i, t][np.ix_(free, free)]
            ends[i, t] = start[i]
            ends[i, t, free] += constrained_step(own, step[i, t][free], self.walls.rows[:, free], least)
        k, trials, d = ends.shape
        anchors = np.repeat(start, trials, axis=0)
        return self.walls.within(anchors, ends.reshape(-1, d)).reshape(k, trials, d)

    def _try(self, which: IndexArray, damped: Floats, step: Floats, tolerance: float) -> None:
        """Take the best trial step of each ascent, if any is better."""
        ends = self._inside(which, damped, step)
        errors, wide = self._simulated(ends)
        costs = self._cost(wide)
        best, rows = costs.argmin(axis=1), np.arange(len(which))
        fall = self.cost[which] - costs[rows, best]
        better = fall > 0.0
        own, taken = which[better], (rows[better], best[better])
        self.unit[own], self.errors[own], self.wide[own] = ends[taken], errors[taken], wide[taken]
        self.cost[own], self.slopes[own] = costs[taken], np.nan
        factor = np.where(better, DAMPINGS[best], 3.0 * DAMPINGS[-1])
        self.damping[which] = np.clip(self.damping[which] * factor, WEAKEST, STRONGEST)
        self.small[which] = np.where(better & (fall < tolerance), self.small[which] + 1, 0)
        self.live[which] = (self.small[which] < 2) & (self.damping[which] < STRONGEST)


def climb(
    likelihood: Likelihood,
    unit: Floats,
    held: IndexArray | None = None,
    *,
    errors: Floats | None = None,
    slopes: Floats | None = None,
    turns: int = 25,
    tolerance: float = 1e-2,
) -> Ascent:
    """Ascend from positions to the most likely values that each leads to.

    Parameters
    ----------
    likelihood : Likelihood
        With its noise.
    unit : (k, d)
        Positions between the bounds, within the constraints.
    held : (k,) or (k, h), optional
        Parameters that each ascent leaves where they are.
    errors : (k, n), optional
        Residuals at the positions, if they are known.
    slopes : (k, d, n), optional
        Their one-sided derivatives, as those of `Ascent`.
    turns : int
        Largest number of steps.
    tolerance : float
        Fall of −2 ln L that counts as none: where the linear model promises no more, or two steps in a row bring no
        more, an ascent ends.
    """
    climber = _Climber(likelihood, unit, held, errors, slopes)
    for _ in range(turns):
        if not climber.live.any():
            break
        climber.turn(tolerance)
    return Ascent(climber.unit, climber.cost, climber.errors, climber.slopes)


def promised_step(walls: Walls, unit: Floats, metric: Floats, force: Floats) -> tuple[Floats, float]:
    """Best step z (d,) within the walls of a linear model, and the fall 2 force·z − z·metric z of the cost by it.

    Parameters
    ----------
    walls : Walls
    unit : (d,)
        Position that the step begins at.
    metric : (d, d)
    force : (d,)
    """
    own = metric + (np.diag(metric).max() * 1e-10 + 1e-300) * np.eye(len(force))
    least = np.minimum(walls.floor - walls.rows @ unit, 0.0)
    z = constrained_step(own, np.linalg.solve(own, force), walls.rows, least)
    return z, float(2.0 * force @ z - z @ own @ z)


def _hold(metric: Floats, force: Floats, held: IndexArray) -> None:
    """Decouple the parameters that each ascent holds, in place."""
    rows = np.arange(len(held))
    for column in held.T:
        force[rows, column] = 0.0
        metric[rows, column] = 0.0
        metric[rows, :, column] = 0.0
        metric[rows, column, column] = 1.0


def _diagonal(values: Floats) -> Floats:
    """Diagonal matrices (k, d, d) of values (k, d)."""
    return np.asarray(values[:, :, None] * np.eye(values.shape[1]))
