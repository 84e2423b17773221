"""The paper's calibration as a row of the record."""

from __future__ import annotations

import pytest

from commonrail.bench import searches
from commonrail.bench.case import paper_study
from commonrail.bench.searches import OWN, Optimiser, Searched, measure_search


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
