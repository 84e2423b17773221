"""A study that is built, run, judged and reported with public names alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import commonrail as cr

NAMES = ("plunger_needle.k1", "plunger_needle.k6")


@pytest.fixture(scope="module")
def study() -> cr.Study:
    """Two stiffnesses fitted to one synthetic curve, in three generations."""
    injector = cr.load_injector("virtual-lino-2016")
    curve = cr.lab.bench_curve(cr.lab.load_truth("virtual-lino-2016"), injector, "160 MPa", "700 us", 1)
    point = cr.OperatingPoint(cr.Trace.of(curve.trace_time, curve.rail), "700 us", horizon=float(curve.time[-1]))
    bounds = np.concatenate(([0.0], curve.time))
    data = cr.RateData("160 MPa", cr.data.Role.FIT, point, bounds, curve.rate, 1.0, "bench", "simulated, not measured")
    parameters = []
    for name in NAMES:
        value = injector.values[name]
        low, high = cr.fit.percent_bounds(value, 50.0, 100.0, name)
        parameters.append(cr.Parameter(name, value, low, high, "N/m", mark="E", source="drawing"))
    space = cr.fit.Space(parameters, [f"{NAMES[0]} < {NAMES[1]}"])
    settings = cr.fit.EvolutionSettings(8, 2)
    return cr.Study("two stiffnesses", injector, (data,), space, cr.fit.Method(settings), 1, 1e-6)


def test_it_is_run_judged_and_reported(study: cr.Study, tmp_path: Path) -> None:
    found = cr.calibrate(study)
    assert found.cost <= found.start_cost
    run = cr.runs.create_run_folder(tmp_path / "run")
    cr.runs.write_run(run, found, cr.fit.identify(found))
    (judged,) = cr.compare({"best": found.injector}, study).scores["best"]
    assert judged.j == pytest.approx(found.cost, rel=1e-9)
    assert "two stiffnesses" in cr.write_report(run).read_text(encoding="utf-8")


def test_an_optimiser_is_asked_and_told(study: cr.Study) -> None:
    optimiser = cr.fit.DifferentialEvolution(study.space, np.random.default_rng(study.seed), study.method.evolution)
    history = [
        cr.fit.Generation.of(number, optimiser)
        for number, _ in enumerate(cr.fit.steps(optimiser, study.objective(threads=1)))
    ]
    found = cr.calibrate(study)
    assert tuple(history) == found.history
    assert optimiser.best.cost == found.cost


def test_searches_for_many_seeds_are_those_of_each_alone(study: cr.Study) -> None:
    told: list[cr.lab.SeedProgress] = []

    def search(seed: int, after: object) -> float:
        optimiser = cr.fit.DifferentialEvolution(study.space, np.random.default_rng(seed), study.method.evolution)
        for _ in cr.fit.steps(optimiser, study.objective(threads=1)):
            after()
        return optimiser.best.cost

    both = cr.lab.for_seeds(search, [3, 4], generations=3, threads=2, progress=told.append)
    assert both == (search(3, lambda: None), search(4, lambda: None))
    assert told[-1][:4] == (6, 6, 2, 2)
