"""Local polish by bounded non-linear least squares, and the choice of diverse members to start from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arrays import Floats, IndexArray
from commonrail.calibration.optimisers.bounded_least_squares import Ended, Limits, within_unit_box
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError

__all__ = ["LeastSquares", "LeastSquaresSettings", "Polished", "diverse_members"]

Residuals = Callable[[Floats], Floats]
"""Residuals (n, m) of points (n, d) in SI, all simulated as one batch; failed rows not finite."""


@dataclass(frozen=True)
class LeastSquaresSettings:
    """Settings of `LeastSquares`.

    Parameters
    ----------
    step : float
        Forward difference in unit coordinates, so relative to each parameter's range (on a
        logarithmic scale: of its logarithm). 1e-4 of a range moves a residual well above the
        rounding of a simulation; raise it where the objective is noisy.
    residual_scale : float
        Residual beyond which the loss (soft L1) grows linearly; 1 suits residuals divided by
        their standard deviations. Infinite for squares, of residuals that know their own loss.
    failed_residual : float
        Finite value that stands for every residual of a failed simulation.
    constraint_weight : float
        Residual for a constraint broken by all that its row can vary by within the bounds. The
        loss bends at one residual scale, so weights far above 100 make a kink to creep along.
    iterations : int
        Steps tried from each start, at most.
    tolerance : float
        Relative change of cost, or of the point, below which a start is done.

    Raises
    ------
    ConfigurationError
        If a number is not greater than zero, or `step` is above 0.5.
    """

    step: float = 1e-4
    residual_scale: float = 1.0
    failed_residual: float = 1e4
    constraint_weight: float = 1e2
    iterations: int = 50
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            finite = np.isfinite(value) or name == "residual_scale"
            if not (finite and value > 0.0):
                raise ConfigurationError(f"{name} = {value:g} must be a number greater than zero")
        if self.step > 0.5:
            raise ConfigurationError(f"step = {self.step:g} must not exceed half of the range, 0.5")


class Polished(NamedTuple):
    """End of one start.

    `x` (d,) satisfies the space; `cost` is half the sum of the soft-L1 losses there (+inf if even the start failed);
    `pulled_back` tells that the end broke a constraint and was replaced; `reason` is why it stopped.
    """

    x: Floats
    cost: float
    pulled_back: bool
    reason: str


class LeastSquares:
    """Least squares within bounds, with soft-L1 loss: SciPy's trust-region reflective method, or `within_unit_box`.

    The search moves in unit coordinates. The Jacobian takes one batch of d simulations, forward
    differences that turn backward at an upper bound. Neighbours that fail are tried once on the
    other side, in one more batch; where both sides fail, that parameter rests for one step.

    Linear constraints enter as additional residuals, zero where they hold. If the end breaks one
    nonetheless, it is pulled back to the last feasible point on the segment from its start, and
    the start itself is returned where that is no worse.

    Parameters
    ----------
    space : Space
        Parameters, bounds, constraints.
    residuals : callable
        Residuals (n, m) of points (n, d), SI, as one batch; rows of failed simulations hold a
        value that is not finite.
    settings : LeastSquaresSettings, optional
    same_bits : bool
        Take the method whose bits do not depend on the processor.
    """

    def __init__(
        self,
        space: Space,
        residuals: Residuals,
        settings: LeastSquaresSettings | None = None,
        same_bits: bool = False,
    ) -> None:
        self.space, self.same_bits = space, same_bits
        self.residuals = residuals
        self.settings = settings or LeastSquaresSettings()

    def run(self, start: Floats) -> Polished:
        """Polish a start (d,), SI.

        Raises
        ------
        ConfigurationError
            If it does not satisfy the space.
        """
        if not self.space.satisfies(start):
            raise ConfigurationError("start: it breaks the bounds or a constraint, choose a feasible one")
        batch = _Batch(self.space, self.residuals, self.settings)
        found = (self._in_stated_order if self.same_bits else self._by_scipy)(batch, self.space.to_unit(start))
        x = self.space.from_unit(np.clip(found.x, 0.0, 1.0))
        inside = self.space.pull_back(start[None, :], x[None, :])[0]
        pulled_back = not np.array_equal(inside, x)
        choice, cost = self._better(batch, start, inside)
        return Polished(choice, cost, pulled_back, str(found.message))

    def _in_stated_order(self, batch: _Batch, unit: Floats) -> Ended:
        s = self.settings
        return within_unit_box(batch.values, batch.jacobian, unit, Limits(s.residual_scale, s.tolerance, s.iterations))

    def _by_scipy(self, batch: _Batch, unit: Floats) -> Ended:
        from scipy.optimize import least_squares  # slow to import

        scale = self.settings.residual_scale
        found = least_squares(
            batch.values,
            unit,
            jac=batch.jacobian,
            bounds=(0.0, 1.0),
            method="trf",
            loss="soft_l1" if np.isfinite(scale) else "linear",
            f_scale=scale if np.isfinite(scale) else 1.0,
            x_scale=1.0,  # unit coordinates are scaled already
            ftol=self.settings.tolerance,
            xtol=self.settings.tolerance,
            max_nfev=self.settings.iterations,
        )
        return Ended(found.x, str(found.message))

    def _better(self, batch: _Batch, start: Floats, end: Floats) -> tuple[Floats, float]:
        """The cheaper of start and end, both feasible, and its cost."""
        values = batch.simulate(np.stack([start, end]))
        costs = np.where(np.isfinite(values).all(axis=1), self._cost(values), np.inf)
        winner = int(np.argmin(costs))
        return (start, end)[winner].copy(), float(costs[winner])

    def _cost(self, values: Floats) -> Floats:
        """Half the sum (n,) of the soft-L1 losses of residuals (n, m), or of their squares."""
        scale = self.settings.residual_scale
        if np.isinf(scale):
            return np.asarray(0.5 * np.sum(values**2, axis=1))
        return np.asarray(scale**2 * (np.sqrt(1.0 + (values / scale) ** 2) - 1.0).sum(axis=1))


@dataclass
class _Batch:
    """Residuals and Jacobian in unit coordinates."""

    space: Space
    residuals: Residuals
    settings: LeastSquaresSettings
    _last: tuple[Floats, Floats] | None = field(default=None, repr=False)

    def simulate(self, x: Floats) -> Floats:
        """Residuals (n, m) of points (n, d), as given by the caller."""
        values = np.asarray(self.residuals(x), dtype=float)
        if values.ndim != 2 or len(values) != len(x):
            raise ConfigurationError(
                f"residuals: an array of shape {values.shape} came back for {len(x)} candidates, "
                "expected one row for each"
            )
        return values

    def values(self, unit: Floats) -> Floats:
        """Residuals (m + constraints,) at one point (d,), finite even if the simulation failed."""
        x = self.space.from_unit(unit)
        simulated = self.simulate(x[None, :])[0]
        if not np.isfinite(simulated).all():
            simulated = np.full_like(simulated, self.settings.failed_residual)
        value = np.concatenate([simulated, self._broken(x)])
        self._last = (unit.copy(), value)
        return value

    def jacobian(self, unit: Floats) -> Floats:
        """Derivatives (m + constraints, d): one batch of differences, and one of those to redo."""
        base = self._value_at(unit)
        step = np.where(unit + self.settings.step <= 1.0, 1.0, -1.0) * self.settings.step
        slopes = self._slopes(unit, base, np.diag(step))
        other = unit - step
        redo = ~np.isfinite(slopes).all(axis=1) & (other >= 0.0) & (other <= 1.0)
        if redo.any():
            slopes[redo] = self._slopes(unit, base, np.diag(-step)[redo])
        return np.where(np.isfinite(slopes).all(axis=1, keepdims=True), slopes, 0.0).T

    def _slopes(self, unit: Floats, base: Floats, steps: Floats) -> Floats:
        """Difference quotients (k, m + constraints) along `steps` (k, d), one parameter each."""
        x = self.space.from_unit(unit + steps)
        values = np.hstack([self.simulate(x), self._broken(x)])
        return np.asarray((values - base) / steps.sum(axis=1, keepdims=True))

    def _value_at(self, unit: Floats) -> Floats:
        """Residuals at a point, taken from the last evaluation where it was the same point."""
        if self._last is not None and np.array_equal(self._last[0], unit):
            return self._last[1]
        return self.values(unit)

    def _broken(self, x: Floats) -> Floats:
        """Residuals (..., constraints) for broken constraints."""
        return self.settings.constraint_weight * self.space.shortfall(x)


def diverse_members(unit: ArrayLike, costs: ArrayLike, n: int) -> IndexArray:
    """Choose members of low cost that lie far apart, the best one first.

    From the better half of the members with a finite cost (at least `n` of them), each further
    choice is the one farthest from those chosen already.

    Parameters
    ----------
    unit : (k, d) array
        Members in unit coordinates (`Space.to_unit`).
    costs : (k,) array
        Their costs.
    n : int
        How many to choose; fewer come back if fewer distinct ones have a finite cost.

    Returns
    -------
    (<= n,) array of int
        Rows of the chosen members.
    """
    points, cost = np.asarray(unit, dtype=float), np.asarray(costs, dtype=float)
    order = np.argsort(cost, kind="stable")
    order = order[np.isfinite(cost[order])]
    pool = order[: max(n, (len(order) + 1) // 2)]
    return np.array(_spread(points[pool], min(n, len(pool)), pool.tolist()), dtype=np.intp)


def _spread(points: Floats, n: int, names: Sequence[int]) -> list[int]:
    """Names of up to n of the points (k, d), the first one first, each farthest from the rest."""
    chosen: list[int] = []
    distance = np.full(len(points), np.inf)
    while len(chosen) < n:
        row = int(np.argmax(distance))
        if distance[row] == 0.0:
            break
        chosen.append(names[row])
        distance = np.minimum(distance, np.linalg.norm(points - points[row], axis=1))
    return chosen
