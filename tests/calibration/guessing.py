"""An optimiser that only guesses: the least that conforms, and what a new one has to be written for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from commonrail.calibration.optimisers.base import Optimiser, Registered, Work, asked
from commonrail.calibration.space import sample_feasible

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
    ended = "all guesses are made"

    def _step(self) -> Work:
        x = self.guesses()
        costs = yield asked(x)
        self.take(x, costs)

    def guesses(self) -> np.ndarray:
        """Points of a step."""
        x = sample_feasible(self.space, self.settings.members, self._rng)
        x += self.settings.middle * (self.space.centre - x)
        return x

    def take(self, x: np.ndarray, costs: np.ndarray) -> None:
        """Take the points of a step with their costs."""
        self.population, self.costs = x, costs
        self._offer(x, costs)

    def _kept(self) -> dict[str, Any]:
        return {"x": self.population, "costs": self.costs}

    def _restore(self, state: Mapping[str, Any]) -> None:
        self.population, self.costs = np.array(state["x"]), np.array(state["costs"])


GUESSING = Registered(Guessing, GuessingSettings)
