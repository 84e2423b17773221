"""Least squares in stages, for objectives with cliffs: screening, evolution if wanted, descents side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from commonrail.arrays import Floats, IndexArray
from commonrail.calibration.optimisers.base import Best, Wanted
from commonrail.calibration.optimisers.descent import DIFFERENCES, Descents, iterate
from commonrail.calibration.optimisers.least_squares import diverse_members
from commonrail.calibration.optimisers.operators import crossover, draw, mutate
from commonrail.calibration.optimisers.staged_settings import StagedSettings
from commonrail.calibration.optimisers.stepwise import Stepwise, Work, asked
from commonrail.calibration.optimisers.treatments import Treatment, treat, wins
from commonrail.calibration.sampling import sample_priors
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError

__all__ = ["StagedLeastSquares"]


SCREENING_CAP = 12.0  # a residual beyond it counts as much: a candidate must not lose by one point alone
EVOLUTION_CAP = 36.0  # that of residuals with three times the tolerance
POOL = 60  # best screened candidates that evolve
FACTOR, CROSSOVER = (0.4, 1.0), 0.8  # the paper's, Eq. (18), (19)
HOP = 0.06  # standard deviation of a hop from the best, as a share of each range


class StagedLeastSquares(Stepwise):
    """Damped least squares whose difference steps shrink in stages, from the best of many screened candidates.

    The first step screens draws from the priors, or from the bounds where a parameter has none, with coarser
    simulations. Then these evolve, if the settings say so. The other steps are iterations: at first of several
    descents, after `trial_iterations` of the best ones only, through all stages. When all have ended, a new descent
    starts from a point near the best.

    Parameters
    ----------
    space : Space
    rng : numpy.random.Generator
        Source of every draw.
    settings : StagedSettings, optional
    """

    method, phase = "staged least squares", "staged least squares"

    def __init__(self, space: Space, rng: np.random.Generator, settings: StagedSettings | None = None) -> None:
        self.settings = settings or StagedSettings()
        super().__init__(space, rng, self.settings)
        empty = np.empty((0, space.dimension))
        self._pool, self._pool_costs = empty, np.empty(0)
        self._descents = Descents.begin(empty)
        self._costs = np.empty(0)
        self._ended_unit, self._ended_costs, self._hopping = empty, np.empty(0), False
        self._stages = len(DIFFERENCES)

    @property
    def _ended(self) -> str:
        return f"all {self.settings.generations} steps after the screening are done"

    @property
    def ends(self) -> tuple[Best, ...]:
        """Points of the descents from the screened or evolved members; hops, which start near the best, refine it."""
        unit, costs = (self._ended_unit, self._ended_costs) if self._hopping else (self._descents.unit, self._costs)
        return self._ranked(unit, costs)

    @property
    def population(self) -> Floats:
        """Points (n, d) of the descents, SI."""
        return self.space.from_unit(self._descents.unit)

    @property
    def costs(self) -> Floats:
        """Costs (n,) of those points."""
        return self._costs.copy()

    def _step(self) -> Work:
        """Screening at first, then the evolution that is wanted, then iterations."""
        if self.steps == 0:
            return self._screen()
        return self._evolve() if self.steps <= self.settings.evolution else self._descend()

    def _screen(self) -> Work:
        """Screen draws, and choose where descents start."""
        x = sample_priors(self.space, self.settings.members, self._rng)
        costs = capped(SCREENING_CAP, (yield asked(x, Wanted.SCREENED)))
        order = np.argsort(costs, kind="stable")[: max(POOL, self.settings.starts)]
        starts = x[order[: self.settings.starts]]
        told = yield asked(starts, Wanted.COSTS)
        self._pool, self._pool_costs = self.space.to_unit(x[order]), costs[order]
        self._begin(self.space.to_unit(starts), told)

    def _evolve(self) -> Work:
        """One generation of the pool; after the last one descents start from members that lie apart."""
        n, d = self._pool.shape
        members = np.arange(n)

        def trials(chosen: IndexArray) -> Floats:
            draws = draw(self._rng, chosen, (n, d), FACTOR)
            return crossover(self._pool[chosen], mutate(self._pool, draws), draws, CROSSOVER)

        trial = treat(Treatment.REPAIR, self.space, self._pool, trials(members), lambda few: trials(few)[:, None])
        costs = capped(EVOLUTION_CAP, (yield asked(trial.x, Wanted.SCREENED)))
        better = wins((costs, np.zeros(n)), (self._pool_costs, np.zeros(n)))
        pool = np.where(better[:, None], trial.unit, self._pool)
        costs = np.where(better, costs, self._pool_costs)
        if self.steps == self.settings.evolution:
            chosen = diverse_members(pool, costs, self.settings.starts)
            starts = pool[chosen] if len(chosen) else pool[: self.settings.starts]
        else:
            starts = pool[[int(np.argmin(costs))]]
        told = yield asked(self.space.from_unit(starts), Wanted.COSTS)
        self._pool, self._pool_costs = pool, costs
        self._begin(starts, told)

    def _descend(self) -> Work:
        """One iteration of the descents, or the start of a new one."""
        descents, stages = self._descents, self._stages
        if stages == 1 and not descents.running(stages).any():
            descents, stages = self._finalists(), len(DIFFERENCES)
        if not descents.running(stages).any():
            if not self._hopping:
                self._ended_unit, self._ended_costs, self._hopping = descents.unit, self._costs, True
            unit = self._near_best()[None, :]
            told = yield asked(self.space.from_unit(unit), Wanted.COSTS)
            self._begin(unit, told, len(DIFFERENCES))
            return
        most = self.settings.trial_iterations if stages == 1 else self.settings.stage_iterations
        after = yield from iterate(self.space, descents, stages, most)
        x = self.space.from_unit(after.unit)
        costs = yield asked(x, Wanted.COSTS_AGAIN)
        self._descents, self._costs, self._stages = after, costs, stages
        self._offer(x, costs)

    def _begin(self, unit: Floats, costs: Floats, stages: int | None = None) -> None:
        """Begin descents from points (k, d) with their costs (k,); those that cannot be simulated end at once."""
        tried = self.settings.trial_iterations > 0 and len(unit) > self.settings.finalists
        self._stages = stages or (1 if tried else len(DIFFERENCES))
        self._descents, self._costs = Descents.begin(unit).ended(~np.isfinite(costs)), costs
        self._offer(self.space.from_unit(unit), costs)

    def _finalists(self) -> Descents:
        """The best descents, at the beginning of the first stage."""
        best = np.argsort(self._costs, kind="stable")[: self.settings.finalists]
        return self._descents.of(best).restarted().ended(~np.isfinite(self._costs[best]))

    def _near_best(self) -> Floats:
        """A feasible point (d,) near the best, or anywhere if there is none yet; unit coordinates."""
        space = self.space
        if not np.isfinite(self._best.cost):
            return space.to_unit(sample_priors(space, 1, self._rng)[0])
        hop = self._rng.normal(0.0, HOP, space.dimension)
        there = space.from_unit(np.clip(space.to_unit(self._best.x) + hop, 0.0, 1.0))
        inside = space.pull_back(self._best.x[None, :], there[None, :])[0]
        return np.clip(space.to_unit(inside), 0.0, 1.0)

    def _kept(self) -> dict[str, Any]:
        return {
            "pool": self._pool.copy(),
            "pool_costs": self._pool_costs.copy(),
            **{name: values.copy() for name, values in self._descents._asdict().items()},
            "costs": self._costs.copy(),
            "stages": self._stages,
            "best": self._best.x.copy(),
            "cost": self._best.cost,
            "ended_unit": self._ended_unit.copy(),
            "ended_costs": self._ended_costs.copy(),
            "hopping": self._hopping,
        }

    def _restore(self, state: Mapping[str, Any]) -> None:
        d = self.space.dimension
        pool, unit, best = (np.array(state[name], dtype=float) for name in ("pool", "unit", "best"))
        pool_costs, costs, damping = (np.array(state[name], dtype=float) for name in ("pool_costs", "costs", "damping"))
        stage, iteration = (np.array(state[name], dtype=np.int64) for name in ("stage", "iteration"))
        shapes = [pool.shape, unit.shape, best.shape] + [a.shape for a in (costs, damping, stage, iteration)]
        if shapes != [(len(pool_costs), d), (len(costs), d), (d,)] + [(len(costs),)] * 4:
            raise ConfigurationError("state: its descents are not whole; take a whole state")
        inside = all(np.all(np.abs(points - 0.5) <= 0.5 + 1e-9) for points in (pool, unit, self.space.to_unit(best)))
        if not inside or np.isnan(costs).any():  # to unit coordinates and back rounds
            raise ConfigurationError("state: its descents lie outside the bounds or have costs that are no numbers")
        self._restore_ended(state)
        self._pool, self._pool_costs, self._costs = pool, pool_costs, costs
        self._descents = Descents(unit, damping, stage, iteration)
        self._stages, self._best, self._work = int(state["stages"]), Best(best, float(state["cost"])), None

    def _restore_ended(self, state: Mapping[str, Any]) -> None:
        """Ends of the first descents."""
        unit, costs = (np.array(state[name], dtype=float) for name in ("ended_unit", "ended_costs"))
        if unit.shape != (len(costs), self.space.dimension):
            raise ConfigurationError("state: its ends are not whole; take a whole state")
        self._ended_unit, self._ended_costs, self._hopping = unit, costs, bool(state["hopping"])


def capped(cap: float, residuals: Floats) -> Floats:
    """Sum of squares (n,) of residuals (n, m), each at most `cap` in size; +inf where one is not finite."""
    finite = np.isfinite(residuals)
    size = np.minimum(np.abs(np.where(finite, residuals, 0.0)), cap)
    return np.where(np.all(finite, axis=1), np.sum(size**2, axis=1), np.inf)
