"""The search of a study: differential evolution, then refinements, each step told and kept as it is done."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.checkpoint import (
    NOT_SIMULATED,
    Checkpoint,
    CheckpointError,
    Evolved,
    Found,
    Generation,
    Recorder,
)
from commonrail.calibration.interrupt import Wish
from commonrail.calibration.objective import Objective
from commonrail.calibration.optimisers import (
    DifferentialEvolution,
    LeastSquares,
    LeastSquaresSettings,
    Optimiser,
    diverse_members,
)
from commonrail.calibration.study import Study
from commonrail.calibration.workers import Workers
from commonrail.engine.status import Status
from commonrail.errors import ConfigurationError, StudyError
from commonrail.kinds import Role, of_role

__all__ = ["Listeners", "Progress", "Search", "generations"]

Floats = NDArray[np.float64]

HOP = 0.06  # standard deviation of a hop away from the best, as a share of each range


class Progress(NamedTuple):
    """How far a calibration has come. `phase` is "evolution" or "refinement"; `seconds` since its start."""

    phase: str
    generation: int
    generations: int
    best: float
    mean: float
    simulated: int
    seconds: float


class Listeners(NamedTuple):
    """Who is told of each step, and who may ask to stop."""

    progress: Callable[[Progress], None] | None
    recorder: Recorder | None
    wish: Wish


def generations(optimiser: Optimiser, objective: Objective) -> Iterator[Evolved]:
    """Run a search to its end, and yield each generation once it has been answered."""
    while not optimiser.finished:
        trials = optimiser.ask()
        costs = np.full(len(trials.x), np.inf)
        statuses = np.full(len(trials.x), NOT_SIMULATED, np.int8)
        simulations = 0
        if trials.simulate.all():
            costs, statuses, simulations = objective.costs(trials.x)
        elif trials.simulate.any():
            scores = objective.costs(trials.x[trials.simulate])
            costs[trials.simulate], statuses[trials.simulate] = scores.costs, scores.statuses
            simulations = scores.simulations
        optimiser.tell(costs)
        yield Evolved(trials.x, costs, statuses, simulations)


class Search:
    """State of a running calibration.

    Parameters
    ----------
    study : Study
    threads : int or None
    workers : Workers or None
    listeners : Listeners
    checkpoint : Checkpoint, optional
        Where to go on.

    Raises
    ------
    StudyError
        If the study has no data to fit.
    CheckpointError
        If the checkpoint belongs to another search.
    """

    def __init__(
        self,
        study: Study,
        threads: int | None,
        workers: Workers | None,
        listeners: Listeners,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self.study, self.listeners = study, listeners
        fit = of_role(study.data, Role.FIT)
        if not fit:
            raise StudyError(f"{study.title}: no data set has role fit; give at least one the role fit.")
        objective = Objective(study.injector, study.space.names, fit, study.time_step, threads, study.precision)
        self.objective = objective if workers is None else workers.spread(objective)
        self.optimiser = DifferentialEvolution(study.space, np.random.default_rng(study.seed), study.method.evolution)
        self.history: list[Generation] = []
        self.simulations = self.refinements = 0
        self.failures: Counter[str] = Counter()
        self.refined: Found | None = None
        self._hops: np.random.Generator | None = None
        self._start = time.perf_counter()
        if checkpoint is not None:
            self._restore(checkpoint)

    @property
    def seconds(self) -> float:
        """Time spent, that before a restart included [s]."""
        return time.perf_counter() - self._start

    @property
    def best(self) -> Found:
        """Best values and cost of both phases."""
        found = self.optimiser.best
        if self.refined is not None and self.refined.cost < found.cost:
            return self.refined
        return Found(found.x, found.cost)

    def evolve(self) -> None:
        """Differential evolution to its end."""
        for trials in generations(self.optimiser, self.objective):
            self.simulations += trials.simulations
            failed = trials.statuses[trials.statuses > 0].tolist()
            self.failures.update(Status(status).name.lower() for status in failed)
            self.history.append(Generation.of(len(self.history), self.optimiser))
            if self.listeners.recorder is not None:
                self.listeners.recorder.evolved(trials, self.checkpoint())
            self._tell("evolution", len(self.history), 1 + self.study.method.evolution.generations)

    def refine(self) -> None:
        """Least squares from good members that lie apart, then from near the best; kept where the objective falls."""
        method, space = self.study.method, self.study.space
        if not method.polish or not np.isfinite(self.best.cost):
            return
        population, costs = self.optimiser.population, self.optimiser.costs
        usable = np.isfinite(costs) & space.satisfies(population)
        members = population[usable]
        count = min(max(method.polish // 3, 1), len(members))
        chosen = diverse_members(space.to_unit(members), costs[usable], count)
        hops = self._hops = self._hops or np.random.default_rng([self.study.seed, count])
        for i in range(self.refinements, method.polish):
            start = members[chosen[i]] if i < count else self._near_best(hops)
            end = self._refine_from(start)
            self.refinements += 1
            if self.listeners.recorder is not None:
                self.listeners.recorder.refined(start, end, self.checkpoint())
            self._tell("refinement", i + 1, method.polish)

    def _refine_from(self, start: Floats) -> Found:
        # differences over 1 % of a range: a smaller step measures the ripple of bouncing valves and needles
        settings = LeastSquaresSettings(iterations=self.study.method.polish_iterations, step=1e-2)
        end = LeastSquares(self.study.space, self._residuals, settings).run(start)[0]
        found = Found(end.x, float(self.objective.costs(end.x[None, :]).costs[0]))
        if found.cost < self.best.cost:
            self.refined = found
        return found

    def _near_best(self, rng: np.random.Generator) -> Floats:
        """A feasible point some hops of the bounds' width away from the best."""
        space, best = self.study.space, self.best.x
        hop = rng.normal(0.0, HOP, space.dimension)
        there = space.from_unit(np.clip(space.to_unit(best) + hop, 0.0, 1.0))
        return there if space.satisfies(there) else space.pull_back(best, there)

    def _residuals(self, values: Floats) -> Floats:
        residuals = self.objective.residuals(values)
        self.simulations += len(values) * self.objective.injections
        return residuals

    def _tell(self, phase: str, generation: int, generations: int) -> None:
        if self.listeners.progress is not None:
            mean = self.history[-1].mean
            with suppress(OSError, ValueError):  # a terminal that went away must not end the search
                self.listeners.progress(
                    Progress(phase, generation, generations, self.best.cost, mean, self.simulations, self.seconds)
                )
        self.listeners.wish.heed()

    def checkpoint(self) -> Checkpoint:
        """The search as it stands."""
        return Checkpoint(
            self.optimiser.state(),
            tuple(self.history),
            self.simulations,
            dict(self.failures),
            self.refinements,
            self.refined,
            None if self._hops is None else dict(self._hops.bit_generator.state),
            self.seconds,
        )

    def _restore(self, checkpoint: Checkpoint) -> None:
        try:
            self._take_up(checkpoint)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, ConfigurationError) as error:
            raise CheckpointError(
                f"{self.study.title}: what was kept of the search is damaged or another study's ({error})."
            ) from error

    def _take_up(self, checkpoint: Checkpoint) -> None:
        self.optimiser.restore(checkpoint.evolution)
        self.history = list(checkpoint.history)
        self.simulations, self.failures = checkpoint.simulations, Counter(checkpoint.failures)
        self.refinements, self.refined = checkpoint.refinements, checkpoint.refined
        if self.refined is not None and not self._is_inside(self.refined.x):
            raise ValueError("a refinement has left the bounds")
        if checkpoint.hops is not None:
            self._hops = np.random.default_rng()
            self._hops.bit_generator.state = checkpoint.hops
        self._start -= checkpoint.seconds

    def _is_inside(self, x: Floats) -> bool:
        space = self.study.space
        slack = 1e-9 * (space.upper - space.lower)
        return bool(np.all((x >= space.lower - slack) & (x <= space.upper + slack)))
