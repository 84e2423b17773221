"""Repeated measurements of one operating point: their mean, and the standard error of the mean."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray

SEEN = 9.0  # least squared autocorrelation that counts, in squared standard errors


class Averaged(NamedTuple):
    """Means of repeated values."""

    mean: Floats  # (points, …)
    counts: IndexArray  # (points,): values in each mean
    sigma: float | None  # standard error of a mean, root mean square over all; None where nothing is repeated
    # degrees of freedom of `sigma`: (repeats − groups) × independent samples of a course; 0 without `sigma`
    freedom: float = 0.0


def group_rows(places: Floats, same: float) -> list[IndexArray]:
    """Rows of equal places, in the order of their first rows.

    `places` (n, k): positive coordinates of each row, such as rail pressure and energising time. `same`: relative
    difference above which neighbouring values count as different.
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


def average_groups(values: Floats, groups: list[IndexArray], scale: Floats | float = 1.0) -> Averaged:
    """Means of groups of rows.

    `values` is (n, …). `groups`: rows of each mean. `scale` (n,) or float: unit of the scatter, for each row.
    """
    mean = np.array([values[rows].mean(axis=0) for rows in groups])
    counts = np.array([len(rows) for rows in groups], np.intp)
    if counts.max(initial=0) < 2:
        return Averaged(mean, counts, None)
    scale = np.broadcast_to(scale, values.shape[:1])
    deviations = np.concatenate([((values[rows] - mean[i]).T / scale[rows]).T for i, rows in enumerate(groups)])
    deviations = _live(deviations, values)
    # Variance of a single value, pooled over the groups, then of each mean.
    spare = int(np.sum(counts - 1))
    variance = float(np.sum(deviations**2)) / (spare * deviations[0].size)
    sigma = float(np.sqrt(variance * np.mean(1.0 / counts))) or None
    return Averaged(mean, counts, sigma, spare * _independent(deviations, spare) if sigma else 0.0)


def _live(deviations: Floats, values: Floats) -> Floats:
    """Deviations without the samples that are exactly zero in all rows and so contain no noise.

    Both arrays are (n, …).
    """
    varying = (values.reshape(len(values), -1) != 0.0).any(axis=0)
    return deviations if varying.all() or not varying.any() else deviations.reshape(len(deviations), -1)[:, varying]


def _independent(deviations: Floats, spare: int) -> float:
    """Effective number of independent samples in the mean square of a course, after Satterthwaite.

    n/(1 + 2 Σ (1 − l/n) r_l²), summed over all lags l with a significant autocorrelation r_l: for a ringing meter r_l
    passes through zero and returns.

    `deviations` (rows, …): deviations of each course from its mean; a number is a course of one sample. `spare`: number
    of independent courses.
    """
    courses = deviations.reshape(len(deviations), -1)
    n, energy = courses.shape[1], float(np.sum(courses**2))
    total, chance = 1.0, SEEN / (spare * n)
    unbroken = True
    for lag in range(1, n):
        left = 1.0 - lag / n
        share = (float(np.sum(courses[:, lag:] * courses[:, :-lag])) / energy) ** 2 / left
        unbroken = unbroken and share > chance
        # Bartlett: after the first insignificant lag, the scatter of r_l grows with the sum of the others
        if unbroken or share > total * chance:
            total += 2.0 * share
    return n / min(total, float(n))
