"""Small dense linear systems, in a stated order of operations: their bits do not depend on the processor.

For at most some tens of unknowns. LAPACK takes its inner loops by processor; here every operation is one of NumPy on
whole rows or columns, or a sum along one, which is rounded the same way everywhere.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from commonrail.base.arrays import Floats

_MOST_SWEEPS = 60  # some ten are needed


def least_squares(matrix: Floats, wanted: Floats, rcond: float | None = None) -> Floats:
    """Return x (…, n) of least ‖matrix x − wanted‖, by Householder reflections with column pivoting.

    Parameters
    ----------
    matrix : (…, m, n)
        m ≥ 1. A system among several has the bits that it has alone.
    wanted : (…, m)
    rcond : float, optional
        Columns whose part that the others cannot imitate is smaller than this share of the largest are left out of the
        solution (their x is 0); by default, machine precision times the larger of m and n.
    """
    rows, columns = np.shape(matrix)[-2:]
    many = math.prod(np.shape(matrix)[:-2])
    a = np.array(matrix, dtype=float).reshape(many, rows, columns)
    b = np.array(wanted, dtype=float).reshape(many, rows)
    systems = np.arange(len(a))
    order = np.tile(np.arange(columns), (len(a), 1))
    limit = (np.finfo(float).eps * max(rows, columns) if rcond is None else rcond) ** 2
    largest, rank = np.zeros(len(a)), np.zeros(len(a), int)
    going = np.ones(len(a), bool)
    for k in range(min(rows, columns)):
        squares = np.sum(a[:, k:, k:] * a[:, k:, k:], axis=1)
        best = np.argmax(squares, axis=1)
        size = squares[systems, best]
        largest = np.where(going, np.maximum(largest, size), largest)
        going &= size > limit * largest
        if not going.any():
            break
        own = systems[going]
        best = k + best[going]
        a[own, :, k], a[own, :, best] = a[own, :, best], a[own, :, k]
        order[own, k], order[own, best] = order[own, best], order[own, k]
        a[own, k:, k:], b[own, k:] = _reflected(a[own, k:, k:], b[own, k:])
        rank[own] = k + 1
    x = np.zeros((len(a), columns))
    for i, r in enumerate(rank.tolist()):
        x[i, order[i, :r]] = solve_upper(a[i, :r, :r], b[i, :r])
    return x.reshape(*np.shape(matrix)[:-2], columns)


def _reflected(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Systems (k, m, n) and (k, m), reflected so that the first column vanishes below its first row."""
    column = a[:, :, 0].copy()
    length = np.sqrt(np.sum(column * column, axis=1))
    column[:, 0] += np.copysign(length, column[:, 0])
    scale = 2.0 / np.sum(column * column, axis=1)
    shares = scale[:, None] * np.sum(column[:, :, None] * a, axis=1)
    along = scale * np.sum(column * b, axis=1)
    return a - column[:, :, None] * shares[:, None, :], b - column * along[:, None]


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


def singular(matrix: Floats) -> tuple[Floats, Floats]:
    """Singular values and right singular vectors of a matrix, by one-sided Jacobi rotations.

    Parameters
    ----------
    matrix : (m, n)

    Returns
    -------
    values : (n,)
        The largest first; zeros among them where m < n.
    directions : (n, n)
        A vector in each row.
    """
    columns = np.array(np.transpose(matrix), dtype=float)
    directions = np.eye(len(columns))
    for _ in range(_MOST_SWEEPS):
        turned = [_turn(columns, directions, p, q) for p, q in itertools.combinations(range(len(columns)), 2)]
        if not any(turned):
            break
    values = np.sqrt(np.sum(columns * columns, axis=1))
    order = np.argsort(-values, kind="stable")
    return values[order], directions[order]


def _turn(columns: Floats, directions: Floats, p: int, q: int) -> bool:
    """Make two columns orthogonal, in place; returns whether they were not yet."""
    one, other = columns[p].copy(), columns[q].copy()
    a, b, c = float(np.sum(one * one)), float(np.sum(other * other)), float(np.sum(one * other))
    if not abs(c) > np.finfo(float).eps * np.sqrt(a) * np.sqrt(b):
        return False
    ratio = (b - a) / (2.0 * c)
    tangent = np.copysign(1.0 / (abs(ratio) + np.sqrt(1.0 + ratio * ratio)), ratio)
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    for rows in (columns, directions):
        first, second = rows[p].copy(), rows[q].copy()
        rows[p], rows[q] = cosine * (first - tangent * second), cosine * (tangent * first + second)
    return True
