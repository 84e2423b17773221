"""Least-squares refinements of what another optimiser has found."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.calibration.optimisers.base import Best, Optimiser, Trials, Wanted
from commonrail.calibration.optimisers.conversation import conversation
from commonrail.calibration.optimisers.least_squares import (
    LeastSquares,
    LeastSquaresSettings,
    Polished,
    diverse_members,
)
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError

__all__ = ["Refinement", "RefinementSettings"]


HOP = 0.06  # standard deviation of a hop away from the best, as a share of each range
SHORTER = 6  # times that a hop to where nothing can be simulated is halved

# differences over 1 % of a range: a smaller step measures the ripple of bouncing valves and needles
SOLVER = LeastSquaresSettings(step=1e-2)


class RefinementSettings(NamedTuple):
    """Number of refinements, of Jacobians of each at most, and whether their bits must not depend on the processor.

    `squares`: the residuals' squares sum to the objective, and are made small; else their soft-L1 sum is.
    """

    refinements: int
    iterations: int
    same_bits: bool = False
    squares: bool = False


class Refinement(Optimiser):
    """Least squares from good members of a finished search that lie apart, then from hops near the best.

    A third of the refinements start from members. The end of each is judged by the objective itself, and is the new
    best where that falls. Each is one step: `state` knows nothing of one that is half done.

    Parameters
    ----------
    space : Space
    seed : int
        Of the hops.
    settings : RefinementSettings
    before : Optimiser
        The finished search; its population and best are refined.
    """

    method, phase = "least-squares refinement", "refinement"

    def __init__(self, space: Space, seed: int, settings: RefinementSettings, before: Optimiser) -> None:
        population, costs = before.population, before.costs
        usable = np.isfinite(costs) & space.satisfies(population)
        members = population[usable]
        count = min(max(settings.refinements // 3, 1), len(members))
        super().__init__(space, np.random.default_rng([seed, count]))
        self.settings, self._before = settings, before
        self._starts = members[diverse_members(space.to_unit(members), costs[usable], count)]
        self._improved: Best | None = None
        self.end_costs: Floats = np.empty(0)  # costs of the ends
        self._solving: Generator[Floats, Floats, Polished] | None = None
        self._halvings: int | None = None  # left until the start is taken as it is; None once it has been simulated

    @property
    def total(self) -> int:
        """Refinements wanted; none of a search in which nothing could be simulated."""
        return self.settings.refinements if np.isfinite(self.best.cost) else 0

    @property
    def _ended(self) -> str:
        return f"all {self.total} refinements are done"

    @property
    def best(self) -> Best:
        """The best end, or what the search before had found if that is better."""
        return self._improved or self._before.best

    @property
    def population(self) -> Floats:
        """That of the search before (n, d), SI."""
        return self._before.population

    @property
    def costs(self) -> Floats:
        """Costs (n,) of that population."""
        return self._before.costs

    def _propose(self) -> Trials:
        """First points of a refinement."""
        self._halvings = SHORTER
        return self._begin(self._starts[self.steps] if self.steps < len(self._starts) else self._near_best())

    def _begin(self, start: Floats) -> Trials:
        """Start (1, d) of a refinement, which is the solver's first question."""
        scale = np.inf if self.settings.squares else SOLVER.residual_scale
        settings = replace(SOLVER, iterations=self.settings.iterations, residual_scale=scale)
        exact = self.settings.same_bits
        self._solving = conversation(lambda call: LeastSquares(self.space, call, settings, exact).run(start))
        return _trials(next(self._solving), Wanted.RESIDUALS)

    def _take(self, trials: Trials, told: Floats) -> Trials | None:
        """Go on until the solver has ended; then judge its end."""
        if self._solving is None:
            self.end_costs = np.append(self.end_costs, told[0])
            if told[0] < self.best.cost:
                self._improved = Best(trials.x[0], float(told[0]))
            return None
        halvings, self._halvings = self._halvings, None
        if halvings and not np.isfinite(told).all():  # the search would end where it began, and tell nothing
            self._halvings = halvings - 1
            return self._begin(self._nearer(trials.x[0]))
        try:
            return _trials(self._solving.send(told), Wanted.RESIDUALS)
        except StopIteration as stop:
            self._solving = None
            return _trials(stop.value.x[None, :], Wanted.COSTS_AGAIN)

    def _near_best(self) -> Floats:
        """A feasible point (d,) some hops of the bounds' width away from the best."""
        space, best = self.space, self.best.x
        hop = self._rng.normal(0.0, HOP, space.dimension)
        return self._feasible(np.clip(space.to_unit(best) + hop, 0.0, 1.0))

    def _nearer(self, start: Floats) -> Floats:
        """A feasible point (d,) half as far from the best as a start."""
        space = self.space
        return self._feasible(0.5 * (space.to_unit(start) + space.to_unit(self.best.x)))

    def _feasible(self, unit: Floats) -> Floats:
        """The point (d,) at unit coordinates, drawn towards the best where it breaks a constraint."""
        there = self.space.from_unit(unit)
        return there if self.space.satisfies(there) else self.space.pull_back(self.best.x, there)

    def _kept(self) -> dict[str, Any]:
        best, cost = self._improved or (None, None)
        return {"best": best, "cost": cost, "ends": self.end_costs.copy()}

    def _restore(self, state: Mapping[str, Any]) -> None:
        self._solving = self._improved = None
        self.end_costs = np.array(state["ends"], dtype=float)
        best, cost = state["best"], state["cost"]
        if best is None:
            return
        found, space = Best(np.array(best, dtype=float), float(cost)), self.space
        slack = 1e-9 * (space.upper - space.lower)
        inside = (found.x >= space.lower - slack) & (found.x <= space.upper + slack)
        if inside.shape != slack.shape or not inside.all() or not np.isfinite(found.cost):
            raise ConfigurationError("state: its best point lies outside the bounds or has no cost; take a whole state")
        self._improved = found


def _trials(x: Floats, wanted: Wanted) -> Trials:
    return Trials(x, np.ones(len(x), bool), wanted)
