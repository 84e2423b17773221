"""The paper's calibration by other optimisers, on the same lanes and data, with about as many simulations.

Each optimiser keeps to the bounds (16) and the ordering (14), (15) in its own way; none is tuned. The cost of a search
by a scalar solver is extrapolated from a measured part, and marked so."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from benchmarks.case import paper_study
from benchmarks.methods import COARSE
from benchmarks.solvers import PeerModel, solve_with
from benchmarks.timing import CLOCKS
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.objective import Objective
from commonrail.calibration.run import calibrate
from commonrail.calibration.space import sample_feasible
from commonrail.calibration.study import Study
from commonrail.data.curves.data import RateData
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.solution import Solution
from commonrail.physics.injector import Injector


class Searched(NamedTuple):
    """Time of a search, of which of its simulations (None: not measured) [s]; simulations, J of the best feasible."""

    seconds: float
    simulating_seconds: float | None
    simulations: int
    best: float


class Optimiser(NamedTuple):
    """An optimiser: its package and module, how it keeps to the ordering (14), (15), and how it runs a study."""

    name: str
    package: str
    module: str
    ordering: str
    run: Callable[[Study], Searched]


def measure_search(optimiser: Optimiser, seed: int) -> dict[str, Any]:
    """Row of one search with one seed, after a short one that loads what it needs; J is None where it is not finite."""
    optimiser.run(paper_study(seed, generations=1))
    search = optimiser.run(paper_study(seed))
    return {
        "optimiser": optimiser.name,
        "package": optimiser.package,
        "ordering": optimiser.ordering,
        "seed": seed,
        "seconds": search.seconds,
        "simulating_seconds": search.simulating_seconds,
        "simulations": search.simulations,
        "J": search.best if np.isfinite(search.best) else None,
        "extrapolated": False,
    }


def _calibrate(study: Study) -> Searched:
    calibration = calibrate(study)
    if calibration.status == "interrupted":
        raise KeyboardInterrupt
    return Searched(calibration.seconds, None, calibration.simulations, calibration.cost)


OWN = Optimiser("differential evolution of the paper", "commonrail", "commonrail", "repair", _calibrate)


FAILED = 1e6  # stands for +inf where an optimiser cannot take it
MEASURED = 8  # simulations from which a search by the reference is extrapolated; SciPy takes no fewer than 5 members
PENALTY = 1e3  # cost of a broken constraint, by its span


class Tally:
    """The objective of a study that counts candidates, times itself and remembers the best feasible one."""

    def __init__(self, study: Study, threads: int | None = None) -> None:
        self.study, self.space = study, study.space
        self.objective = Objective(study.injector, study.space.names, study.data, study.time_step, threads)
        self.simulations, self.seconds, self.best = 0, 0.0, float("inf")

    def costs(self, x: Floats) -> Floats:
        """J of candidates (n, 7)."""
        begin = time.perf_counter()
        costs = self.objective.costs(x).costs
        self.seconds += time.perf_counter() - begin
        self.simulations += len(x)
        within = costs[self.space.satisfies(x)]
        self.best = float(min(self.best, within.min(initial=np.inf)))
        return np.where(np.isfinite(costs), costs, FAILED)

    def start(self) -> Floats:
        """A feasible first population."""
        return sample_feasible(self.space, self.study.method.evolution.members, np.random.default_rng(self.study.seed))


class Scalar(NamedTuple):
    """A solver that simulates one candidate after another, and the name it goes by."""

    name: str
    solve: Callable[[Injector, OperatingPoint, float], Solution]


def _lsoda(resolution: Resolution) -> Scalar:
    def solve(injector: Injector, point: OperatingPoint, interval: float) -> Solution:
        return solve_with(PeerModel(injector, point, resolution), interval).solution

    return Scalar(f"LSODA, rtol {resolution.relative:g}, {resolution.cells[0]} cells", solve)


def _march(resolution: Resolution) -> Scalar:
    def solve(injector: Injector, point: OperatingPoint, interval: float) -> Solution:
        return simulate_reference(injector, point, interval, resolution)

    return Scalar(f"compiled RK4, {resolution.step * 1e9:g} ns, {resolution.cells[0]} cells", solve)


# The reference's resolution, then two that are about as wrong as the lanes.
SCALARS = (
    _lsoda(Resolution()),
    _lsoda(COARSE),
    _march(COARSE._replace(method="explicit", step=1e-7)),
)


def reference_searches(count: int = MEASURED, clock: Callable[[], float] = CLOCKS.wall) -> Iterator[dict[str, Any]]:
    """SciPy's differential evolution on scalar solvers: `count` simulations are measured, the rest extrapolated.

    Items are as those of `measure_search`, on one core; J is None, and measured_simulations says how many were made.
    ConfigurationError if there are fewer members than SciPy takes.
    """
    if count < 5:
        raise ConfigurationError(f"SciPy's differential evolution needs 5 members or more, not {count}.")
    study = paper_study()
    for scalar in SCALARS:
        measured, seconds = _first_generation(study, scalar, count, clock)
        settings = study.method.evolution
        simulations = (1 + settings.generations) * settings.members
        total = seconds / measured * simulations
        yield {
            "optimiser": f"differential_evolution on {scalar.name}",
            "package": "SciPy",
            "ordering": "not searched to the end",
            "seed": study.seed,
            "seconds": total,
            "simulating_seconds": total,
            "simulations": simulations,
            "J": None,
            "extrapolated": True,
            "measured_simulations": measured,
        }


def _first_generation(study: Study, scalar: Scalar, count: int, clock: Callable[[], float]) -> tuple[int, float]:
    """Simulations of SciPy's first generation of feasible members, and their time on one core [s]."""
    from scipy.optimize import differential_evolution

    data, space = study.data[0], study.space
    assert isinstance(data, RateData)
    interval = float(data.bounds[1] - data.bounds[0])
    spent: list[float] = []

    def cost(x: Floats) -> float:
        begin = clock()
        candidate = study.injector.with_values(dict(zip(space.names, x.tolist(), strict=True)))
        solution = scalar.solve(candidate, data.point, interval)
        spent.append(clock() - begin)
        return float(np.nan_to_num(data.misfit(solution.rate), nan=FAILED))

    cost(space.reference)  # loads the kernels
    spent.clear()
    members = sample_feasible(space, count, np.random.default_rng(1))
    differential_evolution(cost, _bounds(study), init=members, maxiter=0, polish=False, rng=1)
    return len(spent), sum(spent)


def _scipy(tally: Tally) -> None:
    from scipy.optimize import LinearConstraint, differential_evolution

    study, space = tally.study, tally.space
    settings = study.method.evolution
    order = LinearConstraint(space.rows.matrix, space.rows.lower, np.inf)
    differential_evolution(
        lambda x: tally.costs(np.ascontiguousarray(x.T)),
        _bounds(study),
        strategy="rand1bin",
        maxiter=settings.generations,
        init=tally.start(),
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        constraints=order,
        rng=study.seed,
    )


def _pymoo(tally: Tally) -> None:
    from pymoo.algorithms.soo.nonconvex.de import DE
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize

    space, settings = tally.space, tally.study.method.evolution

    class Paper(Problem):  # type: ignore[misc]
        def _evaluate(self, x: Floats, out: dict[str, Floats], *_: Any, **__: Any) -> None:
            out["F"], out["G"] = tally.costs(x)[:, None], space.shortfall(x)

    problem = Paper(
        n_var=space.dimension, n_obj=1, n_ieq_constr=len(space.rows), xl=space.lower.copy(), xu=space.upper.copy()
    )
    algorithm = DE(pop_size=settings.members, sampling=tally.start(), variant="DE/rand/1/bin")
    minimize(problem, algorithm, ("n_gen", settings.generations + 1), seed=tally.study.seed, verbose=False)


def _cma(tally: Tally) -> None:
    import cma

    study, space = tally.study, tally.space
    settings = study.method.evolution
    options = {
        "bounds": [0.0, 1.0],
        "popsize": settings.members,
        "maxiter": settings.generations + 1,
        "seed": study.seed,
        "verbose": -9,
        "tolfun": 0.0,
        "tolfunhist": 0.0,
        "tolx": 0.0,
    }
    search = cma.CMAEvolutionStrategy(space.to_unit(space.centre), 0.3, options)
    while not search.stop():
        asked = search.ask()
        x = space.from_unit(np.clip(np.array(asked), 0.0, 1.0))
        inside = space.pull_back(np.tile(space.centre, (len(x), 1)), x)
        search.tell(asked, (tally.costs(inside) + PENALTY * space.violation(x)).tolist())


def _bounds(study: Study) -> list[tuple[float, float]]:
    return list(zip(study.space.lower.tolist(), study.space.upper.tolist(), strict=True))


def _time_search(search: Callable[[Tally], None]) -> Callable[[Study], Searched]:
    """Time a search on the objective of a study."""

    def run(study: Study) -> Searched:
        tally = Tally(study)
        begin = time.perf_counter()
        search(tally)
        return Searched(time.perf_counter() - begin, tally.seconds, tally.simulations, tally.best)

    return run


OPTIMISERS = (
    Optimiser("differential_evolution", "SciPy", "scipy", "LinearConstraint", _time_search(_scipy)),
    Optimiser("DE/rand/1/bin", "pymoo", "pymoo", "inequality constraints", _time_search(_pymoo)),
    Optimiser("CMA-ES", "pycma", "cma", "pulled back, with a penalty", _time_search(_cma)),
)
