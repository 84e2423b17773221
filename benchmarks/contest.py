"""Optimisers compared at equal evaluations: problems, searches, and the ranking by medians of seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from benchmarks.case import INJECTOR, TIME_STEP, injector, paper_study
from benchmarks.timing import CLOCKS
from commonrail.calibration.objective import Objective
from commonrail.calibration.optimisers.base import Settings
from commonrail.calibration.optimisers.evolution import EvolutionSettings
from commonrail.calibration.optimisers.registry import registered
from commonrail.calibration.optimisers.staged import StagedSettings
from commonrail.calibration.search import steps
from commonrail.calibration.space import sample_feasible
from commonrail.calibration.study import Study, goal_of
from commonrail.calibration.study_file import load_study
from commonrail.data.base import Role
from commonrail.data.quantities.data import QuantityData
from commonrail.data.registry import of_role
from commonrail.plugins.multistart import MultiStartSettings
from commonrail.plugins.paper import study as paper
from commonrail.plugins.paper.bench import Bench
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.plugins.paper.run import measure

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
        reached = [j for n, j in zip(self.evaluations, self.best, strict=True) if n <= evaluations]
        return reached[-1] if reached else float("inf")

    def reaching(self, objective: float) -> tuple[int, float] | None:
        """Evaluations and processor time [s] at which an objective was reached; None if it was not."""
        for n, seconds, j in zip(*self[:3], strict=True):
            if j <= objective:
                return n, seconds
        return None


def entries(problem: Problem) -> list[Entry]:
    """Optimisers that are compared; the first is the paper's."""
    wide = problem.difference
    return [
        Entry(PAPER, EvolutionSettings(generations=ENDLESS)),
        Entry("staged least squares", StagedSettings(generations=ENDLESS)),
        Entry("Kalman ensembles, staged least squares", StagedSettings(generations=ENDLESS, inversions=12)),
        Entry("multi-start least squares, 8 starts", MultiStartSettings(128, ENDLESS, 8, wide)),
        Entry("multi-start least squares, 2 starts", MultiStartSettings(64, ENDLESS, 2, wide)),
    ]


def search_once(
    study: Study, entry: Entry, seed: int, evaluations: int, clock: Callable[[], float] = CLOCKS.processor
) -> Trace:
    """Search on one thread until so many evaluations are made, or the optimiser ends by itself.

    The step that exceeds the evaluations is the last one; `clock` is the processor time of this process [s].
    """
    kind = registered(entry.settings)
    assert kind is not None  # an entry has the settings of an optimiser
    names, fit = study.space.names, of_role(study.data, Role.FIT)
    objective = Objective(study.injector, names, fit, study.time_step, 1, study.precision, goal=goal_of(study))
    optimiser = kind.begin(study.space, np.random.default_rng(seed), entry.settings)
    trace, evaluations_made, begin = Trace([], [], [], None), 0, clock()
    for step in steps(optimiser, objective):
        evaluations_made += step.simulations // objective.injections
        trace.evaluations.append(evaluations_made)
        trace.seconds.append(clock() - begin)
        trace.best.append(optimiser.best.cost)
        if evaluations_made >= evaluations:
            break
    verdict = optimiser.verdict
    return trace._replace(converged=verdict.converged if verdict is not None else None)


def contest(
    problems: Sequence[Problem],
    seeds: Sequence[int],
    evaluations: int = SLOTS,
    beginnings: Sequence[str] = (),
) -> Iterator[dict[str, Any]]:
    """Search every problem with every optimiser and seed, with so many evaluations each.

    `beginnings` of names select the optimisers, all by default; the paper's runs in any case. Each item is
    JSON-able: problem, optimiser, seed, converged, and evaluations, seconds, best after each step (None for +inf).
    """
    for problem in problems:
        for entry in entries(problem):
            if beginnings and entry.name != PAPER and not entry.name.startswith(tuple(beginnings)):
                continue
            search_once(problem.study, entry, 0, 1)  # compiles what it needs
            for seed in seeds:
                trace = search_once(problem.study, entry, seed, evaluations)
                best = [j if np.isfinite(j) else None for j in trace.best]
                row = {"problem": problem.name, "optimiser": entry.name, "seed": seed}
                yield row | trace._asdict() | {"best": best}


FINE, WIDE = 1e-4, 1e-2  # differences of the range for curves, and for maps, whose quantities jump


def problems_of(files: Sequence[Path], benches: int) -> list[Problem]:
    """The paper's case if no file is named, the studies of files, and so many virtual benches.

    Each bench has stiffnesses of its own, drawn from what the paper's bounds and ordering allow, and noise and scatter
    of its own. The curves are SYNTHETIC.
    """
    problems = [] if files else [Problem("paper", paper_study(), FINE)]
    for file in files:
        study = load_study(file)
        maps = any(isinstance(data, QuantityData) for data in study.data)
        name = file.absolute().parent.name if file.stem == "study" else file.stem
        problems.append(Problem(name, study, WIDE if maps else FINE))
    return problems + [_bench(number) for number in range(1, benches + 1)]


def _bench(number: int) -> Problem:
    """Virtual bench of a number: the default truth with drawn stiffnesses, and the paper's search for them."""
    truth, study = load_truth(INJECTOR), paper_study()
    drawn = sample_feasible(study.space, 1, np.random.default_rng([number, 7]))[0]
    values = {**truth.values, **dict(zip(study.space.names, drawn.tolist(), strict=True))}
    bench = Bench(replace(truth, values=values), injector(), TIME_STEP)
    (data,) = [data_set for data_set in measure(bench, number) if data_set.name == paper.FIT]
    return Problem(f"virtual bench {number}", replace(study, title=f"virtual bench {number}", data=(data,)), FINE)


NEAR = 1.01  # of the best known objective counts as reached


def rank_optimisers(rows: Sequence[dict[str, Any]], evaluations: int) -> list[dict[str, Any]]:
    """One row for each problem and optimiser, in the order of the contest.

    "tenth" and "end" are the median objectives after a tenth of the evaluations and after all; None before the first
    step. "near" is the share of the seeds that come within 1 % of the best known, of any search in `rows`;
    "near_evaluations" and "near_seconds" are their medians, None where half of the seeds do not. "equal_evaluations" is
    the median number until the median end of the paper's search is reached, None where half of the seeds do not reach
    it; "saving", how many times fewer than its own they are. "converged" is the share of the seeds that say so.
    """
    standings = []
    for problem in dict.fromkeys(row["problem"] for row in rows):
        problem_rows = [row for row in rows if row["problem"] == problem]
        traces = {
            name: [_trace(row) for row in problem_rows if row["optimiser"] == name] for name in _names(problem_rows)
        }
        best_known = min(min(trace.best) for group in traces.values() for trace in group)
        paper = median(trace.after(evaluations) for trace in traces[PAPER]) if PAPER in traces else None
        for name, group in traces.items():
            equal = _reached(group, paper) if paper is not None else (None, None, 0.0)
            near = _reached(group, NEAR * best_known)
            standings.append(
                {
                    "problem": problem,
                    "optimiser": name,
                    "seeds": len(group),
                    "best_known": best_known,
                    "tenth": _finite(median(trace.after(evaluations // 10) for trace in group)),
                    "end": _finite(median(trace.after(evaluations) for trace in group)),
                    "near": near[2],
                    "near_evaluations": near[0],
                    "near_seconds": near[1],
                    "equal_evaluations": equal[0],
                    "saving": evaluations / equal[0] if equal[0] else None,
                    "seconds": median(trace.seconds[-1] for trace in group),
                    "converged": sum(bool(trace.converged) for trace in group) / len(group),
                }
            )
    return standings


def _names(rows: Iterable[dict[str, Any]]) -> list[str]:
    return list(dict.fromkeys(row["optimiser"] for row in rows))


def _finite(objective: float) -> float | None:
    return objective if objective < float("inf") else None


def _trace(row: dict[str, Any]) -> Trace:
    best = [float("inf") if j is None else j for j in row["best"]]
    return Trace(row["evaluations"], row["seconds"], best, row["converged"])


def _reached(group: Sequence[Trace], objective: float) -> tuple[float | None, float | None, float]:
    """Median evaluations and seconds until an objective, None where half of the searches miss it, and their share."""
    hits = [trace.reaching(objective) for trace in group]
    share = sum(hit is not None for hit in hits) / len(hits)
    endless = (float("inf"), float("inf"))
    middle = [median((hit or endless)[i] for hit in hits) for i in (0, 1)]
    return (*(value if value < float("inf") else None for value in middle), share)  # type: ignore[return-value]
