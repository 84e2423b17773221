"""Small linear programmes and non-negative least squares, by dense methods: some dozens of rows, a dozen unknowns."""

from __future__ import annotations

import numpy as np

from commonrail.arrays import Bools, Floats, IndexArray
from commonrail.elementary import product

__all__ = ["highest_point", "non_negative"]


_TINY = 1e-11  # rounding of a reduced cost, relative to the largest coefficient
_DANTZIG = 200  # pivots by the steepest cost; those after them go by the lowest number, which cannot cycle


def highest_point(objective: Floats, rows: Floats, floor: Floats) -> Floats | None:
    """Point x (d,) of the largest ``objective @ x`` with ``rows @ x >= floor``; None if no point meets the rows.

    The simplex method on the dual programme, whose basis holds the rows that the point touches; all sums are in stated
    order, so that the point has the same bits on every processor.

    Parameters
    ----------
    objective : (d,)
    rows : (m, d)
        They bound the objective.
    floor : (m,)
    """
    # Dual: weights y >= 0 with rows.T @ y = -objective, of the largest floor @ y. Artificial columns start it.
    sign = np.where(-objective < 0.0, -1.0, 1.0)
    d, m = len(objective), len(rows)
    table = np.hstack([rows.T * sign[:, None], np.eye(d), (-objective * sign)[:, None]])
    basis = np.arange(m, m + d)
    _pivoted(table, basis, np.concatenate([np.zeros(m), -np.ones(d)]), m + d)
    if not _pivoted(table, basis, np.concatenate([floor, np.zeros(d)]), m):
        return None
    # The columns that began as the artificial ones hold the inverse of the basis.
    return np.asarray(sign * product(np.append(floor, np.zeros(d))[basis], table[:, m : m + d]), float)


def _pivoted(table: Floats, basis: IndexArray, gain: Floats, columns: int) -> bool:
    """Exchange columns of the basis, in place, until no one among the first adds gain; False if it has no bound.

    Parameters
    ----------
    table : (d, columns + artificial ones + 1)
        Coefficients of the columns in the basis, and its values last.
    basis : (d,)
        Column of each row.
    gain : (columns + artificial ones,)
        Gain of each column.
    columns : int
        Number of leading columns that may enter.
    """
    scale = max(float(np.abs(gain).max()), 1.0)
    for count in range(50 * table.shape[1] + _DANTZIG):
        reduced = gain[:columns] - product(gain[basis], table[:, :columns])
        better = np.flatnonzero(reduced > _TINY * scale)
        if not len(better):
            return True
        enters = better[0] if count >= _DANTZIG else better[np.argmax(reduced[better])]
        column = table[:, enters]
        # An artificial column of value zero leaves at once, on whichever side it is.
        idle = (basis >= columns) & (np.abs(column) > _TINY) & (np.abs(table[:, -1]) <= _TINY)
        falls = idle | (column > _TINY)
        if not falls.any():
            return False
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(falls, np.where(idle, 0.0, table[:, -1] / column), np.inf)
        ties = np.flatnonzero(ratio <= ratio.min() + _TINY)
        leaves = ties[np.argmin(basis[ties])] if count >= _DANTZIG else ties[np.argmax(np.abs(column[ties]))]
        table[leaves] /= table[leaves, enters]
        others = np.arange(len(table)) != leaves
        table[others] -= np.outer(table[others, enters], table[leaves])
        basis[leaves] = enters
    return True


def non_negative(matrix: Floats, wanted: Floats) -> Floats | None:
    """Weights x ≥ 0 (n,) of the least ``|matrix @ x - wanted|``; None if they are not found in 50 n exchanges.

    The active set method of Lawson and Hanson (Solving Least Squares Problems, 1974, ch. 23).

    Parameters
    ----------
    matrix : (m, n)
    wanted : (m,)
    """
    many = matrix.shape[1]
    weights, used = np.zeros(many), np.zeros(many, bool)
    rounding = 10.0 * max(matrix.shape) * np.finfo(float).eps
    tolerance = rounding * max(float(np.abs(matrix).sum(axis=0).max(initial=0.0)), 1e-300)
    for _ in range(50 * many):
        slope = np.where(used, -np.inf, matrix.T @ (wanted - matrix @ weights))
        if used.all() or slope.max() <= tolerance:
            return weights
        used[int(np.argmax(slope))] = True
        trial = _fitted(matrix, wanted, used)
        while trial[used].min() <= 0.0:
            below = used & (trial <= 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = np.where(below, weights / (weights - trial), np.inf)
            weights += np.nanmin(share) * (trial - weights)
            used &= ~(below & (weights <= rounding * max(float(weights.max()), 1e-300)))
            weights[~used] = 0.0
            if not used.any():
                break
            trial = _fitted(matrix, wanted, used)
        weights = np.where(used, trial, 0.0)
    return None


def _fitted(matrix: Floats, wanted: Floats, used: Bools) -> Floats:
    """Least-squares weights of the columns in use, zero elsewhere."""
    found = np.zeros(matrix.shape[1])
    found[used] = np.linalg.lstsq(matrix[:, used], wanted, rcond=None)[0]
    return found
