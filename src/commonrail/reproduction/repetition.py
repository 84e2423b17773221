"""One repetition of the paper's study: one synthetic measurement and every search on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.identifiability import identify_at
from commonrail.analysis.virtual_bench import Truth, bench_curve
from commonrail.calibration.checkpoint import Generation
from commonrail.calibration.objective import Objective
from commonrail.calibration.optimisers import Counts, DifferentialEvolution, EvolutionSettings
from commonrail.calibration.search import generations
from commonrail.calibration.space import Space
from commonrail.choices import Body
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.injector.definition import Injector
from commonrail.kinds import RateData, Role
from commonrail.reproduction import paper
from commonrail.reproduction.paper import Configuration

__all__ = ["LABELS", "Bench", "Found", "Repetition", "generations_of_one", "measure", "repeat", "search"]

Floats = NDArray[np.float64]

# Models that are set beside the experiment.
LABELS = {
    "rigid": "rigid body",
    "rigid_fitted": "rigid body, stop and control volume fitted",
    "theoretical": "theoretical",
    "paper": "paper's optimal k",
    "optimised": "optimised",
}


class Bench(NamedTuple):
    """What is measured and what is fitted to it: the hidden truth, the injector as drawn, the time step [s]."""

    truth: Truth
    injector: Injector
    time_step: float


@dataclass(frozen=True)
class Found:
    """End of one search.

    Attributes
    ----------
    x : (d,)
        Best values of the d free parameters, the stiffness k1…k7 but for the rigid body [SI].
    cost : float
        Its J; +inf if no simulation succeeded.
    counts : Counts
    history : tuple of Generation
    members : (generations + 1, members, d)
        The population after every generation [SI].
    injections : int
        Simulated.
    """

    x: Floats
    cost: float
    counts: Counts
    history: tuple[Generation, ...]
    members: Floats
    injections: int


@dataclass(frozen=True)
class Repetition:
    """All outcomes of one seed.

    Attributes
    ----------
    seed : int
    data : tuple of RateData
        The measurement at 160, 120 and 80 MPa.
    space, rigid_space : Space
        Bounds and ordering of k1…k7; bounds of the rigid body's stop and control volume.
    rates : dict of str to (3, samples) array
        Simulated rate of injection [m³/s] by label of `LABELS`, in the order of `data`; NaN if the simulation failed.
    best : Found
        Search (70, 50) at 160 MPa.
    table3 : dict of Configuration to (Found, (3,) array)
        Each search at 160 MPa and the J of its best at all pressures.
    treatments : dict of str to Found
    own : dict of str to Found
        Searches (70, 50) on each of the validation curves.
    rigid : Found
        Stop and control volume of a rigid body, fitted at 160 MPa.
    random_j : (3, members) array
        J at all pressures of random feasible stiffness: of the best search's first population.
    identified : dict
        What the curve at 160 MPa says of each stiffness, see `identify_at`.
    """

    seed: int
    data: tuple[RateData, ...]
    space: Space
    rigid_space: Space
    rates: dict[str, Floats]
    best: Found
    table3: dict[Configuration, tuple[Found, Floats]]
    treatments: dict[str, Found]
    own: dict[str, Found]
    rigid: Found
    random_j: Floats
    identified: dict[str, dict[str, Any]]

    @property
    def searches(self) -> Iterator[Found]:
        """Every search once."""
        for configuration, (found, _) in self.table3.items():
            if configuration != paper.BEST:
                yield found
        yield from self.treatments.values()  # with (70, 50)
        yield from self.own.values()
        yield self.rigid


def generations_of_one() -> int:
    """Generations that one repetition runs, initial populations included."""
    table3 = sum(c.generations + 1 for c in paper.CONFIGURATIONS)
    others = len(paper.TREATMENTS) - 1 + len(paper.VALIDATION)
    return table3 + others * (paper.BEST.generations + 1) + paper.RIGID_FIT.generations + 1


def repeat(bench: Bench, seed: int, after: Callable[[], None]) -> Repetition:
    """Measure and search.

    Parameters
    ----------
    bench : Bench
    seed : int
        Of the measurement's scatter and noise, and of every search.
    after : function
        Called after every generation; what it raises ends the repetition.

    Raises
    ------
    SimulationError
        If the truth cannot be simulated.
    """
    data = measure(bench, seed)
    run = _Searches(bench, data, after)
    fit = data[0]
    best = run.search(fit, paper.BEST.settings, seed)
    configurations = {
        c: best if c == paper.BEST else run.search(fit, c.settings, (seed, c.generations, c.members))
        for c in paper.CONFIGURATIONS
    }
    treatments = {t.name: run.search(fit, t.settings, seed) for t in paper.TREATMENTS[1:]}
    own = {d.name: run.search(d, paper.BEST.settings, seed) for d in data[1:]}
    rigid = run.search(fit, paper.RIGID_FIT, seed, run.rigid)
    return Repetition(
        seed,
        data,
        run.space,
        run.rigid.space,
        run.model_rates(best.x, rigid.x),
        best,
        {c: (found, run.costs(found.x[None, :])[:, 0]) for c, found in configurations.items()},
        {paper.TREATMENTS[0].name: best, **treatments},
        own,
        rigid,
        run.costs(best.members[0]),
        identify_at(run.space, run.objective(fit), best.x) if np.isfinite(best.cost) else {},
    )


def measure(bench: Bench, seed: int) -> tuple[RateData, ...]:
    """The synthetic measurement of one seed: curves at 160, 120 and 80 MPa with their rail pressure traces."""
    found = []
    for name, rail_pressure in paper.RAIL_PRESSURES.items():
        curve = bench_curve(bench.truth, bench.injector, rail_pressure, paper.ENERGISING_TIME, seed)
        bounds = np.concatenate(([0.0], curve.time))
        point = OperatingPoint(
            Trace.of(curve.trace_time, curve.rail), paper.ENERGISING_TIME, horizon=float(curve.time[-1])
        )
        role = Role.FIT if name == paper.FIT else Role.VALIDATION
        source = f"virtual test bench of commonrail, seed {seed}"
        found.append(RateData(name, role, point, bounds, curve.rate, 1.0, source, bench.truth.synthetic))
    return tuple(found)


def search(bench: Bench, data: RateData, settings: EvolutionSettings, seed: int | tuple[int, ...]) -> Found:
    """Fit k1…k7 to one curve."""
    return _Searches(bench, (data,), lambda: None).search(data, settings, seed)


class _Model(NamedTuple):
    """Subject of a search: free parameters, and how plunger and needle move."""

    space: Space
    body: Body


class _Searches:
    """Searches and simulations of one repetition; on one thread, because repetitions run side by side."""

    def __init__(self, bench: Bench, data: tuple[RateData, ...], after: Callable[[], None]) -> None:
        self.bench, self.data, self.after = bench, data, after
        self.flexible = _Model(paper.space(bench.injector), Body.FLEXIBLE)
        self.rigid = _Model(paper.rigid_space(bench.injector), Body.RIGID)

    @property
    def space(self) -> Space:
        """Bounds and ordering of k1…k7."""
        return self.flexible.space

    def objective(self, data: RateData, model: _Model | None = None) -> Objective:
        """Objective of one curve, of the flexible model unless another is given."""
        space, body = model or self.flexible
        injector = self.bench.injector
        injector = replace(injector, variant=injector.variant._replace(body=body))
        return Objective(injector, space.names, [data], self.bench.time_step, threads=1)

    def search(
        self,
        data: RateData,
        settings: EvolutionSettings,
        seed: int | tuple[int, ...],
        model: _Model | None = None,
    ) -> Found:
        """Differential evolution on one curve."""
        model = model or self.flexible
        optimiser = DifferentialEvolution(model.space, np.random.default_rng(seed), settings)
        history: list[Generation] = []
        members: list[Floats] = []
        injections = 0
        for trials in generations(optimiser, self.objective(data, model)):
            injections += trials.simulations
            history.append(Generation.of(len(history), optimiser))
            members.append(optimiser.population)
            self.after()
        best = optimiser.best
        return Found(best.x, best.cost, optimiser.counts, tuple(history), np.array(members), injections)

    def costs(self, x: Floats) -> Floats:
        """J of stiffness (n, 7) at all pressures (3, n)."""
        return np.array([self.objective(d).misfits(x)[:, 0] for d in self.data])

    def model_rates(self, best: Floats, fitted: Floats) -> dict[str, Floats]:
        """Rates of the models of `LABELS` at all pressures, given the best stiffness and the rigid body's best."""
        theoretical = self.space.reference
        optimal = np.array([paper.TABLE1_OPTIMAL[name] for name in self.space.names])
        models = {
            "rigid": (self.rigid, self.rigid.space.reference),
            "rigid_fitted": (self.rigid, fitted),
            "theoretical": (self.flexible, theoretical),
            "paper": (self.flexible, optimal),
            "optimised": (self.flexible, best),
        }
        return {
            label: np.array([d.simulated(self.objective(d, model).simulator, x[None, :])[0] for d in self.data])
            for label, (model, x) in models.items()
        }
