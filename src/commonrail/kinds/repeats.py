"""Repeated measurements of one operating point: their mean, and the standard error of the mean."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Averaged", "averaged", "groups_of"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


class Averaged(NamedTuple):
    """Means of repeated values.

    Attributes
    ----------
    mean : (points, …)
    counts : (points,)
        Values behind each mean.
    sigma : float or None
        Standard error of a mean, root mean square over all; None where nothing is repeated.
    """

    mean: Floats
    counts: NDArray[np.intp]
    sigma: float | None


def groups_of(places: Floats, same: float) -> list[Indices]:
    """Rows of equal places, in the order of their first rows.

    Parameters
    ----------
    places : (n, k)
        Positive coordinates of each row, such as rail pressure and energising time.
    same : float
        Relative distance of neighbouring values from which they count as different.
    """
    codes = np.zeros(len(places), np.intp)
    for column in places.T:
        order = np.argsort(column, kind="stable")
        steps = np.diff(column[order]) > same * column[order][:-1]
        rank = np.empty(len(column), np.intp)
        rank[order] = np.concatenate(([0], np.cumsum(steps)))
        codes = codes * (int(rank.max(initial=0)) + 1) + rank
    _, first, which = np.unique(codes, return_index=True, return_inverse=True)
    return [np.flatnonzero(which.reshape(-1) == i) for i in np.argsort(first)]


def averaged(values: Floats, groups: list[Indices], scale: Floats | float = 1.0) -> Averaged:
    """Means of groups of rows.

    Parameters
    ----------
    values : (n, …)
    groups : list of (k,) array of int
        Rows of each mean.
    scale : (n,) or float
        Unit of the scatter, for each row.
    """
    mean = np.array([values[rows].mean(axis=0) for rows in groups])
    counts = np.array([len(rows) for rows in groups], np.intp)
    if counts.max(initial=0) < 2:
        return Averaged(mean, counts, None)
    scale = np.broadcast_to(scale, values.shape[:1])
    # Variance of a single value, pooled over the groups, then of each mean.
    squares = [np.mean(((values[rows] - mean[i]).T / scale[rows]) ** 2) * len(rows) for i, rows in enumerate(groups)]
    variance = float(np.sum(squares) / np.sum(counts - 1))
    return Averaged(mean, counts, float(np.sqrt(variance * np.mean(1.0 / counts))) or None)
