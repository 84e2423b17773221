"""Small dense linear systems, in a stated order of operations: their bits do not depend on the processor.

Polynomials of a fuel and starting populations are made with them; fits by least squares use LAPACK. For at most some
tens of unknowns. LAPACK takes its inner loops by processor; here every operation is one of NumPy on whole rows or
columns, or a sum along one, which is rounded the same way everywhere.
"""

from __future__ import annotations

import math

import numpy as np

from commonrail.base.arrays import Floats


def least_squares(matrix: Floats, wanted: Floats) -> Floats:
    """Return x (…, n) of least ‖matrix x − wanted‖, by Householder reflections with column pivoting.

    Columns whose part that the others cannot imitate is smaller than machine precision times the larger of m and n are
    left out of the solution: their x is 0.

    `matrix` is (…, m, n) with m ≥ 1, `wanted` (…, m). A system among several has the bits that it has alone.
    """
    rows, columns = np.shape(matrix)[-2:]
    many = math.prod(np.shape(matrix)[:-2])
    a = np.array(matrix, dtype=float).reshape(many, rows, columns)
    b = np.array(wanted, dtype=float).reshape(many, rows)
    systems = np.arange(len(a))
    order = np.tile(np.arange(columns), (len(a), 1))
    limit = (np.finfo(float).eps * max(rows, columns)) ** 2
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
