"""Optimisers compared at equal evaluations: the objective against evaluations and against processor time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from commonrail.bench.timing import CLOCKS
from commonrail.calibration.objective import Objective
from commonrail.calibration.optimisers import (
    EvolutionSettings,
    MultiStartSettings,
    Settings,
    StagedSettings,
)
from commonrail.calibration.optimisers.covariance import CovarianceSettings
from commonrail.calibration.optimisers.registry import registered
from commonrail.calibration.optimisers.simplex import NelderMeadSettings
from commonrail.calibration.optimisers.success_history import SuccessHistorySettings
from commonrail.calibration.search import goal_of, steps
from commonrail.calibration.study import Study
from commonrail.kinds import Role, of_role

__all__ = ["PAPER", "Entry", "Problem", "Trace", "contest", "entries", "search_once"]

PAPER = "differential evolution"
SLOTS = 3550  # (1 + 70) · 50, of the paper's search
ENDLESS = 100_000  # generations: the evaluations end a search


class Entry(NamedTuple):
    """An optimiser with settings, under a name of its own."""

    name: str
    settings: Settings


class Problem(NamedTuple):
    """A study under a name, and its settings of the searches: derivatives of maps take wider differences."""

    name: str
    study: Study
    difference: float


class Trace(NamedTuple):
    """Evaluations, processor time [s] and best objective after each step of a search, and whether it said "converged".

    An evaluation is one candidate at all operating points. `converged` is None of a search that does not judge itself.
    """

    evaluations: list[int]
    seconds: list[float]
    best: list[float]
    converged: bool | None

    def after(self, evaluations: int) -> float:
        """Best objective once so many evaluations were made; +inf before the first step."""
        found = [j for n, j in zip(self.evaluations, self.best, strict=True) if n <= evaluations]
        return found[-1] if found else float("inf")

    def reaching(self, objective: float) -> tuple[int, float] | None:
        """Evaluations and processor time [s] at which an objective was reached; None if it was not."""
        for n, seconds, j in zip(*self[:3], strict=True):
            if j <= objective:
                return n, seconds
        return None


def entries(problem: Problem, evaluations: int = SLOTS) -> list[Entry]:
    """The optimisers that are compared, with settings for a number of evaluations; the first is the paper's.

    Parameters
    ----------
    problem : Problem
    evaluations : int
        L-SHADE shrinks its population over as many; no other setting depends on them.
    """
    wide = problem.difference
    shrinking = max(2 * evaluations // (96 + 4), 1)
    return [
        Entry(PAPER, EvolutionSettings(generations=ENDLESS)),
        Entry("L-SHADE", SuccessHistorySettings(generations=ENDLESS, shrinking=shrinking)),
        Entry("CMA-ES", CovarianceSettings(generations=ENDLESS)),
        Entry("Nelder-Mead", NelderMeadSettings(generations=ENDLESS)),
        Entry("staged least squares", StagedSettings(generations=ENDLESS)),
        Entry("multi-start least squares, 8 starts", MultiStartSettings(128, ENDLESS, 8, wide)),
        Entry("multi-start least squares, 2 starts", MultiStartSettings(64, ENDLESS, 2, wide)),
    ]


def search_once(
    study: Study, entry: Entry, seed: int, evaluations: int, clock: Callable[[], float] = CLOCKS.processor
) -> Trace:
    """Search on one thread until so many evaluations are made, or the optimiser ends by itself.

    Parameters
    ----------
    study : Study
    entry : Entry
    seed : int
    evaluations : int
        The step that exceeds them is the last one.
    clock : function
        Processor time of this process [s].
    """
    kind = registered(entry.settings)
    assert kind is not None  # an entry has the settings of an optimiser
    names, fit = study.space.names, of_role(study.data, Role.FIT)
    objective = Objective(study.injector, names, fit, study.time_step, 1, study.precision, goal=goal_of(study))
    optimiser = kind.begin(study.space, np.random.default_rng(seed), entry.settings)
    trace, made, begin = Trace([], [], [], None), 0, clock()
    for step in steps(optimiser, objective):
        made += step.simulations // objective.injections
        trace.evaluations.append(made)
        trace.seconds.append(clock() - begin)
        trace.best.append(optimiser.best.cost)
        if made >= evaluations:
            break
    verdict = optimiser.verdict
    return trace._replace(converged=verdict.converged if verdict is not None else None)


def contest(
    problems: Sequence[Problem],
    seeds: Sequence[int],
    evaluations: int = SLOTS,
    wanted: Sequence[str] = (),
) -> Iterator[dict[str, Any]]:
    """Search every problem with every optimiser and seed.

    Parameters
    ----------
    problems : sequence of Problem
    seeds : sequence of int
    evaluations : int
        Of each search.
    wanted : sequence of str
        Beginnings of the names of the optimisers, all by default; the paper's runs in any case.

    Yields
    ------
    dict
        JSON-able: problem, optimiser, seed, converged, and evaluations, seconds, best after each step (None for +inf).
    """
    for problem in problems:
        for entry in entries(problem, evaluations):
            if wanted and entry.name != PAPER and not entry.name.startswith(tuple(wanted)):
                continue
            search_once(problem.study, entry, 0, 1)  # compiles what it needs
            for seed in seeds:
                found = search_once(problem.study, entry, seed, evaluations)
                best = [j if np.isfinite(j) else None for j in found.best]
                named = {"problem": problem.name, "optimiser": entry.name, "seed": seed}
                yield named | found._asdict() | {"best": best}
