"""Members of a population with their costs: the best of them, and their part of a state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arrays import Floats, IndexArray
from commonrail.calibration.optimisers.base import Best
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError

MOST_MEMBERS = 100_000  # far above what anybody calibrates; below what would fill the memory


class Members(NamedTuple):
    """Points (n, d) in unit coordinates and their costs (n,), +inf where a simulation failed."""

    unit: Floats
    costs: Floats

    @classmethod
    def none(cls, dimension: int) -> Members:
        """No members."""
        return cls(np.empty((0, dimension)), np.empty(0))

    def best(self, space: Space) -> Best:
        """The cheapest member; the centre of the space, at +inf, where none has succeeded."""
        if not np.isfinite(self.costs).any():
            return Best(space.centre.copy(), np.inf)
        winner = int(np.argmin(self.costs))
        return Best(space.from_unit(self.unit[winner]), float(self.costs[winner]))

    def sorted(self) -> Members:
        """The same members by rising cost."""
        order = np.argsort(self.costs, kind="stable")
        return Members(self.unit[order], self.costs[order])

    def kept(self) -> dict[str, Any]:
        """Part of a state."""
        return {"unit": self.unit.copy(), "costs": self.costs.copy()}

    @classmethod
    def of(cls, state: Mapping[str, Any], dimension: int) -> Members:
        """Members from their part of a state.

        Raises
        ------
        ConfigurationError
            If they are not whole, lie outside the bounds or have costs that are no numbers.
        """
        unit, costs = (np.array(state[name], dtype=float) for name in ("unit", "costs"))
        if unit.shape != (len(costs), dimension):
            raise ConfigurationError("state: its population is not whole; take a whole state")
        inside = np.all(np.abs(unit - 0.5) <= 0.5 + 1e-9)  # to unit coordinates and back rounds
        if not inside or np.isnan(costs).any():
            raise ConfigurationError("state: its population lies outside the bounds or has costs that are no numbers")
        return cls(unit, costs)


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
    return np.asarray(pool[farthest(points[pool], min(n, len(pool)))])


def farthest(points: Floats, n: int) -> IndexArray:
    """Rows of up to n distinct ones of the points (k, d), the first one first, each farthest from those before."""
    chosen: list[int] = []
    distance = np.full(len(points), np.inf)
    while len(chosen) < n:
        row = int(np.argmax(distance))
        if distance[row] == 0.0:
            break
        chosen.append(row)
        distance = np.minimum(distance, np.linalg.norm(points - points[row], axis=1))
    return np.array(chosen, dtype=np.intp)
