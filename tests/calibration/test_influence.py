"""Influence of data on parameters, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.calibration.influence import influence_of


def test_residuals_without_a_stated_tolerance_are_scaled_by_their_scatter_alone() -> None:
    residuals = np.tile([0.1, -0.1], 50)
    prior = np.array([[1e-6, 0.0]])
    curve, judged = (influence_of(residuals, np.eye(100, 2), prior, stated) for stated in (False, True))
    np.testing.assert_allclose(curve.errors, curve.scatter, rtol=1e-9)
    np.testing.assert_allclose(judged.errors, 1.0, rtol=1e-9)


def test_a_prior_takes_its_share_of_a_parameter() -> None:
    # orthogonal columns of length s and priors of weight 1: each parameter counts s²/(s² + 1)
    jacobian = np.zeros((5, 3))
    jacobian[0, 0], jacobian[1, 1], jacobian[2, 2] = 3.0, 1.0, 0.0
    found = influence_of(np.zeros(5), jacobian, np.eye(3))
    assert found.effective == pytest.approx(0.9 + 0.5, rel=1e-12)
    assert found.errors == pytest.approx([0.1**0.5, 0.5**0.5, 1.0], rel=1e-12)
    assert found.singular == pytest.approx([3.0, 1.0, 0.0], abs=1e-12)


def test_without_priors_it_is_least_squares() -> None:
    rng = np.random.default_rng(3)
    jacobian, residuals = rng.normal(size=(30, 4)), 2.0 * rng.normal(size=30)
    found = influence_of(residuals, jacobian, np.empty((0, 4)))
    assert found.effective == pytest.approx(4.0, rel=1e-10)
    s2 = np.sum(residuals**2) / 26.0
    assert found.scatter**2 == pytest.approx(s2, rel=1e-10)
    expected = np.sqrt(s2 * np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    assert found.errors == pytest.approx(expected, rel=1e-9)


def test_small_residuals_do_not_shrink_the_errors() -> None:
    found = influence_of(np.full(10, 1e-3), np.eye(10, 2), np.empty((0, 2)))
    assert found.errors == pytest.approx([1.0, 1.0])


def test_what_nothing_holds_has_no_error() -> None:
    jacobian = np.array([[1.0, 0.0], [2.0, 0.0]])
    found = influence_of(np.zeros(2), jacobian, np.empty((0, 2)))
    assert np.isposinf(found.errors[1])
    assert np.isfinite(found.errors[0])


def test_a_combination_names_its_parameters() -> None:
    jacobian = np.array([[3.0, -4.0, 0.0], [0.0, 0.0, 0.1]])
    record = influence_of(np.zeros(2), jacobian, np.empty((0, 3))).record(("a", "b", "c"))
    first = record["combinations"][0]
    assert first["singular_value"] == pytest.approx(5.0)
    assert first["weights"] == {"b": pytest.approx(0.8), "a": pytest.approx(-0.6)}
