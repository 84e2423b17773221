"""Estimates of sensitivity with bootstrap intervals, which tolerate failed simulations.

An effect that involves a failed simulation is omitted, and the omitted effects are counted.
The estimates then apply to the part of the ranges in which the simulations succeed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, Ints

# Designs of sensitivity studies in the unit cube: Saltelli's for Sobol' indices, Morris's trajectories.

LEVELS = 4  # of Morris's grid: 0, 1/3, 2/3, 1, with steps of 2/3


def saltelli(dimension: int, samples: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Matrices A and B (samples, dimension) of a Sobol' sequence scrambled by the generator (Owen 1998).

    The caller forms AB_j, which is A with column j of B, one at a time: all of them together are large. `samples` is a
    power of two, which balances the sequence.
    """
    from scipy.stats import qmc  # slow to import

    cube = qmc.Sobol(2 * dimension, rng=rng).random_base2(int(math.log2(samples)))
    return np.ascontiguousarray(cube[:, :dimension]), np.ascontiguousarray(cube[:, dimension:])


def trajectories(dimension: int, count: int, rng: np.random.Generator) -> Floats:
    """Trajectories of Morris (1991), (count, dimension + 1, dimension).

    A trajectory begins at a random point of the grid and moves each coordinate once, in random order, by half of the
    levels: up from the lower half, down from the upper.
    """
    start = rng.integers(0, LEVELS, (count, dimension))
    moved = np.where(start < LEVELS // 2, start + LEVELS // 2, start - LEVELS // 2)
    turn = np.argsort(rng.random((count, dimension)), axis=1)  # coordinate that moves at each step
    position = np.argsort(turn, axis=1)[:, None, :]  # step at which each coordinate moves
    step = np.arange(dimension + 1)[None, :, None]
    return np.asarray(np.where(step > position, moved[:, None, :], start[:, None, :]) / (LEVELS - 1.0))


def one_at_a_time(centre: Floats) -> Floats:
    """Centre (d,), which may lie outside the cube, then each coordinate at 0, then each at 1: (1 + 2 d, d)."""
    d = len(centre)
    points = np.tile(centre, (1 + 2 * d, 1))
    points[1 + np.arange(d), np.arange(d)] = 0.0
    points[1 + d + np.arange(d), np.arange(d)] = 1.0
    return points


AT_A_TIME = 100  # resamples whose weights are in memory
FEWEST = 2  # fewest effects of a parameter for an estimate
CONSTANT = 1e-12  # relative standard deviation below which an output counts as constant


class Estimate(NamedTuple):
    """Estimates of all parameters: value, and lower and upper end of the interval, each (d,)."""

    value: Floats
    low: Floats
    high: Floats


class Indices(NamedTuple):
    """Sobol' indices of an output: shares of the variance that a parameter explains alone, and with interactions.

    `mean` and `variance` of the output over the ranges; `used` (d,) counts base points with effects.
    """

    first: Estimate
    total: Estimate
    mean: float
    variance: float
    used: Ints


class Effects(NamedTuple):
    """Elementary effects of an output, in its unit, for a move over the whole range.

    `mean` is µ, the mean effect; `magnitude` µ*, the mean of its size (Campolongo et al. 2007); `spread` (d,) σ, the
    standard deviation of the effects: interactions and curvature; `used` (d,) their number.
    """

    mean: Estimate
    magnitude: Estimate
    spread: Floats
    used: Ints


def sobol_indices(y: Floats, rng: np.random.Generator, resamples: int, confidence: float) -> Indices | None:
    """First and total indices from a Saltelli design; None if the output is constant, or too few simulations succeeded.

    `y` (n, d + 2) is the output at A, at AB_1 … AB_d, and at B; NaN for a failed simulation. First order: mean of
    f(B) (f(AB_j) − f(A)) over the variance (Saltelli et al. 2010, Table 2 b); total: half the mean of (f(A) − f(AB_j))²
    over the variance (Jansen 1999). Interval: percentiles of the bootstrap over the base points; conservative, since a
    Sobol' sequence is more even than random points.
    """
    if not np.isfinite(y).any():
        return None
    centre = float(np.nanmean(y))
    a, b = y[:, :1] - centre, y[:, -1:] - centre
    ab = y[:, 1:-1] - centre
    terms = np.hstack([b * (ab - a), 0.5 * (a - ab) ** 2])
    used = np.isfinite(terms).sum(axis=0)
    if used.min() < FEWEST or float(np.nanstd(y)) <= CONSTANT * max(abs(centre), 1e-300):
        return None
    ends = np.hstack([a, b])
    present = np.where(np.isfinite(ends), 1.0, np.nan)
    n, d = ab.shape

    def estimates(weights: Floats) -> Floats:
        """Indices (resamples, 2 d) of weighted base points."""
        count, total, squares = (weights @ np.nansum(each, axis=1) for each in (present, ends, ends**2))
        variance = squares / count - (total / count) ** 2
        return np.asarray(_means(weights, terms) / variance[:, None])

    value = estimates(np.ones((1, n)))[0]
    low, high = _percentiles(estimates, n, rng, resamples, confidence)
    return Indices(
        Estimate(value[:d], low[:d], high[:d]),
        Estimate(value[d:], low[d:], high[d:]),
        centre + float(np.nanmean(ends)),
        float(np.nanvar(ends)),
        used[:d],
    )


def morris_effects(
    points: Floats, y: Floats, rng: np.random.Generator, resamples: int, confidence: float
) -> Effects | None:
    """Elementary effects along trajectories; None if a parameter has fewer than two.

    `points` (trajectories, d + 1, d) lie in the unit cube; the output `y` (trajectories, d + 1) is NaN for a failed
    simulation. The bootstrap is over the trajectories.
    """
    moves = np.diff(points, axis=1)  # (r, d steps, d): one coordinate moves in each step
    column = np.argmax(np.abs(moves), axis=2)
    step = np.take_along_axis(moves, column[:, :, None], axis=2)[:, :, 0]
    effects = np.empty(step.shape)
    np.put_along_axis(effects, column, np.diff(y, axis=1) / step, axis=1)
    used = np.isfinite(effects).sum(axis=0)
    if used.min() < FEWEST:
        return None
    terms = np.hstack([effects, np.abs(effects)])
    n, d = len(y), points.shape[2]

    def estimates(weights: Floats) -> Floats:
        return _means(weights, terms)

    value = estimates(np.ones((1, n)))[0]
    low, high = _percentiles(estimates, n, rng, resamples, confidence)
    return Effects(
        Estimate(value[:d], low[:d], high[:d]),
        Estimate(value[d:], low[d:], high[d:]),
        np.nanstd(effects, axis=0, ddof=1),
        used,
    )


def _means(weights: Floats, columns: Floats) -> Floats:
    """Weighted means (resamples, columns) of the finite values."""
    present = np.isfinite(columns)
    sums = weights @ np.where(present, columns, 0.0)
    if present.all():
        return np.asarray(sums / weights.sum(axis=1)[:, None])
    counts = weights @ present.astype(float)
    return np.asarray(np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0.0))


def _percentiles(
    estimates: Callable[[Floats], Floats], n: int, rng: np.random.Generator, resamples: int, confidence: float
) -> tuple[Floats, Floats]:
    """Lower and upper ends of the bootstrap intervals."""
    resampled = []
    for first in range(0, resamples, AT_A_TIME):
        count = min(AT_A_TIME, resamples - first)
        drawn = rng.integers(0, n, (count, n)) + n * np.arange(count)[:, None]
        resampled.append(estimates(np.bincount(drawn.ravel(), minlength=count * n).reshape(count, n).astype(float)))
    tail = 50.0 * (1.0 - confidence)
    low, high = np.nanpercentile(np.concatenate(resampled), [tail, 100.0 - tail], axis=0)
    return low, high
