"""Small dense linear systems, in a stated order of operations: their bits do not depend on the processor.

For at most some tens of unknowns. LAPACK takes its inner loops by processor; here every operation is one of NumPy on
whole rows or columns, or a sum along one, which is rounded the same way everywhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["cholesky", "inverse_of_lower", "least_squares", "solve_lower", "solve_upper"]

Floats = NDArray[np.float64]


def least_squares(matrix: Floats, wanted: Floats, rcond: float | None = None) -> Floats:
    """Return x (n,) of least ‖matrix x − wanted‖, by Householder reflections with column pivoting.

    Parameters
    ----------
    matrix : (m, n)
        m ≥ 1.
    wanted : (m,)
    rcond : float, optional
        Columns whose part that the others cannot imitate is smaller than this share of the largest are left out of the
        solution (their x is 0); by default, machine precision times the larger of m and n.
    """
    a, b = np.array(matrix, dtype=float), np.array(wanted, dtype=float)
    rows, columns = a.shape
    order = np.arange(columns)
    limit = (np.finfo(float).eps * max(rows, columns) if rcond is None else rcond) ** 2
    largest, rank = 0.0, 0
    for k in range(min(rows, columns)):
        squares = np.sum(a[k:, k:] * a[k:, k:], axis=0)
        best = k + int(np.argmax(squares))
        size = float(squares[best - k])
        largest = max(largest, size)
        if not size > limit * largest:
            break
        a[:, [k, best]], order[[k, best]] = a[:, [best, k]], order[[best, k]]
        _reflect(a, b, k)
        rank = k + 1
    x = np.zeros(columns)
    x[order[:rank]] = solve_upper(a[:rank, :rank], b[:rank])
    return x


def _reflect(a: Floats, b: Floats, k: int) -> None:
    """Reflect rows from k on so that column k vanishes below its diagonal; `a` and `b` change in place."""
    column = a[k:, k].copy()
    length = np.sqrt(np.sum(column * column))
    column[0] += np.copysign(length, column[0])
    scale = 2.0 / np.sum(column * column)
    shares = scale * np.sum(column[:, None] * a[k:, k:], axis=0)
    a[k:, k:] -= column[:, None] * shares
    b[k:] -= column * (scale * np.sum(column * b[k:]))


def cholesky(matrix: Floats) -> Floats:
    """Lower root (n, n) of a symmetric positive definite matrix; NaN where it is not."""
    rest = np.array(matrix, dtype=float)
    root = np.zeros_like(rest)
    for k in range(len(rest)):
        column = rest[k:, k] / np.sqrt(rest[k, k])
        root[k:, k] = column
        rest[k:, k:] -= column[:, None] * column
    return root


def solve_lower(lower: Floats, wanted: Floats) -> Floats:
    """Solve lower x = wanted, of one right side (n,) or several (n, k)."""
    x = np.array(wanted, dtype=float)
    for k in range(len(lower)):
        x[k] = x[k] / lower[k, k]
        x[k + 1 :] -= lower[k + 1 :, k].reshape(-1, *[1] * (x.ndim - 1)) * x[k]
    return x


def solve_upper(upper: Floats, wanted: Floats) -> Floats:
    """Solve upper x = wanted, of one right side (n,) or several (n, k)."""
    return solve_lower(upper[::-1, ::-1], wanted[::-1])[::-1]


def inverse_of_lower(lower: Floats) -> Floats:
    """Inverse of a lower triangular matrix."""
    return solve_lower(lower, np.eye(len(lower)))
