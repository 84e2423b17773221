"""Constrained minima of quadratic functions against solvers of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize, nnls

from commonrail.calibration.optimisers.quadratic import constrained_minimum, nonnegative_least_squares


@pytest.mark.parametrize("seed", range(10))
def test_non_negative_least_squares_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, wanted = rng.normal(size=(9, 14)), rng.normal(size=9)
    other, _ = nnls(matrix, wanted)
    mine = nonnegative_least_squares(matrix, wanted)
    assert (mine >= 0.0).all()
    # with more columns than rows the minimum is unique, the point need not be
    assert np.linalg.norm(matrix @ mine - wanted) == pytest.approx(np.linalg.norm(matrix @ other - wanted), abs=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_a_minimum_in_a_box_is_that_of_a_bounded_linear_solver(seed: int) -> None:
    rng = np.random.default_rng(seed)
    jacobian, residuals = rng.normal(size=(12, 5)), 3.0 * rng.normal(size=12)
    rows, least = np.vstack([np.eye(5), -np.eye(5)]), np.full(10, -0.4)
    mine = constrained_minimum(jacobian.T @ jacobian, jacobian.T @ residuals, rows, least)
    other = lsq_linear(jacobian, -residuals, (-0.4, 0.4), method="bvls").x
    np.testing.assert_allclose(mine, other, atol=1e-8)  # both solve to rounding, times the condition of JᵀJ


@pytest.mark.parametrize("seed", range(6))
def test_an_ordering_that_binds_holds_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    jacobian, residuals = rng.normal(size=(12, 4)), 3.0 * rng.normal(size=12)
    rows, least = np.diff(np.eye(4), axis=0), -0.1 * rng.random(3)

    def cost(z: np.ndarray) -> float:
        return float(np.sum((residuals + jacobian @ z) ** 2))

    mine = constrained_minimum(jacobian.T @ jacobian, jacobian.T @ residuals, rows, least)
    limits = {"type": "ineq", "fun": lambda z: rows @ z - least, "jac": lambda z: rows}
    other = minimize(cost, np.zeros(4), method="SLSQP", constraints=limits, options={"ftol": 1e-14, "maxiter": 500})
    assert (rows @ mine >= least - 1e-9).all()
    assert cost(mine) <= cost(other.x) + 1e-6  # SLSQP's own tolerance
