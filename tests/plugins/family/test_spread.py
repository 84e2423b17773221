"""Mean and spread over parts: limits that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.plugins.family.from_results import estimate_over_parts, remove_prior

X = np.array([4.0, 5.0, 7.0, 8.0])


def test_exact_values_give_their_mean_and_standard_deviation() -> None:
    found = estimate_over_parts(X, np.zeros(4))
    assert found.value == pytest.approx(6.0)
    assert found.between == pytest.approx(np.std(X, ddof=1), rel=1e-12)
    assert found.spread == pytest.approx(np.std(X, ddof=1) * np.sqrt(1.0 + 1.0 / 4.0), rel=1e-12)


def test_equal_errors_are_taken_out_of_the_spread() -> None:
    found = estimate_over_parts(X, np.full(4, 0.8))
    assert found.between == pytest.approx(np.sqrt(np.var(X, ddof=1) - 0.8**2), rel=1e-12)


def test_errors_that_explain_all_leave_the_weighed_mean_and_its_error() -> None:
    errors = np.array([10.0, 20.0, 20.0, 40.0])
    weights = errors**-2.0
    found = estimate_over_parts(X, errors)
    assert found.between == 0.0
    assert found.value == pytest.approx(np.sum(weights * X) / np.sum(weights))
    assert found.spread == pytest.approx(np.sum(weights) ** -0.5)


def test_a_part_whose_data_do_not_hold_the_parameter_is_left_out() -> None:
    assert estimate_over_parts([10.0, 20.0, 10.1], [0.1, np.nan, 0.1]) == estimate_over_parts([10.0, 10.1], [0.1, 0.1])


def test_the_prior_of_the_parts_does_not_draw_them_together() -> None:
    """Posteriors of parts with data of the prior's own weight: half the way to its value, errors by sqrt(2) smaller."""
    posterior, error = 0.5 * (X + 6.0), np.full(4, 0.8 / np.sqrt(2.0))
    values, errors = remove_prior(posterior, error, (6.0, 0.8))
    np.testing.assert_allclose(values, X, rtol=1e-12)
    np.testing.assert_allclose(errors, 0.8, rtol=1e-12)
    assert estimate_over_parts(values, errors).between == pytest.approx(np.sqrt(np.var(X, ddof=1) - 0.8**2), rel=1e-9)


def test_data_that_tell_next_to_nothing_beside_the_prior_tell_nothing() -> None:
    values, errors = remove_prior([60.0, 61.0, 62.0], [10.0, 9.9, 0.0], (60.0, 10.0))
    np.testing.assert_array_equal(np.isnan(errors), [True, True, False])
    assert values[2] == 62.0


def test_a_thousand_parts_return_what_they_were_drawn_from() -> None:
    rng = np.random.default_rng(7)
    errors = rng.uniform(0.5, 3.0, 1000)
    x = 60.0 + rng.normal(0.0, 2.0, 1000) + errors * rng.normal(0.0, 1.0, 1000)
    found = estimate_over_parts(x, errors)
    # three standard errors: of a mean with a spread of some 2.7, and of a standard deviation, over 1,000 draws
    assert found.value == pytest.approx(60.0, abs=3.0 * 2.7 / np.sqrt(1000.0))
    assert found.between == pytest.approx(2.0, abs=3.0 * 2.7**2 / 2.0 / np.sqrt(500.0))
    assert found.between == pytest.approx(found.spread, rel=1e-2)  # the mean is known well


def test_parts_that_are_exactly_alike_have_no_spread() -> None:
    assert estimate_over_parts([3.0, 3.0], [0.0, 0.0]) == (3.0, 0.0, 0.0)
