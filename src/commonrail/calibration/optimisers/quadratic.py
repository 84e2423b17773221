"""Minimum of a convex quadratic function under linear inequalities, in a stated order of operations."""

from __future__ import annotations

import numpy as np

from commonrail.arrays import Floats
from commonrail.elementary import product
from commonrail.linear import cholesky, least_squares, solve_lower, solve_upper

__all__ = ["constrained_minimum", "nonnegative_least_squares"]


_MET = 1e-12  # shortfall of a row that counts as rounding


def constrained_minimum(hessian: Floats, gradient: Floats, rows: Floats, least: Floats) -> Floats:
    """Point z (d,) of least z·H z/2 + g·z among those with ``rows @ z >= least``.

    Least-distance programming (Lawson and Hanson 1974, chapter 23): in the metric of H the point nearest to the free
    minimum, found as a non-negative least-squares problem of d + 1 equations.

    Parameters
    ----------
    hessian : (d, d)
        H, symmetric and positive definite.
    gradient : (d,)
    rows : (m, d)
    least : (m,)
        Not above 0, so that z = 0 satisfies all rows.

    Returns
    -------
    (d,)
        Zeros where rounding leaves no point within the rows.
    """
    lower = cholesky(hessian)
    free = -solve_upper(lower.T, solve_lower(lower, gradient))
    short = least - product(rows, free[:, None])[:, 0]
    if not np.any(short > _MET):
        return free
    scaled = solve_lower(lower, rows.T)  # columns: rows in the metric of H
    system = np.vstack([scaled, short])
    wanted = np.zeros(len(system))
    wanted[-1] = 1.0
    weights = nonnegative_least_squares(system, wanted)
    rest = product(system, weights[:, None])[:, 0] - wanted
    if not abs(rest[-1]) > _MET:
        return np.zeros_like(gradient)
    return free + solve_upper(lower.T, -rest[:-1] / rest[-1])


def nonnegative_least_squares(matrix: Floats, wanted: Floats) -> Floats:
    """Return x ≥ 0 of least ‖matrix x − wanted‖, by the active-set method of Lawson and Hanson (1974, chapter 23).

    Parameters
    ----------
    matrix : (m, n)
    wanted : (m,)

    Returns
    -------
    (n,)
    """
    count = matrix.shape[1]
    x, used = np.zeros(count), np.zeros(count, bool)
    tolerance = 1e-14 * float(np.max(np.sum(np.abs(matrix), axis=0), initial=0.0)) * max(matrix.shape)
    for _ in range(3 * count):
        rest = wanted - product(matrix, x[:, None])[:, 0]
        slope = np.where(used, -np.inf, np.sum(matrix * rest[:, None], axis=0))
        if used.all() or not slope.max() > tolerance:
            break
        entered = int(np.argmax(slope))
        used[entered] = True
        while used.any():
            trial = np.zeros(count)
            trial[used] = least_squares(matrix[:, used], wanted)
            low = used & (trial <= 0.0)
            if not low.any():
                x = trial
                break
            gap = x[low] - trial[low]
            share = float(np.min(np.where(gap > 0.0, x[low] / np.where(gap > 0.0, gap, 1.0), 0.0)))
            x = np.maximum(x + share * (trial - x), 0.0)
            leaving = low & (x <= 1e-15)
            if not leaving.any():
                leaving = low
            x[leaving], used[leaving] = 0.0, False
        if not used[entered]:
            break  # rounding: the column that would lower the residual most does not
    return x
