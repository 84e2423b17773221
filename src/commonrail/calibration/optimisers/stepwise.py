"""Optimisers whose steps are written as generators: questions are yielded, answers are sent in."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.calibration.optimisers.base import Best, Counts, Optimiser, Settings, Trials, Wanted
from commonrail.calibration.space import Space

Work = Generator[Trials, Floats, None]

HOP = 0.06  # standard deviation of a hop away from the best, as a share of each range


class Stepwise(Optimiser):
    """An optimiser that keeps its best point and writes a step as one generator.

    Parameters
    ----------
    space : Space
    rng : numpy.random.Generator
        Source of every draw.
    settings : Settings
    """

    def __init__(self, space: Space, rng: np.random.Generator, settings: Settings) -> None:
        super().__init__(space, rng)
        self._stated = settings
        self._best = Best(space.centre.copy(), np.inf)
        self._work: Work | None = None

    @property
    def total(self) -> int:
        """Steps wanted, the first one included."""
        return 1 + self._stated.generations

    @property
    def _ended(self) -> str:
        return f"all {self._stated.generations} steps after the first one are done"

    @property
    def best(self) -> Best:
        """The best point whose cost is known; the centre of the space, at +inf, until one has succeeded."""
        return self._best

    @abstractmethod
    def _step(self) -> Work:
        """One step, from its first question to its end."""

    def _propose(self) -> Trials:
        """First question of a step."""
        self._work = self._step()
        return next(self._work)

    def _take(self, trials: Trials, told: Floats) -> Trials | None:
        """Next question of the step, if it has one; what it has found is kept at its end."""
        assert self._work is not None
        try:
            following = self._work.send(told)
        except StopIteration:
            self._work = following = None
        if trials.wanted in (Wanted.RESIDUALS, Wanted.SCREENED):
            failed = int((~np.isfinite(told).all(axis=1)).sum())
            more = self.counts
            self.counts = Counts(more.slots + len(told), more.simulated + len(told), more.failed + failed)
        return following

    def _offer(self, x: Floats, costs: Floats) -> None:
        """Take the cheapest of points (n, d), SI, as the best if it is."""
        winner = int(np.argmin(costs)) if len(costs) else -1
        if winner >= 0 and costs[winner] < self._best.cost:
            self._best = Best(x[winner].copy(), float(costs[winner]))

    def _ranked(self, unit: Floats, costs: Floats) -> tuple[Best, ...]:
        """Ends (n, d) of descents, unit coordinates, by rising cost (n,); the best point stands for the first one."""
        found = [Best(x, float(cost)) for x, cost in zip(self.space.from_unit(unit), costs, strict=True)]
        ranked = sorted((end for end in found if np.isfinite(end.cost)), key=lambda end: end.cost)
        return (self._best, *ranked[1:])

    def _origin(self) -> dict[str, Any]:
        return super()._origin() | self._settings(self._stated)


def asked(x: Floats, wanted: Wanted = Wanted.COSTS) -> Trials:
    """Question about points (n, d), SI, all of which are simulated."""
    return Trials(x, np.ones(len(x), bool), wanted)


def hop(space: Space, best: Floats, rng: np.random.Generator) -> Floats:
    """A feasible point (d,) a normal step away from the best (d,), drawn back where it breaks a constraint, SI."""
    there = space.from_unit(np.clip(space.to_unit(best) + rng.normal(0.0, HOP, space.dimension), 0.0, 1.0))
    return np.asarray(space.pull_back(best[None, :], there[None, :])[0])
