"""Run a study: the optimiser proposes, the engine simulates, until it is done or the user stops it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.interrupt import Wish, held_interrupts
from commonrail.calibration.objective import Objective, of_role
from commonrail.calibration.optimisers import (
    Counts,
    DifferentialEvolution,
    LeastSquares,
    LeastSquaresSettings,
    Optimiser,
    diverse_members,
)
from commonrail.calibration.score import DataScore, score_data
from commonrail.calibration.study import QuantityData, RateData, Role, Study
from commonrail.calibration.workers import Workers
from commonrail.errors import StudyError
from commonrail.injector.definition import Injector
from commonrail.injector.variants import Body

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


class Generation(NamedTuple):
    """Objective after one generation: best so far, and mean of the population's finite ones."""

    generation: int
    best: float
    mean: float

    @classmethod
    def of(cls, generation: int, optimiser: Optimiser) -> Generation:
        """Of a search as it stands."""
        finite = optimiser.costs[np.isfinite(optimiser.costs)]
        return cls(generation, optimiser.best.cost, float(finite.mean()) if len(finite) else float("inf"))


def generations(optimiser: Optimiser, objective: Objective) -> Iterator[int]:
    """Run a search to its end; after each generation yield the number of injections that it took."""
    while not optimiser.finished:
        trials = optimiser.ask()
        costs = np.full(len(trials.x), np.inf)
        simulations = 0
        if trials.simulate.any():
            scores = objective.costs(trials.x[trials.simulate])
            costs[trials.simulate] = scores.costs
            simulations = scores.simulations
        optimiser.tell(costs)
        yield simulations


@dataclass(frozen=True)
class Calibration:
    """Result of a study.

    Attributes
    ----------
    study : Study
    injector : Injector
        The calibrated injector.
    best : dict of str to float
        Best values of the free parameters [SI].
    cost, start_cost : float
        Objective of the best and of the start values; +inf if nothing succeeded.
    history : tuple of Generation
    counts : Counts
        Slots offered, simulations run, simulations failed; a simulation is one candidate at all points.
    status, reason : str
        "finished" or "interrupted", and why it stopped.
    scores : dict of str to tuple of DataScore
        For "start", "best" and, where the body is flexible, "rigid": every data set, fit and validation.
    seconds : float
        Time of the search.
    simulations : int
        Single injections simulated.
    """

    study: Study
    injector: Injector
    best: dict[str, float]
    cost: float
    start_cost: float
    history: tuple[Generation, ...]
    counts: Counts
    status: str
    reason: str
    scores: dict[str, tuple[DataScore, ...]]
    seconds: float
    simulations: int


class _Search:
    """State of a running calibration."""

    def __init__(
        self,
        study: Study,
        threads: int | None,
        progress: Callable[[Progress], None] | None,
        wish: Wish,
        workers: Workers | None,
    ) -> None:
        self.study, self.progress, self.wish = study, progress, wish
        fit = of_role(study.data, Role.FIT)
        if not fit:
            raise StudyError(f"{study.title}: no data set has role fit; give at least one the role fit.")
        objective = Objective(study.injector, study.space.names, fit, study.time_step, threads)
        self.objective = objective if workers is None else workers.spread(objective)
        self.optimiser = DifferentialEvolution(study.space, np.random.default_rng(study.seed), study.method.evolution)
        self.history: list[Generation] = []
        self.simulations = 0
        self.refined: tuple[Floats, float] | None = None
        self.start = time.perf_counter()

    @property
    def best(self) -> tuple[Floats, float]:
        """Best values and cost of both phases."""
        found = self.optimiser.best
        if self.refined is not None and self.refined[1] < found.cost:
            return self.refined
        return found.x, found.cost

    def evolve(self) -> None:
        """Differential evolution to its end."""
        for simulations in generations(self.optimiser, self.objective):
            self.simulations += simulations
            self.history.append(Generation.of(len(self.history), self.optimiser))
            self._tell("evolution", len(self.history), 1 + self.study.method.evolution.generations)

    def refine(self) -> None:
        """Least squares from good members that lie apart, then from near the best; kept where the objective falls."""
        method, space = self.study.method, self.study.space
        if not method.polish or not np.isfinite(self.best[1]):
            return
        population, costs = self.optimiser.population, self.optimiser.costs
        usable = np.isfinite(costs) & space.satisfies(population)
        members = population[usable]
        count = min(max(method.polish // 3, 1), len(members))
        chosen = diverse_members(space.to_unit(members), costs[usable], count)
        rng = np.random.default_rng([self.study.seed, count])
        for i in range(method.polish):
            self._refine_from(members[chosen[i]] if i < count else self._near_best(rng))
            self._tell("refinement", i + 1, method.polish)

    def _refine_from(self, start: Floats) -> None:
        # differences over 1 % of a range: a smaller step measures the ripple of bouncing valves and needles
        settings = LeastSquaresSettings(iterations=self.study.method.polish_iterations, step=1e-2)
        end = LeastSquares(self.study.space, self._residuals, settings).run(start)[0]
        cost = float(self.objective.costs(end.x[None, :]).costs[0])
        if cost < self.best[1]:
            self.refined = (end.x, cost)

    def _near_best(self, rng: np.random.Generator) -> Floats:
        """A feasible point some hops of the bounds' width away from the best."""
        space, best = self.study.space, self.best[0]
        hop = rng.normal(0.0, HOP, space.dimension)
        there = space.from_unit(np.clip(space.to_unit(best) + hop, 0.0, 1.0))
        return there if space.satisfies(there) else space.pull_back(best, there)

    def _residuals(self, values: Floats) -> Floats:
        residuals = self.objective.residuals(values)
        points = len(self.objective.curves) + sum(len(d.points) for d in self.objective.maps)
        self.simulations += len(values) * points
        return residuals

    def _tell(self, phase: str, generation: int, generations: int) -> None:
        if self.progress is not None:
            mean = self.history[-1].mean
            seconds = time.perf_counter() - self.start
            with suppress(OSError, ValueError):  # a terminal that went away must not end the search
                self.progress(Progress(phase, generation, generations, self.best[1], mean, self.simulations, seconds))
        self.wish.heed()


def calibrate(
    study: Study,
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    workers: Workers | None = None,
) -> Calibration:
    """Run a study to its end, or until Ctrl-C, which ends it in order with the best so far.

    Parameters
    ----------
    study : Study
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    progress : function of Progress, optional
        Called after every generation.
    workers : Workers, optional
        Processes or a cluster that simulate the populations in place of threads; the result is the same.

    Raises
    ------
    StudyError
        If the study has no data to fit, if not one candidate could be simulated, or if the workers failed.
    """
    with held_interrupts() as wish:
        return _calibrate(_Search(study, threads, progress, wish, workers), study, threads)


def _calibrate(search: _Search, study: Study, threads: int | None) -> Calibration:
    status, reason = "finished", ""
    try:
        search.evolve()
        search.refine()
        reason = search.optimiser.reason
    except KeyboardInterrupt:
        status, reason = "interrupted", "stopped by the user"
    seconds = time.perf_counter() - search.start
    x, cost = search.best
    if not np.isfinite(cost):
        if status == "interrupted":
            raise KeyboardInterrupt
        raise StudyError(
            f"{study.title}: not one of {search.optimiser.counts.simulated} candidates could be simulated; "
            "check the start values with `commonrail simulate`, then narrow the bounds."
        )
    best = dict(zip(study.space.names, x.tolist(), strict=True))
    calibrated = replace(study.injector.with_values(best), name=f"{study.injector.name}-calibrated")
    return Calibration(
        study,
        calibrated,
        best,
        cost,
        float(search.objective.costs(study.space.reference[None, :]).costs[0]),
        tuple(search.history),
        search.optimiser.counts,
        status,
        reason,
        scores_of(study, calibrated, threads, with_rigid=status == "finished"),
        seconds,
        search.simulations,
    )


def scores_of(
    study: Study, calibrated: Injector, threads: int | None = None, with_rigid: bool = True
) -> dict[str, tuple[DataScore, ...]]:
    """Every data set under the start values, the calibrated ones and, if it makes sense, a rigid body."""
    injectors = {"start": study.injector, "best": calibrated}
    if with_rigid and study.injector.variant.body is Body.FLEXIBLE and any(isinstance(d, RateData) for d in study.data):
        rigid = study.injector.variant._replace(body=Body.RIGID)
        injectors["rigid"] = replace(study.injector, variant=rigid)
    return {label: score_all(study.data, injector, study.time_step, threads) for label, injector in injectors.items()}


def score_all(
    data: Sequence[RateData | QuantityData], injector: Injector, time_step: float, threads: int | None = None
) -> tuple[DataScore, ...]:
    """Score of one injector on each data set."""
    return tuple(score_data(d, injector, time_step, threads) for d in data)


def validate(study: Study, injector: Injector, threads: int | None = None) -> list[dict[str, Any]]:
    """Figures of an injector on all data of a study, as in ``result.json``'s "data" with the one label "best"."""
    from commonrail.calibration.result import data_records

    return data_records(study.data, {"best": score_all(study.data, injector, study.time_step, threads)})
