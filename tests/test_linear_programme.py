"""Small linear programmes and non-negative least squares agree with SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog, nnls

from commonrail.linear_programme import highest_point, non_negative

Floats = NDArray[np.float64]

ROUNDING = 1e-10  # of some thirty exchanges of a basis; HiGHS itself forgives 1e-7


def polytope(rng: np.random.Generator, d: int) -> tuple[Floats, Floats]:
    """Rows of unit length, orderings among them (degenerate: they meet in a point), and a box around."""
    rows = rng.normal(size=(int(rng.integers(0, 12)), d))
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    order = np.eye(d)[1:] - np.eye(d)[:-1]
    rows = np.vstack([rows, order]) if rng.random() < 0.5 else rows
    floor = rng.choice([0.0, 0.3]) * rng.normal(size=len(rows))
    box = np.eye(d)
    return np.vstack([rows, box, -box]), np.concatenate([floor, np.zeros(d), -np.ones(d)])


@pytest.mark.parametrize("seed", range(60))
def test_the_highest_point_is_as_high_as_that_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, floor = polytope(rng, int(rng.integers(1, 13)))
    objective = rng.normal(size=rows.shape[1])
    other = linprog(-objective, A_ub=-rows, b_ub=-floor, bounds=(None, None))
    found = highest_point(objective, rows, floor)
    assert (found is not None) == other.success
    if found is not None:
        assert objective @ found == pytest.approx(-other.fun, abs=ROUNDING)
        assert (rows @ found - floor).min() > -ROUNDING


def test_rows_that_contradict_each_other_have_no_point() -> None:
    rows = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    assert highest_point(np.array([0.0, 1.0]), rows, np.array([0.6, -0.5, 0.0, -1.0])) is None


def test_the_highest_point_of_an_objective_of_zeros_meets_the_rows() -> None:
    rows = np.vstack([np.eye(2), -np.eye(2)])
    found = highest_point(np.zeros(2), rows, np.array([0.2, 0.3, -1.0, -1.0]))
    assert found is not None
    assert (rows @ found >= np.array([0.2, 0.3, -1.0, -1.0]) - ROUNDING).all()


@pytest.mark.parametrize("seed", range(40))
def test_non_negative_weights_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m, n = int(rng.integers(2, 14)), int(rng.integers(1, 30))
    matrix, wanted = rng.normal(size=(m, n)), np.eye(m)[-1]
    found = non_negative(matrix, wanted)
    assert found is not None
    assert found.min() >= 0.0
    # the weights themselves may not be unique where there are more columns than rows
    np.testing.assert_allclose(matrix @ found, matrix @ nnls(matrix, wanted)[0], atol=ROUNDING)
