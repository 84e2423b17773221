"""L-SHADE: differential evolution that learns F and CR from its successes, with a population that shrinks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from commonrail.arguments import settle, whole
from commonrail.arrays import Floats, IndexArray
from commonrail.calibration.optimisers.base import MOST_GENERATIONS, Best
from commonrail.calibration.optimisers.members import MOST_MEMBERS, Members
from commonrail.calibration.optimisers.stepwise import Stepwise, Work, asked
from commonrail.calibration.optimisers.treatments import Treatment, treat
from commonrail.calibration.sampling import sample_feasible
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError

__all__ = ["SuccessHistoryEvolution", "SuccessHistorySettings"]


# Values of Tanabe and Fukunaga (2014).
MEMORY = 6
BEST_SHARE = 0.11  # of the members, from which a trial takes its direction
ARCHIVE = 2.6  # members that were replaced and are kept, for each member
SPREAD = 0.1  # of F and CR about their memory
FEWEST = 4


@dataclass(frozen=True)
class SuccessHistorySettings:
    """Settings of `SuccessHistoryEvolution`.

    Parameters
    ----------
    members : int
        Members at the beginning, at least 4.
    generations : int
        Generations after the initial population.
    shrinking : int
        Generations over which the population shrinks linearly to 4 members; 0 for a constant one.

    Raises
    ------
    ConfigurationError
        If a number lies outside its range, or is not whole.
    """

    size: ClassVar[str] = "{generations} generations of {members} members at first"  # in words, of a report

    # "most" is what a study file may ask for
    members: int = field(default=96, metadata={"most": MOST_MEMBERS})
    generations: int = field(default=70, metadata={"most": MOST_GENERATIONS})
    shrinking: int = field(default=70, metadata={"most": MOST_GENERATIONS})

    def __post_init__(self) -> None:
        settle(
            self,
            members=whole(self.members, "members", FEWEST, MOST_MEMBERS),
            generations=whole(self.generations, "generations", 0, MOST_GENERATIONS),
            shrinking=whole(self.shrinking, "shrinking", 0, MOST_GENERATIONS),
        )


class SuccessHistoryEvolution(Stepwise):
    """L-SHADE of Tanabe and Fukunaga (2014): current-to-pbest/1/bin with an archive and a memory of F and CR.

    The population shrinks over `shrinking` generations and not over those that are wanted, so that a search that is
    extended takes the same steps as one that was longer from the beginning. Trials that break bounds or constraints are
    repaired as those of `DifferentialEvolution` are by default.

    Parameters
    ----------
    space : Space
    rng : numpy.random.Generator
        Source of every draw.
    settings : SuccessHistorySettings, optional
    """

    method, phase = "L-SHADE", "evolution"

    def __init__(self, space: Space, rng: np.random.Generator, settings: SuccessHistorySettings | None = None) -> None:
        self.settings = settings or SuccessHistorySettings()
        super().__init__(space, rng, self.settings)
        self._members = Members.none(space.dimension)
        self._archive = np.empty((0, space.dimension))
        self._memory = np.full((2, MEMORY), 0.5)  # F, CR; a CR below 0 has become 0 for good
        self._next = 0

    @property
    def best(self) -> Best:
        """The best member."""
        return self._members.best(self.space)

    @property
    def population(self) -> Floats:
        """Members (n, d), SI."""
        return self.space.from_unit(self._members.unit)

    @property
    def costs(self) -> Floats:
        """Costs (n,) of the members."""
        return self._members.costs.copy()

    def _step(self) -> Work:
        """Draws at first, then one trial for each member: select, learn from the successes, and shrink."""
        if self.steps == 0:
            x = sample_feasible(self.space, self.settings.members, self._rng)
            self._members = Members(np.clip(self.space.to_unit(x), 0.0, 1.0), (yield asked(x)))
            return
        unit, costs = self._members
        drawn = self._factors(len(costs))

        def redraw(members: IndexArray) -> Floats:
            return self._mutants(members, *drawn[:, members])[:, None]

        trial = treat(Treatment.REPAIR, self.space, unit, self._mutants(np.arange(len(costs)), *drawn), redraw)
        told = yield asked(trial.x)
        better, wins = told < costs, np.isfinite(told) & (told <= costs)
        before = np.where(np.isfinite(costs), costs, told.max(initial=0.0, where=better))
        self._learn(drawn[:, better], (before - told)[better])
        self._archive = np.vstack([self._archive, unit[better]])
        self._members = self._shrunk(Members(np.where(wins[:, None], trial.unit, unit), np.where(wins, told, costs)))
        most = round(ARCHIVE * len(self._members.costs))
        if len(self._archive) > most:
            self._archive = self._archive[np.sort(self._rng.permutation(len(self._archive))[:most])]

    def _factors(self, count: int) -> Floats:
        """F (Cauchy, in (0, 1]) and CR (Gauss, in [0, 1]) about random entries of the memory, (2, count)."""
        rows = self._rng.integers(0, MEMORY, count)
        factor = np.zeros(count)
        for _ in range(100):
            low = factor <= 0.0
            if not low.any():
                break
            factor[low] = self._memory[0, rows[low]] + SPREAD * self._rng.standard_cauchy(int(low.sum()))
        factor = np.where(factor <= 0.0, self._memory[0, rows], np.minimum(factor, 1.0))
        rate = np.clip(self._memory[1, rows] + SPREAD * self._rng.standard_normal(count), 0.0, 1.0)
        return np.stack([factor, np.where(self._memory[1, rows] < 0.0, 0.0, rate)])

    def _mutants(self, chosen: IndexArray, factor: Floats, rate: Floats) -> Floats:
        """Raw trials (k, d) of chosen members (k,) with their F and CR (k,)."""
        members, rng = self._members.sorted(), self._rng
        unit, k, n = self._members.unit, len(chosen), len(members.costs)
        leaders = members.unit[rng.integers(0, max(round(BEST_SHARE * n), 2), k)]
        first = (chosen + rng.integers(1, n, k)) % n  # another member
        pool = np.vstack([unit, self._archive])
        second = rng.integers(0, len(pool) - 2, k)  # neither of the two
        for taken in np.sort(np.stack([chosen, first]), axis=0):
            second += second >= taken
        f = factor[:, None]
        mutants = unit[chosen] + f * (leaders - unit[chosen]) + f * (unit[first] - pool[second])
        kept = rng.random(mutants.shape) <= rate[:, None]
        kept[np.arange(k), rng.integers(0, mutants.shape[1], k)] = True
        return np.where(kept, mutants, unit[chosen])

    def _learn(self, successful: Floats, gains: Floats) -> None:
        """Write the Lehmer means of the successful F and CR (2, k), weighted by their gains (k,), into the memory."""
        if not len(gains):
            return
        weights = np.maximum(gains, 1e-300)
        weights = weights / np.sum(weights)
        for row, drawn in enumerate(successful):
            ended = row == 1 and (self._memory[1, self._next] < 0.0 or not drawn.max() > 0.0)
            mean = -1.0 if ended else np.sum(weights * drawn * drawn) / np.sum(weights * drawn)
            self._memory[row, self._next] = mean
        self._next = (self._next + 1) % MEMORY

    def _shrunk(self, members: Members) -> Members:
        """The best members, as many as this generation leaves."""
        if not self.settings.shrinking:
            return members
        share = min(self.steps / self.settings.shrinking, 1.0)
        count = round(self.settings.members + share * (FEWEST - self.settings.members))
        if count >= len(members.costs):
            return members
        best = members.sorted()
        return Members(best.unit[:count], best.costs[:count])

    def _kept(self) -> dict[str, Any]:
        own = {"archive": self._archive.copy(), "memory": self._memory.copy(), "next": self._next}
        return self._members.kept() | own

    def _restore(self, state: Mapping[str, Any]) -> None:
        members = Members.of(state, self.space.dimension)
        archive, memory = np.array(state["archive"], dtype=float), np.array(state["memory"], dtype=float)
        if archive.shape[1:] != (self.space.dimension,) or memory.shape != (2, MEMORY):
            raise ConfigurationError("state: its archive or memory is not whole; take a whole state")
        self._members, self._archive, self._memory, self._next = members, archive, memory, int(state["next"]) % MEMORY
