"""Least squares in stages, for objectives with cliffs: screening, ensembles if wanted, descents side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.optimisers.base import (
    MOST_GENERATIONS,
    MOST_MEMBERS,
    MOST_STARTS,
    Best,
    Optimiser,
    Question,
    Registered,
    Work,
    asked,
    check_counts,
    count,
    hop,
    inside,
    ranked,
)
from commonrail.calibration.optimisers.ensemble import groups_of, moved
from commonrail.calibration.optimisers.least_squares import (
    DescentLoss,
    Descents,
    FeasibleSet,
    LossSum,
    Rules,
    advance,
    recognised,
)
from commonrail.calibration.space import Space, sample_priors

# Settings of the staged least squares.


@dataclass(frozen=True)
class StagedSettings:
    """Settings of `StagedLeastSquares`; the defaults suit parameters with priors.

    Parameters
    ----------
    members : int
        Candidates that are screened, at least 4.
    generations : int
        Steps after the screening: those of the ensembles, then iterations of the descents.
    inversions : int
        Steps of ensemble Kalman inversion of the screened candidates before the descents; 0 for none. Without priors
        about 12 are needed.
    starts : int
        Descents that begin side by side, and ensembles, as far as there are candidates for them.
    trial_iterations : int
        Iterations after which only the best descents continue; 0 lets all of them continue.
    finalists : int
        Descents that continue, at most `starts`.
    stage_iterations : int
        Largest number of iterations with one difference step; then the next smaller one is used.

    Raises
    ------
    ConfigurationError
        If a number lies outside its range, or is not whole.
    """

    size: ClassVar[str] = "{members} screened candidates, {generations} steps"  # in words, of a report

    members: int = count(400, MOST_MEMBERS, 4)
    generations: int = count(52, MOST_GENERATIONS)
    inversions: int = count(0, MOST_GENERATIONS)
    starts: int = count(3, MOST_STARTS, 1)
    trial_iterations: int = count(10, MOST_GENERATIONS)
    finalists: int = count(1, MOST_STARTS, 1)
    stage_iterations: int = count(14, MOST_GENERATIONS, 1)

    def __post_init__(self) -> None:
        check_counts(self)
        if self.starts > self.members:
            raise ConfigurationError(f"starts = {self.starts} must not exceed members = {self.members}.")
        if self.finalists > self.starts:
            raise ConfigurationError(f"finalists = {self.finalists} must not exceed starts = {self.starts}.")


SCREENING_CAP = 12.0  # a residual beyond it counts as much: a candidate must not lose by one point alone
INVERSION_CAP = 36.0  # that of residuals with three times the tolerance

# Forward differences as shares of the range, one stage each. Quantities jump where a valve or a needle bounces once
# more: a small step measures such a jump or none, a large one the mean slope across many of them.
DIFFERENCES = (1e-2, 3e-3, 1e-3)
LEAST_GAIN = 1e-4  # relative fall of the cost below which the next stage begins
DAMPING, LEAST_DAMPING = 1e-2, 1e-7  # of a descent that begins, and of one that goes on
FACTORS = tuple(4.0**power for power in range(-3, 5))  # dampings tried at once: eight fill a SIMD block


class StagedLeastSquares(Optimiser):
    """Damped least squares whose difference steps shrink in stages, from the best of many screened candidates.

    The first step screens draws from the priors, or from the bounds where a parameter has none, with coarser
    simulations. Then ensembles of them contract, if the settings say so. The other steps are iterations: at first of
    several descents, after `trial_iterations` of the best ones only, through all stages. When all have ended, a new
    descent starts from a point near the best.

    `rng`: source of every draw.
    """

    method, phase = "staged least squares", "staged least squares"
    ended = "all {generations} steps after the screening are done"

    def __init__(self, space: Space, rng: np.random.Generator, settings: StagedSettings | None = None) -> None:
        super().__init__(space, rng, settings or StagedSettings())
        empty = np.empty((0, space.dimension))
        self._pool, self._group = empty, np.empty(0, int)  # members, and the ensemble of each
        self._descents = Descents.begin(empty, np.empty((0, 0)))
        self._stage = self._iteration = np.empty(0, int)  # of each descent; one beyond the last stage has ended
        self._ended_x, self._ended_costs, self._hopping = empty, np.empty(0), False
        self._stages, self._loss = len(DIFFERENCES), DescentLoss.SQUARES

    @property
    def ends(self) -> tuple[Best, ...]:
        """Points of the descents from the members of the pool; hops, which start near the best, refine it."""
        x, costs = (self._ended_x, self._ended_costs) if self._hopping else (self.population, self.costs)
        return ranked(self.best, x, costs)

    def _step(self) -> Work:
        """Screening at first, then the inversions that are wanted, then iterations."""
        if self.steps == 0:
            return self._screen()
        inverting = self.steps <= self.settings.inversions and len(self._pool)
        return self._invert() if inverting else self._descend()

    def _screen(self) -> Work:
        """Screen draws, and choose where descents start."""
        x = sample_priors(self.space, self.settings.members, self._rng)
        costs = capped(SCREENING_CAP, (yield asked(x, Question.SCREENED)))
        order = np.argsort(costs, kind="stable")
        yield from self._begin(self.space.to_unit(x[order[: self.settings.starts]]))
        pool = order[np.isfinite(costs[order])] if self.settings.inversions else order[:0]
        self._pool = self.space.to_unit(x[pool])
        self._group = groups_of(len(pool), self.settings.starts, self.space.dimension)

    def _invert(self) -> Work:
        """One step of the ensembles; after the last one descents start from the best member of each."""
        residuals = yield asked(self.space.from_unit(self._pool), Question.SCREENED)
        costs = capped(INVERSION_CAP, residuals)
        sound = np.isfinite(costs)
        if not sound.any():  # descents go on from what was found before
            self._pool, self._group = self._pool[:0], self._group[:0]
            return
        pool, group, costs, residuals = (array[sound] for array in (self._pool, self._group, costs, residuals))
        rows = [np.flatnonzero(group == ensemble) for ensemble in np.unique(group)]
        best = np.array([members[int(np.argmin(costs[members]))] for members in rows], int)
        last = self.steps == self.settings.inversions
        yield from self._begin(pool[best if last else best[np.argsort(costs[best], kind="stable")[:1]]])
        feasible = FeasibleSet.of(self.space)
        for members in rows:
            pool[members] = moved(feasible, pool[members], residuals[members])
        self._pool, self._group = pool, group

    def _descend(self) -> Work:
        """One iteration of the descents, or the start of a new one."""
        descents, costs = self._descents, self.costs
        stage, iteration, stages = self._stage, self._iteration, self._stages
        if stages == 1 and not (stage < stages).any():  # trials are over: the best descents begin the first stage again
            best = np.argsort(costs, kind="stable")[: self.settings.finalists]
            descents, costs, iteration = descents.at(best), costs[best], np.zeros(len(best), int)
            stages = len(DIFFERENCES)
            stage = np.where(np.isfinite(costs), 0, stages)
        running = stage < stages
        if not running.any():
            ended = self.space.from_unit(descents.unit), costs
            yield from self._begin(self._near_best()[None, :], len(DIFFERENCES))
            if not self._hopping:
                (self._ended_x, self._ended_costs), self._hopping = ended, True
            return
        losses = LossSum.near(self._loss, descents.residuals[int(np.argmin(costs))])
        width = np.array(DIFFERENCES)[np.minimum(stage, len(DIFFERENCES) - 1)]
        now = descents.without_slopes()._replace(running=running)
        after = yield from advance(self.space, now, losses, Rules(width, 0.0, FACTORS, bent=False))
        x = self.space.from_unit(after.unit)
        costs = yield asked(x, Question.COSTS_AGAIN)
        before, lowered = (losses.costs(descent.residuals) for descent in (descents, after))
        most = self.settings.trial_iterations if stages == 1 else self.settings.stage_iterations
        iteration = iteration + running
        done = running & ((iteration >= most) | ~(lowered < (1.0 - LEAST_GAIN) * before))
        damping = np.where(lowered < before, np.maximum(after.damping, LEAST_DAMPING), descents.damping)
        self._descents, self._stages = after._replace(damping=damping), stages
        self._stage, self._iteration = stage + done, np.where(done, 0, iteration)
        self.population, self.costs = x, costs
        self._offer(x, costs)

    def _begin(self, unit: Floats, stages: int | None = None) -> Work:
        """Begin descents from points (k, d); those that cannot be simulated end at once."""
        x = self.space.from_unit(unit)
        residuals = yield asked(x, Question.RESIDUALS)
        costs = yield asked(x, Question.COSTS_AGAIN)
        tried = self.settings.trial_iterations > 0 and len(unit) > self.settings.finalists
        self._stages = stages or (1 if tried else len(DIFFERENCES))
        self._descents = Descents.begin(unit, residuals)._replace(damping=np.full(len(unit), DAMPING))
        self._stage = np.where(self._descents.running & np.isfinite(costs), 0, len(DIFFERENCES))
        self._iteration, self._loss = np.zeros(len(unit), int), recognised(costs, residuals)
        self.population, self.costs = x, costs
        self._offer(x, costs)

    def _near_best(self) -> Floats:
        """A feasible point (d,) near the best, or anywhere if there is none yet; unit coordinates."""
        space = self.space
        if not np.isfinite(self.best.cost):
            return space.to_unit(sample_priors(space, 1, self._rng)[0])
        return np.clip(space.to_unit(hop(space, self.best.x, self._rng)), 0.0, 1.0)

    def _kept(self) -> dict[str, Any]:
        return {
            "pool": self._pool.copy(),
            "group": self._group.copy(),
            **self._descents.record(),
            "stage": self._stage.copy(),
            "iteration": self._iteration.copy(),
            "costs": self.costs.copy(),
            "stages": self._stages,
            "loss": self._loss.value,
            "ended_x": self._ended_x.copy(),
            "ended_costs": self._ended_costs.copy(),
            "hopping": self._hopping,
        }

    def _restore(self, state: Mapping[str, Any]) -> None:
        d = self.space.dimension
        names = "pool", "ended_x", "costs", "ended_costs"
        pool, ended, costs, ended_costs = (np.array(state[name], dtype=float) for name in names)
        group, stage, iteration = (np.array(state[name], dtype=np.int64) for name in ("group", "stage", "iteration"))
        descents = Descents.recorded(state, d)
        shapes = [pool.shape, ended.shape, costs.shape, stage.shape, iteration.shape]
        if shapes != [(len(group), d), (len(ended_costs), d), *[descents.damping.shape] * 3]:
            raise ConfigurationError("state: its descents are incomplete; use an intact state")
        if not (inside(pool) and inside(self.space.to_unit(ended))) or np.isnan(costs).any():
            raise ConfigurationError("state: its descents lie outside the bounds or have costs that are no numbers")
        self._pool, self._group = pool, group
        self._descents, self._stage, self._iteration = descents, stage, iteration
        self._stages, self._loss = int(state["stages"]), DescentLoss(state["loss"])
        self._ended_x, self._ended_costs, self._hopping = ended, ended_costs, bool(state["hopping"])
        self.population, self.costs = self.space.from_unit(descents.unit), costs


def capped(cap: float, residuals: Floats) -> Floats:
    """Sum of squares (n,) of residuals (n, m), each at most `cap` in size; +inf where one is not finite."""
    finite = np.isfinite(residuals)
    size = np.minimum(np.abs(np.where(finite, residuals, 0.0)), cap)
    return np.where(np.all(finite, axis=1), np.sum(size**2, axis=1), np.inf)


def _check_steps(settings: StagedSettings, space: Space) -> None:
    """Refuse ensembles that no step would follow: their best members are never descended from."""
    if settings.inversions and settings.inversions >= settings.generations:
        raise ConfigurationError(
            f"inversions = {settings.inversions} must be less than generations = {settings.generations}, the steps of "
            "ensembles and descents together."
        )


REGISTERED = Registered(
    StagedLeastSquares,
    StagedSettings,
    MappingProxyType({"inversions": _check_steps}),
    "Marquardt 1963; Transtrum & Sethna 2012; Iglesias, Law & Stuart 2013",
)
