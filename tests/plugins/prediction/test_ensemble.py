"""Draws in place of a linear band that would fall below zero."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t

from commonrail.plugins.prediction.band import DRAWS, band_from_draws, band_from_slopes, drawn_about, falls_below_zero
from tests.plugins.certainty.linear import space


def test_a_linear_band_at_a_steep_flank_falls_below_zero() -> None:
    values, nothing = np.array([0.0, 1.0, 30.0]), np.zeros(3)
    steep = np.array([[0.0], [40.0], [5.0]])
    for width, falls in ((0.1, True), (0.02, True), (0.018, False)):  # 1 − 1.645 · 40 · width against −0.3
        edges = band_from_slopes(values, steep, np.array([[width**2]]), nothing, np.inf, [0.5, 0.9])
        assert falls_below_zero(values, edges) is falls
        assert not falls_below_zero(values - 1.0, edges)  # values that are negative have no floor at zero


def test_draws_have_the_covariance_and_stay_within_bounds_and_constraints() -> None:
    own = space(constraints=["b < a"])
    covariance = np.diag([1e-4, 1e-4, 0.09])
    centre = own.to_unit(np.array([5.0, 3.0, 9.0]))
    unit = own.to_unit(drawn_about(own, own.from_unit(centre), covariance).values)
    assert unit.shape == (DRAWS, 3)
    # 400 draws know a standard deviation to 3.5 %, a mean to 5 % of it
    np.testing.assert_allclose(unit[:, :2].std(axis=0), 0.01, rtol=0.14)
    np.testing.assert_allclose(unit[:, :2].mean(axis=0), centre[:2], atol=0.002)
    assert unit.max() <= 1.0
    near = own.to_unit(np.array([5.0, 4.99, 5.0]))
    drawn = drawn_about(own, own.from_unit(near), 0.01 * np.eye(3)).values
    assert own.satisfies(drawn).all()
    assert (drawn[:, 0] - drawn[:, 1]).std() > 0.1


@pytest.mark.parametrize("width", [0.02, 0.4])
def test_a_band_of_draws_is_the_linear_one_where_that_is_physical(width: float) -> None:
    """Of max(0, 1 + 5 (u − ½)): the 5 and 95 % quantiles are those of u."""
    unit = drawn_about(space(1), np.array([5.05]), np.array([[width**2]])).values
    positions = space(1).to_unit(unit)[:, 0]
    values = np.maximum(0.0, 1.0 + 5.0 * (positions - 0.5))
    low, high = np.quantile(values, [0.05, 0.95])
    expected = np.clip(0.5 + 1.645 * width * np.array([-1.0, 1.0]), 0.0, 1.0)
    np.testing.assert_allclose([low, high], np.maximum(0.0, 1.0 + 5.0 * (expected - 0.5)), atol=1.0 * width)


def test_draws_of_an_estimated_scale_have_the_tails_of_the_linear_band() -> None:
    """Four degrees of freedom: 2.13 in place of 1.645 standard deviations at 90 %, parameters and scatter together."""
    own, freedom, width, scatter = space(1), 4.0, 0.02, 0.06
    found = drawn_about(own, np.array([5.05]), np.array([[width**2]]), freedom)
    predicted = 5.0 * own.to_unit(found.values)
    ((low, high),) = band_from_draws(predicted, np.array([scatter]), freedom, [0.9], found.stretch).values()
    expected = t.ppf(0.95, freedom) * np.hypot(5.0 * width, scatter)
    # the 95 % quantile of 400 scales, each with four replicates, is known to some 6 %; a normal law is 23 % narrower
    assert 0.5 * (high - low)[0] == pytest.approx(expected, rel=0.15)
