"""Optimiser that draws feasible points at random: `[optimiser] method = "random search"` in a study."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.calibration.optimisers.base import Best, Optimiser, Registered, Trials
from commonrail.calibration.space import Space, sample_feasible


@dataclass(frozen=True)
class RandomSettings:
    """Settings, which are keys of the study's table: points of a step, and steps after the first one."""

    members: int = 20
    generations: int = 50


class RandomSearch(Optimiser):
    """Search that keeps the best of all points drawn."""

    method, phase = "random search", "draws"

    def __init__(self, space: Space, rng: np.random.Generator, settings: RandomSettings) -> None:
        super().__init__(space, rng)
        self.settings = settings
        self._kept_best = Best(space.centre.copy(), np.inf)
        self._x, self._costs = np.empty((0, space.dimension)), np.empty(0)  # of the last step

    @property
    def total(self) -> int:
        """Steps wanted."""
        return 1 + self.settings.generations

    @property
    def _ended(self) -> str:
        return "all points are drawn"

    @property
    def best(self) -> Best:
        """The best point so far."""
        return self._kept_best

    @property
    def population(self) -> Floats:
        """Points of the last step."""
        return self._x.copy()

    @property
    def costs(self) -> Floats:
        """Their costs."""
        return self._costs.copy()

    def _origin(self) -> dict[str, Any]:
        return super()._origin() | self._settings(self.settings)

    def _propose(self) -> Trials:
        x = sample_feasible(self.space, self.settings.members, self._rng)
        return Trials(x, np.ones(len(x), bool))

    def _take(self, trials: Trials, told: Floats) -> None:
        self._x, self._costs = trials.x, told
        winner = int(np.argmin(told))
        if told[winner] < self._kept_best.cost:
            self._kept_best = Best(trials.x[winner], float(told[winner]))

    def _kept(self) -> dict[str, Any]:
        return {"x": self._x, "costs": self._costs, "best": self._kept_best.x, "cost": self._kept_best.cost}

    def _restore(self, state: Mapping[str, Any]) -> None:
        self._x, self._costs = np.array(state["x"], float), np.array(state["costs"], float)
        self._kept_best = Best(np.array(state["best"], float), float(state["cost"]))


REGISTERED = Registered(RandomSearch, RandomSettings)
