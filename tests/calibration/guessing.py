"""An optimiser that only guesses: the least that conforms, and what a new one has to be written for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from commonrail.calibration.optimisers.base import Best, Optimiser, Registered, Trials
from commonrail.calibration.space import Space, sample_feasible

__all__ = ["GUESSING", "Guessing", "GuessingSettings"]


@dataclass(frozen=True)
class GuessingSettings:
    """Guesses in each step, steps after the first one, and how much they keep to the middle."""

    members: int = 6
    generations: int = 5
    middle: float = 0.0


class Guessing(Optimiser):
    """Feasible guesses."""

    method, phase = "guessing", "guesses"

    def __init__(self, space: Space, rng: np.random.Generator, settings: GuessingSettings) -> None:
        super().__init__(space, rng)
        self.settings = settings
        self._x, self._costs = np.empty((0, space.dimension)), np.empty(0)
        self._best = Best(np.array(space.centre), np.inf)

    @property
    def total(self) -> int:
        """Steps wanted."""
        return 1 + self.settings.generations

    @property
    def _ended(self) -> str:
        return "all guesses are made"

    @property
    def best(self) -> Best:
        """The best guess."""
        return self._best

    @property
    def population(self) -> np.ndarray:
        """Guesses of the last step."""
        return self._x.copy()

    @property
    def costs(self) -> np.ndarray:
        """Their costs."""
        return self._costs.copy()

    def _propose(self) -> Trials:
        x = sample_feasible(self.space, self.settings.members, self._rng)
        x += self.settings.middle * (self.space.centre - x)
        return Trials(x, np.ones(len(x), bool))

    def _take(self, trials: Trials, told: np.ndarray) -> None:
        self._x, self._costs = trials.x, told
        winner = int(np.argmin(told))
        if told[winner] < self._best.cost:
            self._best = Best(trials.x[winner], float(told[winner]))

    def _kept(self) -> dict[str, Any]:
        return {"x": self._x, "costs": self._costs, "best": self._best.x, "cost": self._best.cost}

    def _restore(self, state: Mapping[str, Any]) -> None:
        self._x, self._costs = np.array(state["x"]), np.array(state["costs"])
        self._best = Best(np.array(state["best"]), float(state["cost"]))


GUESSING = Registered(Guessing, GuessingSettings)
