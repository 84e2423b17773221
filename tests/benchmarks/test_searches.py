"""Searches by other optimisers share one objective; what is extrapolated says so."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import searches
from benchmarks.case import paper_study
from benchmarks.searches import (
    OPTIMISERS,
    OWN,
    Optimiser,
    Scalar,
    Searched,
    Tally,
    measure_search,
    reference_searches,
)
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import Solution
from commonrail.physics.injector import Injector


def test_only_what_keeps_to_the_ordering_can_be_best() -> None:
    study = paper_study()
    tally = Tally(study, 1)
    backwards = study.space.upper - (study.space.centre - study.space.lower)
    assert not study.space.satisfies(backwards)
    costs = tally.costs(np.array([study.space.centre, backwards]))
    assert tally.simulations == 2
    assert tally.best == costs[0]


@pytest.mark.parametrize("optimiser", OPTIMISERS, ids=lambda o: o.package)
def test_every_optimiser_improves_on_the_start(optimiser: Optimiser) -> None:
    pytest.importorskip(optimiser.module, reason="an extra")
    found = optimiser.run(paper_study(1, 4))
    start = Tally(paper_study(), 1)
    start.costs(start.space.reference[None, :])
    assert 0 < found.simulations <= 50 * 5
    assert found.best < start.best


def test_a_search_by_the_reference_is_extrapolated_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0

    def slow(injector: Injector, point: OperatingPoint, interval: float) -> Solution:
        nonlocal now
        now += 2.0
        return simulate(injector, point, time_step=1e-6, sample_interval=interval)

    monkeypatch.setattr(searches, "SCALARS", (Scalar("slow", slow),))
    (row,) = reference_searches(5, lambda: now)
    assert row["measured_simulations"] == 5
    assert row["simulations"] == 50 * 71
    assert row["seconds"] == pytest.approx(2.0 * 50 * 71)
    assert row["extrapolated"] is True
    assert row["J"] is None


def test_too_few_members_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="5 members"):
        next(reference_searches(4))


def test_a_row_says_what_the_search_found() -> None:
    made = []

    def run(study: searches.Study) -> Searched:
        made.append(study.method.evolution.generations)
        return Searched(2.5, None, 100, float("inf"))

    row = measure_search(Optimiser("a name", "a package", "a_module", "repair", run), 3)
    assert made == [1, 70]  # the first, short one loads what the second needs
    assert (row["optimiser"], row["seed"], row["seconds"], row["simulations"]) == ("a name", 3, 2.5, 100)
    assert row["J"] is None
    assert row["extrapolated"] is False


def test_the_own_search_improves_on_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searches, "paper_study", lambda seed, generations=4: paper_study(seed, min(generations, 4)))
    row = measure_search(OWN, 1)
    start = searches.calibrate(paper_study(1, 1)).start_cost
    assert row["simulations"] == 50 * 5
    assert row["J"] < start
