"""Least-squares refinements of what another optimiser has found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.calibration.optimisers.base import (
    SMALL_GAIN,
    Optimiser,
    Question,
    Work,
    asked,
    diverse_members,
    hop,
    noise_of,
)
from commonrail.calibration.optimisers.least_squares import Descents, LossSum, Rules, advance, recognised
from commonrail.calibration.space import Space

SHORTER = 6  # times that a hop to where nothing can be simulated is halved
DIFFERENCE = 1e-2  # share of a range: a smaller step measures the ripple of bouncing valves and needles


@dataclass(frozen=True)
class RefinementSettings:
    """Number of refinements, and of iterations of each at most."""

    refinements: int
    iterations: int

    @property
    def members(self) -> int:
        """Points that go on at once."""
        return 1

    @property
    def generations(self) -> int:
        """Steps."""
        return self.refinements


class Refinement(Optimiser):
    """Least squares from good members of a finished search that lie apart, then from hops near the best.

    A third of the refinements start from members. The end of each is judged by the objective itself, and is the new
    best where that falls. Each is one step: `state` knows nothing of one that is half done.

    `seed`: of the hops; `before`: the finished search; its population and best are refined.
    """

    method, phase = "least-squares refinement", "refinement"

    def __init__(self, space: Space, seed: int, settings: RefinementSettings, before: Optimiser) -> None:
        population, costs = before.population, before.costs
        usable = np.isfinite(costs) & space.satisfies(population)
        members = population[usable]
        count = min(max(settings.refinements // 3, 1), len(members))
        super().__init__(space, np.random.default_rng([seed, count]), settings)
        self.population, self.costs, self.best = population, costs, before.best
        self._starts = members[diverse_members(space.to_unit(members), costs[usable], count)]
        self.end_costs: Floats = np.empty(0)  # costs of the ends

    @property
    def total(self) -> int:
        """Refinements wanted; none of a search in which nothing could be simulated."""
        return int(self.settings.refinements) if np.isfinite(self.best.cost) else 0

    @property
    def reason(self) -> str:
        """Reason for the end; empty before it."""
        return f"all {self.total} refinements are done" if self.finished else ""

    def _step(self) -> Work:
        """A descent from a member or a hop, nearer the best where nothing can be simulated there."""
        space = self.space
        hops = self.steps >= len(self._starts)
        start = hop(space, self.best.x, self._rng) if hops else self._starts[self.steps]
        residuals = yield asked(start[None, :], Question.RESIDUALS)
        for _ in range(SHORTER):
            if np.isfinite(residuals).all():
                break
            middle = space.from_unit(0.5 * (space.to_unit(start) + space.to_unit(self.best.x)))
            start = middle if space.satisfies(middle) else space.pull_back(self.best.x, middle)
            residuals = yield asked(start[None, :], Question.RESIDUALS)
        costs = yield asked(start[None, :], Question.COSTS_AGAIN)
        descent = Descents.begin(space.to_unit(start)[None, :], residuals)
        loss = recognised(costs, residuals)
        for _ in range(self.settings.iterations):
            if not descent.running.any():
                break
            losses = LossSum.near(loss, descent.residuals[0])
            noise = noise_of(float(losses.costs(descent.residuals)[0]), residuals.shape[1], space.dimension, loss.units)
            descent = yield from advance(space, descent, losses, Rules(DIFFERENCE, SMALL_GAIN * noise))
        x = space.from_unit(descent.unit)
        costs = yield asked(x, Question.COSTS_AGAIN)
        self.end_costs = np.append(self.end_costs, costs[0])
        self._offer(x, costs)

    def _origin(self) -> dict[str, Any]:
        return super()._origin() | {"settings": []}  # a search that resumes may want other refinements

    def _kept(self) -> dict[str, Any]:
        return {"ends": self.end_costs.copy()}

    def _restore(self, state: Mapping[str, Any]) -> None:
        self.end_costs = np.array(state["ends"], dtype=float)
