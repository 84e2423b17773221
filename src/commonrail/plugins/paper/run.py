"""Repetitions of the paper's study for many seeds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

import commonrail as cr
from commonrail.base.arrays import Floats
from commonrail.plugins.paper import study as paper
from commonrail.plugins.paper.study import Configuration

# One repetition of the paper's study: one synthetic measurement and every search on it.

# Models that are compared with the experiment.
LABELS = {
    "rigid": "rigid body",
    "rigid_fitted": "rigid body, stop and control volume fitted",
    "theoretical": "theoretical",
    "paper": "paper's optimal k",
    "optimised": "optimised",
}

# Meter models that a fit applies to the simulation.
METERED = {"known": "the bench's low-passes, known", "delay": "a delay, fitted"}


@dataclass(frozen=True)
class Found:
    """End of one search: best values (d,) of the free parameters [SI] and their J, +inf if no simulation succeeded.

    `members` (generations + 1, members, d) is the population after every generation [SI]; `injections` were simulated.
    """

    x: Floats
    cost: float
    counts: cr.fit.Counts
    history: tuple[cr.fit.Generation, ...]
    members: Floats
    injections: int


class StiffnessCertainty(NamedTuple):
    """Certainty of a stiffness [SI], as a run reports it; None for an end that the data do not bound, or no error."""

    lower: float | None
    upper: float | None
    standard_error: float | None
    verdict: str


@dataclass(frozen=True)
class Repetition:
    """All outcomes of one seed, whose `data` are the measurement at 160, 120 and 80 MPa.

    `space` and `rigid_space` have the bounds and ordering of k1…k7, and the bounds of the rigid body's stop and control
    volume. `rates` (3, samples) are simulated rates of injection [m³/s] by label of `LABELS`; NaN if the simulation
    failed. `best` is the search with (70, 50) generations and members at 160 MPa; `table3` has each search at 160 MPa
    with J (3,) of its best candidate at all pressures. `own_curve_searches` has a search (70, 50) on each validation
    curve; `rigid` is the rigid body fitted at 160 MPa. `random_j` (3, members) is J of random feasible stiffnesses, the
    first population of `best`. `identified` is the certainty of each stiffness from the curve at 160 MPa, by name;
    empty if no simulation succeeded. `metered` has, by label of `METERED`, the search (70, 50) at 160 MPa with a meter,
    and J (3,) of its best candidate.
    """

    seed: int
    data: tuple[cr.RateData, ...]
    space: cr.fit.Space
    rigid_space: cr.fit.Space
    rates: dict[str, Floats]
    best: Found
    table3: dict[Configuration, tuple[Found, Floats]]
    treatments: dict[str, Found]
    own_curve_searches: dict[str, Found]
    rigid: Found
    random_j: Floats
    identified: dict[str, StiffnessCertainty]
    metered: dict[str, tuple[Found, Floats]]

    @property
    def searches(self) -> Iterator[Found]:
        """Every search once."""
        for configuration, (search, _) in self.table3.items():
            if configuration != paper.BEST:
                yield search
        yield from self.treatments.values()  # with (70, 50)
        yield from self.own_curve_searches.values()
        yield from (search for search, _ in self.metered.values())
        yield self.rigid


def generations_of_one() -> int:
    """Generations that one repetition runs, initial populations included."""
    table3 = sum(c.generations + 1 for c in paper.CONFIGURATIONS)
    others = len(paper.TREATMENTS) - 1 + len(paper.VALIDATION) + len(METERED)
    return table3 + others * (paper.BEST.generations + 1) + paper.RIGID_FIT.generations + 1


def repeat(bench: cr.lab.Bench, seed: int, after: Callable[[], None]) -> Repetition:
    """Measure and search, on one thread, because repetitions run side by side.

    The seed determines the measurement's scatter and noise, and every search. `after` is called after every generation;
    what it raises ends the repetition. SimulationError if the truth cannot be simulated.
    """
    data = measure(bench, seed)
    fit = data[0]
    flexible, stiff = _models(bench)
    best = flexible.search(fit, paper.BEST.settings, seed, after)
    configurations = {
        c: best if c == paper.BEST else flexible.search(fit, c.settings, (seed, c.generations, c.members), after)
        for c in paper.CONFIGURATIONS
    }
    treatments = {t.name: flexible.search(fit, t.settings, seed, after) for t in paper.TREATMENTS[1:]}
    own_curve_searches = {d.name: flexible.search(d, paper.BEST.settings, seed, after) for d in data[1:]}
    rigid = stiff.search(fit, paper.RIGID_FIT, seed, after)
    optimal = np.array([paper.TABLE1_OPTIMAL[name] for name in flexible.space.names])
    shown = {
        "rigid": (stiff, stiff.space.reference),
        "rigid_fitted": (stiff, rigid.x),
        "theoretical": (flexible, flexible.space.reference),
        "paper": (flexible, optimal),
        "optimised": (flexible, best.x),
    }
    return Repetition(
        seed,
        data,
        flexible.space,
        stiff.space,
        {label: model.rates(data, x) for label, (model, x) in shown.items()},
        best,
        {c: (search, flexible.costs(data, search.x[None, :])[:, 0]) for c, search in configurations.items()},
        {paper.TREATMENTS[0].name: best, **treatments},
        own_curve_searches,
        rigid,
        flexible.costs(data, best.members[0]),
        flexible.certainty(fit, best, seed) if np.isfinite(best.cost) else {},
        dict(_with_meters(bench, data, seed, after)),
    )


def _with_meters(
    bench: cr.lab.Bench, data: Sequence[cr.RateData], seed: int, after: Callable[[], None]
) -> Iterator[tuple[str, tuple[Found, Floats]]]:
    """Searches with a meter model: the bench's own low-passes, or a delay that is also fitted."""
    flexible, _ = _models(bench)
    free = flexible._replace(space=cr.fit.Space([*flexible.space.parameters, paper.DELAY], [paper.ORDER]))
    true_meter = bench.truth.rate_meter.as_meter(paper.METER)
    for label, model, meter in (("known", flexible, true_meter), ("delay", free, cr.Meter(paper.METER))):
        seen = [d.changed(meter=meter) for d in data]
        search = model.search(seen[0], paper.BEST.settings, seed, after)
        yield label, (search, model.costs(seen, search.x[None, :])[:, 0])


def measure(bench: cr.lab.Bench, seed: int) -> tuple[cr.RateData, ...]:
    """Synthetic measurement of one seed: curves at 160, 120 and 80 MPa with their rail pressure traces."""
    curves = []
    for name, rail_pressure in paper.RAIL_PRESSURES.items():
        curve = cr.lab.bench_curve(bench.truth, bench.injector, rail_pressure, paper.ENERGISING_TIME, seed)
        bounds = np.concatenate(([0.0], curve.time))
        rail = cr.Trace.of(curve.trace_time, curve.rail)
        point = cr.OperatingPoint(rail, paper.ENERGISING_TIME, horizon=float(curve.time[-1]))
        role = cr.data.Role.FIT if name == paper.FIT else cr.data.Role.VALIDATION
        source = f"virtual test bench of commonrail, seed {seed}"
        curves.append(cr.RateData(name, role, point, bounds, curve.rate, 1.0, source, bench.truth.synthetic))
    return tuple(curves)


def search(
    bench: cr.lab.Bench, data: cr.RateData, settings: cr.fit.EvolutionSettings, seed: int | tuple[int, ...]
) -> Found:
    """Fit k1…k7 to one curve; `seed`: seed of the search."""
    return _models(bench)[0].search(data, settings, seed, lambda: None)


class _Model(NamedTuple):
    """Subject of a search: an injector with its body, and its free parameters; the time step [s]."""

    injector: cr.Injector
    space: cr.fit.Space
    time_step: float

    def objective(self, data: cr.RateData) -> cr.fit.Objective:
        """Objective of one curve."""
        return cr.fit.Objective(self.injector, self.space.names, [data], self.time_step, threads=1)

    def search(
        self,
        data: cr.RateData,
        settings: cr.fit.EvolutionSettings,
        seed: int | tuple[int, ...],
        after: Callable[[], None],
    ) -> Found:
        """Fit the free parameters to one curve by differential evolution; `after` is called after every generation."""
        optimiser = cr.fit.DifferentialEvolution(self.space, np.random.default_rng(seed), settings)
        history: list[cr.fit.Generation] = []
        members: list[Floats] = []
        injections = 0
        for step in cr.fit.steps(optimiser, self.objective(data)):
            injections += step.simulations
            history.append(cr.fit.Generation.of(len(history), optimiser))
            members.append(optimiser.population)
            after()
        best = optimiser.best
        return Found(best.x, best.cost, optimiser.counts, tuple(history), np.array(members), injections)

    def certainty(self, data: cr.RateData, search: Found, seed: int) -> dict[str, StiffnessCertainty]:
        """Interval, standard error and verdict of each free parameter from one curve, computed as for a run's report.

        `search`: result of the search on that curve; `seed`: seed of the measurement.
        """
        method = cr.fit.Method(paper.BEST.settings)
        study = cr.Study(data.name, self.injector, (data,), self.space, method, seed, self.time_step)
        best = dict(zip(self.space.names, search.x.tolist(), strict=True))
        parameters = cr.certainty(study, best, threads=1).record()["parameters"]
        estimates = [StiffnessCertainty(*map(row.get, StiffnessCertainty._fields)) for row in parameters]
        return dict(zip(self.space.names, estimates, strict=True))

    def costs(self, data: Sequence[cr.RateData], x: Floats) -> Floats:
        """J of values (n, d) on each curve (curves, n)."""
        return np.array([self.objective(d).misfits(x)[:, 0] for d in data])

    def rates(self, data: Sequence[cr.RateData], x: Floats) -> Floats:
        """Rate of injection (curves, samples) [m³/s] with the values x (d,)."""
        return np.array([d.simulated(self.objective(d).simulator, x[None, :])[0] for d in data])


def _models(bench: cr.lab.Bench) -> tuple[_Model, _Model]:
    """Flexible model with k1…k7 free, and rigid one with stop and control volume free."""
    injector = bench.injector
    flexible, rigid = (
        replace(injector, variant=injector.variant._replace(body=body))
        for body in (cr.models.Body.FLEXIBLE, cr.models.Body.RIGID)
    )
    return (
        _Model(flexible, paper.space(injector), bench.time_step),
        _Model(rigid, paper.rigid_space(injector), bench.time_step),
    )


@dataclass(frozen=True)
class Reproduction:
    """Outcome of all repetitions.

    Attributes
    ----------
    bench : Bench
    repetitions : tuple of Repetition
        In the order of the requested seeds, without interrupted repetitions.
    asked : int
        Number of requested repetitions.
    seconds : float
    """

    bench: cr.lab.Bench
    repetitions: tuple[Repetition, ...]
    asked: int
    seconds: float

    @property
    def status(self) -> str:
        """ "finished", or "interrupted" if repetitions are missing."""
        return "finished" if len(self.repetitions) == self.asked else "interrupted"


def reproduce(
    bench: cr.lab.Bench,
    seeds: Sequence[int],
    *,
    threads: int | None = None,
    progress: Callable[[cr.lab.SeedProgress], None] | None = None,
) -> Reproduction:
    """Repeat the paper's study once for each seed.

    Every figure depends on its seed alone, not on the threads. Ctrl-C ends in order: repetitions that are complete
    are kept.

    Parameters
    ----------
    bench : Bench
    seeds, threads, progress
        As for `for_seeds`, which lists further exceptions.

    Raises
    ------
    SimulationError
        If the truth cannot be simulated.
    """
    if not isinstance(bench, cr.lab.Bench):
        raise cr.errors.ConfigurationError(
            f"The bench must be a Bench, not a {type(bench).__name__}; "
            "write commonrail.lab.Bench(truth, injector, time_step)."
        )
    start = time.perf_counter()
    repetitions = cr.lab.for_seeds(
        lambda seed, after: repeat(bench, seed, after),
        seeds,
        generations=generations_of_one(),
        threads=threads,
        progress=progress,
    )
    return Reproduction(bench, repetitions, len(seeds), time.perf_counter() - start)
