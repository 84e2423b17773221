"""Statistics over repeated shots: intervals hold the truth as often as they say; a shot that stands apart is named."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.plugins.features.rate_trace import RateTrace
from commonrail.plugins.features.result import Features
from commonrail.plugins.features.run import find_features
from commonrail.plugins.features.shot_statistics import ShotStatistic, shot_statistics
from tests.plugins.features.analytic import PEAK, noisy, trapezoid

QUANTITY = 575e-6 * PEAK


def shots(count: int, seed: int, scatter: float = 0.02) -> list[Features]:
    """Shots of one injection whose rate scatters by a factor."""
    factors = 1.0 + scatter * np.random.default_rng(seed).normal(size=count)
    return [with_quantity(factor * QUANTITY) for factor in factors.tolist()]


def with_quantity(value: float) -> Features:
    (one,) = BASE.injections
    return replace(BASE, injections=(replace(one, values={**one.values, "quantity": value}),))


def scaled(factor: float) -> RateTrace:
    trace = trapezoid(end=1.3e-3)
    return RateTrace(trace.bounds, factor * trace.rate, energisings=trace.energisings)


BASE = find_features(scaled(1.0))


def of(name: str, found: tuple[ShotStatistic, ...]) -> ShotStatistic:
    return next(one for one in found if one.name == name)


def test_figures_are_those_of_the_values() -> None:
    taken = shots(6, 1)
    values = [shot.value("quantity") for shot in taken]
    found = of("quantity", shot_statistics(taken))
    assert (found.count, found.missing, found.unit) == (6, 0, "m3")
    assert found.mean == pytest.approx(np.mean(values), rel=1e-12)
    assert found.deviation == pytest.approx(np.std(values, ddof=1), rel=1e-12)
    # tables: t(0.975, 5) = 2.5706; chi-squared(0.975, 5) = 12.833 and (0.025, 5) = 0.83121
    half = 2.5706 * found.deviation / math.sqrt(6.0)
    assert found.mean_interval == pytest.approx((found.mean - half, found.mean + half), rel=1e-4)
    edges = [found.deviation * math.sqrt(5.0 / table) for table in (12.833, 0.83121)]
    assert found.deviation_interval == pytest.approx(edges, rel=1e-4)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """200 groups of 8 shots: 80 % intervals hold it in 160 ± 6, three of which are allowed."""
    held = np.zeros(2)
    for seed in range(200):
        found = of("quantity", shot_statistics(shots(8, seed), 0.8))
        truths = (QUANTITY, 0.02 * QUANTITY)
        edges = (found.mean_interval, found.deviation_interval)
        held += [low <= truth <= high for truth, (low, high) in zip(truths, edges, strict=True)]
    assert np.abs(held - 160.0).max() < 18.0


def test_a_shot_that_stands_apart_is_named_and_kept() -> None:
    taken = shots(12, 2)
    taken[6] = find_features(scaled(1.3))
    found = shot_statistics(taken)
    assert of("quantity", found).outliers == (7,)
    assert of("quantity", found).count == 12
    assert of("opening_delay", found).outliers == ()
    assert of("quantity", shot_statistics(shots(12, 2))).outliers == ()


def test_a_shot_without_an_injection_is_counted_as_missing() -> None:
    nothing = noisy(scaled(0.0), 0.001, 1)
    found = of("quantity", shot_statistics([*shots(4, 3), find_features(nothing)]))
    assert (found.count, found.missing) == (4, 1)
    assert shot_statistics([find_features(nothing)]) == ()


def test_one_shot_has_no_scatter() -> None:
    found = of("quantity", shot_statistics(shots(1, 4)))
    assert math.isnan(found.deviation)
    assert found.record()["mean_interval"] == [None, None]


def test_shots_of_two_units_are_refused() -> None:
    by_mass = RateTrace(trapezoid().bounds, trapezoid().rate, "kg/s")
    with pytest.raises(ConfigurationError, match="unit"):
        shot_statistics([find_features(trapezoid()), find_features(by_mass)])
    with pytest.raises(ConfigurationError, match="0 and 1"):
        shot_statistics([find_features(trapezoid())], 95.0)
