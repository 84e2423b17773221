"""Classes, correlations, outliers and single injectors of a fleet."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.plugins.fleet import population
from commonrail.plugins.fleet.journal import FINISHED, Entry
from commonrail.plugins.fleet.population import InjectorValues, describe_population
from tests.plugins.fleet.conftest import calibrated


def fleet(values: dict[str, list[float]], costs: list[float]) -> list[Entry]:
    """Calibrated injectors with values between bounds 0 and 10."""
    records = (calibrated(cost, **{name: own[i] for name, own in values.items()}) for i, cost in enumerate(costs))
    return [Entry(f"I{i}", FINISHED, "", 1, {}, record, 1.0) for i, record in enumerate(records)]


def test_correlations_are_those_of_numpy() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(5.0, 1.0, (2, 50))
    found = describe_population(
        fleet({"a": a.tolist(), "b": (a + b).tolist(), "c": [3.0] * 50}, (a - b).tolist()), "abc"
    )
    matrix = found.correlations
    assert matrix[0][1] == pytest.approx(np.corrcoef(a, a + b)[0, 1], abs=1e-4)
    assert matrix[1][3] == pytest.approx(np.corrcoef(a + b, a - b)[0, 1], abs=1e-4)
    assert matrix[0][0] == 1.0
    assert matrix[2] == (None,) * 4  # it does not vary


def test_an_outlier_is_named_with_its_distance() -> None:
    own = [4.0, 4.5, 5.0, 5.5, 6.0, 9.9]
    (found,) = describe_population(fleet({"a": own}, [10.0] * 6), ["a"]).outliers
    assert (found.injector, found.name, found.value, found.median) == ("I5", "a", 9.9, 5.25)
    assert found.deviations == pytest.approx((9.9 - 5.25) / (1.4826 * 0.75), abs=0.01)


def test_classes_count_every_injector() -> None:
    histogram = describe_population(fleet({"a": [0.0, 0.1, 5.0, 10.0]}, [1.0] * 4), ["a"]).histograms["a"]
    assert (histogram.counts[0], histogram.counts[10], histogram.counts[-1]) == (2, 1, 1)
    assert sum(histogram.counts) == 4


def test_of_many_injectors_the_worst_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(population, "MOST_NUMBERS", 6)
    found = describe_population(fleet({"a": [1.0, 2.0, 3.0, 4.0]}, [1.0, 9.0, 2.0, 8.0]), ["a"])
    assert [one.injector for one in found.each] == ["I1", "I3"]
    assert found.more == 2
    assert found.each[0] == InjectorValues("I1", (100.0, 9.0), (2.0,))


def test_few_injectors_have_no_statistics() -> None:
    found = describe_population(fleet({"a": [1.0, 2.0]}, [1.0, 2.0]), ["a"])
    assert (found.correlations, found.outliers) == ((), ())
