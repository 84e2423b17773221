"""Optimiser that draws feasible points at random: `[optimiser] method = "random search"` in a study."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from commonrail.calibration.optimisers.base import Optimiser, Registered, Work, asked
from commonrail.calibration.space import sample_feasible


@dataclass(frozen=True)
class RandomSettings:
    """Settings, which are keys of the study's table: points of a step, and steps after the first one."""

    members: int = 20
    generations: int = 50


class RandomSearch(Optimiser):
    """Search that keeps the best of all points drawn."""

    method, phase = "random search", "draws"
    ended = "all points are drawn"

    def _step(self) -> Work:
        x = sample_feasible(self.space, self.settings.members, self._rng)
        costs = yield asked(x)
        self.population, self.costs = x, costs
        self._offer(x, costs)

    def _kept(self) -> dict[str, Any]:
        return {"x": self.population.copy(), "costs": self.costs.copy()}

    def _restore(self, state: Mapping[str, Any]) -> None:
        self.population, self.costs = np.array(state["x"], float), np.array(state["costs"], float)


REGISTERED = Registered(RandomSearch, RandomSettings)
