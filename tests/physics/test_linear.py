"""Small linear systems against LAPACK, and in cases with a known solution."""

from __future__ import annotations

import numpy as np

from commonrail.physics import elementary as linear

RNG = np.random.default_rng(3)


def test_least_squares_is_that_of_lapack() -> None:
    matrix, wanted = RNG.normal(size=(60, 9)), RNG.normal(size=60)
    expected = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    np.testing.assert_allclose(linear.least_squares(matrix, wanted), expected, rtol=1e-12)


def test_columns_of_very_different_size_do_no_harm() -> None:
    """A normal matrix would leave two digits of the small column: its square is 1e-14 of the large one's."""
    matrix = RNG.normal(size=(30, 3)) * [1.0, 1e-4, 1e3]
    x = np.array([2.0, 3.0, 5.0])
    np.testing.assert_allclose(
        linear.least_squares(matrix, matrix @ x), x, rtol=1e-6
    )  # the right side is rounded to 1e-12


def test_a_repeated_column_is_left_out() -> None:
    column = RNG.normal(size=20)
    found = linear.least_squares(np.stack([column, column], axis=1), 3.0 * column)
    np.testing.assert_allclose(np.sort(found), [0.0, 3.0], atol=1e-14)


def test_the_residual_is_orthogonal_where_there_are_few_rows() -> None:
    matrix, wanted = RNG.normal(size=(3, 5)), RNG.normal(size=3)
    np.testing.assert_allclose(matrix @ linear.least_squares(matrix, wanted), wanted, atol=1e-13)


def test_a_system_among_others_has_the_bits_that_it_has_alone() -> None:
    """Also where its columns are taken in another order than those beside it, and one of them is left out."""
    rng = np.random.default_rng(8)
    matrix, wanted = rng.standard_normal((5, 12, 4)), rng.standard_normal((5, 12))
    matrix[2, :, 3] = matrix[2, :, 0]
    matrix[4] = 0.0
    together = linear.least_squares(matrix, wanted)
    assert together.shape == (5, 4)
    assert np.count_nonzero(together[2]) == 3
    assert not together[4].any()
    for own, a, b in zip(together, matrix, wanted, strict=True):
        assert own.tobytes() == linear.least_squares(a, b).tobytes()


def test_roots_and_triangles() -> None:
    other = RNG.normal(size=(8, 6))
    matrix = other.T @ other
    root = linear.cholesky(matrix)
    np.testing.assert_allclose(root, np.linalg.cholesky(matrix), atol=1e-13)
    np.testing.assert_allclose(linear.solve_lower(root, np.eye(6)) @ root, np.eye(6), atol=1e-12)
    right = RNG.normal(size=6)
    np.testing.assert_allclose(root @ linear.solve_lower(root, right), right, atol=1e-13)
    np.testing.assert_allclose(root.T @ linear.solve_upper(root.T, right), right, atol=1e-13)
