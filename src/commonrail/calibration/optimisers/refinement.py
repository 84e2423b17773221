"""Least-squares refinements of what another optimiser has found."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from commonrail.calibration.optimisers.base import (
    Best,
    Counts,
    Optimiser,
    Trials,
    Wanted,
    check_origin,
    clean_costs,
    origin,
    restore_generator,
)
from commonrail.calibration.optimisers.conversation import conversation
from commonrail.calibration.optimisers.least_squares import (
    LeastSquares,
    LeastSquaresSettings,
    Polished,
    diverse_members,
)
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError, StudyError

__all__ = ["Refinement", "RefinementSettings"]

FloatArray = NDArray[np.float64]

HOP = 0.06  # standard deviation of a hop away from the best, as a share of each range

# differences over 1 % of a range: a smaller step measures the ripple of bouncing valves and needles
SOLVER = LeastSquaresSettings(step=1e-2)


class RefinementSettings(NamedTuple):
    """Number of refinements, and of Jacobians of each at most."""

    refinements: int
    iterations: int


class Refinement:
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

    phase = "refinement"

    def __init__(self, space: Space, seed: int, settings: RefinementSettings, before: Optimiser) -> None:
        self.space, self.settings = space, settings
        self._before = before
        self._improved: Best | None = None
        self._solver = replace(SOLVER, iterations=settings.iterations)
        population, costs = before.population, before.costs
        usable = np.isfinite(costs) & space.satisfies(population)
        members = population[usable]
        count = min(max(settings.refinements // 3, 1), len(members))
        self._starts = members[diverse_members(space.to_unit(members), costs[usable], count)]
        self._rng = np.random.default_rng([seed, count])
        self._done = 0
        self._begun: Mapping[str, Any] = {}  # state of the generator before the refinement under way
        self._solving: Generator[FloatArray, FloatArray, Polished] | None = None
        self._pending: Trials | None = None

    @property
    def steps(self) -> int:
        """Refinements done."""
        return self._done

    @property
    def total(self) -> int:
        """Refinements wanted; none of a search in which nothing could be simulated."""
        return self.settings.refinements if np.isfinite(self.best.cost) else 0

    @property
    def finished(self) -> bool:
        """Whether all are done."""
        return self._done >= self.total

    @property
    def reason(self) -> str:
        """Why the search has stopped; empty while it has not."""
        return f"all {self.total} refinements are done" if self.finished else ""

    @property
    def best(self) -> Best:
        """The best end, or what the search before had found if that is better."""
        return self._improved or self._before.best

    @property
    def population(self) -> FloatArray:
        """That of the search before (n, d), SI."""
        return self._before.population

    @property
    def costs(self) -> FloatArray:
        """Costs (n,) of that population."""
        return self._before.costs

    @property
    def counts(self) -> Counts:
        """Those of the search before."""
        return self._before.counts

    def ask(self) -> Trials:
        """Return points whose residuals are wanted; at the end of a refinement the one whose cost is.

        Raises
        ------
        StudyError
            If the search has finished.
        """
        if self.finished:
            raise StudyError(f"the search has finished ({self.reason}): read its best point")
        if self._pending is None:
            self._begun = self._rng.bit_generator.state
            start = self._start()
            self._solving = conversation(lambda call: LeastSquares(self.space, call, self._solver).run(start)[0])
            self._pending = _trials(next(self._solving), Wanted.RESIDUALS)
        return self._pending._replace(x=self._pending.x.copy())

    def tell(self, answers: ArrayLike) -> None:
        """Take the residuals (n, m) or the cost (1,) asked for.

        Raises
        ------
        StudyError
            If nothing was asked for, or there is not one answer for each trial.
        """
        if self._pending is None:
            raise StudyError("answers were told before any trials were asked for: ask first")
        if self._solving is None:
            self._judge(self._pending, answers)
            return
        told = np.asarray(answers, dtype=float)
        if told.ndim != 2 or len(told) != len(self._pending.x):
            raise StudyError(
                f"residuals: an array of shape {told.shape} was told for {len(self._pending.x)} trials, expected one "
                "row for each trial in the order asked for"
            )
        try:
            self._pending = _trials(self._solving.send(told), Wanted.RESIDUALS)
        except StopIteration as stop:
            self._solving = None
            self._pending = _trials(stop.value.x[None, :], Wanted.COSTS_AGAIN)

    def _judge(self, end: Trials, answers: ArrayLike) -> None:
        (cost,) = clean_costs(answers, end.simulate).tolist()
        if cost < self.best.cost:
            self._improved = Best(end.x[0], cost)
        self._done += 1
        self._pending = None

    def _start(self) -> FloatArray:
        """Where the next refinement begins (d,)."""
        starts = self._starts
        return np.asarray(starts[self._done]) if self._done < len(starts) else self._near_best()

    def _near_best(self) -> FloatArray:
        """A feasible point (d,) some hops of the bounds' width away from the best."""
        space, best = self.space, self.best.x
        hop = self._rng.normal(0.0, HOP, space.dimension)
        there = space.from_unit(np.clip(space.to_unit(best) + hop, 0.0, 1.0))
        return there if space.satisfies(there) else space.pull_back(best, there)

    def state(self) -> dict[str, Any]:
        """The search as it was after the last refinement that is done."""
        best, cost = self._improved or (None, None)
        return {
            **self._origin(),
            "done": self._done,
            "best": best,
            "cost": cost,
            "rng": dict(self._rng.bit_generator.state if self._pending is None else self._begun),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state`; a refinement that was under way is begun anew.

        Raises
        ------
        ConfigurationError
            If the state belongs to another space, or is not whole.
        """
        check_origin(state, self._origin())
        restore_generator(self._rng, state)
        if not isinstance(state["done"], int) or state["done"] < 0:
            raise ConfigurationError("state: its count is no whole number; take a whole state")
        self._done = state["done"]
        self._improved = None if state["best"] is None else self._inside(state["best"], float(state["cost"]))
        self._solving = self._pending = None

    def _inside(self, best: ArrayLike, cost: float) -> Best:
        x = np.array(best, dtype=float)
        slack = 1e-9 * (self.space.upper - self.space.lower)
        if x.shape != slack.shape or not np.all((x >= self.space.lower - slack) & (x <= self.space.upper + slack)):
            raise ConfigurationError("state: its best point lies outside the bounds; take a whole state")
        if not np.isfinite(cost):
            raise ConfigurationError("state: its cost is no number; take a whole state")
        return Best(x, cost)

    def _origin(self) -> dict[str, Any]:
        return origin("refinement", self.space)


def _trials(x: FloatArray, wanted: Wanted) -> Trials:
    return Trials(x, np.ones(len(x), bool), wanted)
