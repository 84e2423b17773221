"""Designs of sensitivity studies in the unit cube: Saltelli's for Sobol' indices, Morris's trajectories."""

from __future__ import annotations

import math

import numpy as np

from commonrail.arrays import Floats
from commonrail.errors import ConfigurationError

__all__ = ["LEVELS", "MOST_COLUMNS", "one_at_a_time", "saltelli", "trajectories"]


LEVELS = 4  # of Morris's grid: 0, 1/3, 2/3, 1, with steps of 2/3
MOST_COLUMNS = 21_201  # of SciPy's table of Sobol' directions (Joe and Kuo 2008)


def saltelli(dimension: int, samples: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Matrices A and B (samples, dimension) of a scrambled Sobol' sequence.

    AB_j, which is A with column j of B, is left to the caller: all of them together are large.

    Parameters
    ----------
    dimension : int
    samples : int
        A power of two: of another number the sequence loses its balance.
    rng : numpy.random.Generator
        Scrambles the sequence (Owen 1998).

    Raises
    ------
    ConfigurationError
        If `samples` is no power of two, or there are too many parameters.
    """
    from scipy.stats import qmc  # slow to import

    if samples < 2 or samples & (samples - 1):
        raise ConfigurationError(f"The number of samples must be a power of two, such as 1024, not {samples}.")
    if 2 * dimension > MOST_COLUMNS:
        raise ConfigurationError(f"At most {MOST_COLUMNS // 2} parameters can be varied together, not {dimension}.")
    cube = qmc.Sobol(2 * dimension, rng=rng).random_base2(int(math.log2(samples)))
    return np.ascontiguousarray(cube[:, :dimension]), np.ascontiguousarray(cube[:, dimension:])


def trajectories(dimension: int, count: int, rng: np.random.Generator) -> Floats:
    """Trajectories of Morris (1991), (count, dimension + 1, dimension).

    A trajectory begins at a random point of the grid and moves each coordinate once, in random order, by half of the
    levels: up from the lower half, down from the upper.

    Parameters
    ----------
    dimension, count : int
    rng : numpy.random.Generator
    """
    start = rng.integers(0, LEVELS, (count, dimension))
    moved = np.where(start < LEVELS // 2, start + LEVELS // 2, start - LEVELS // 2)
    turn = np.argsort(rng.random((count, dimension)), axis=1)  # coordinate that moves at each step
    position = np.argsort(turn, axis=1)[:, None, :]  # step at which each coordinate moves
    step = np.arange(dimension + 1)[None, :, None]
    return np.asarray(np.where(step > position, moved[:, None, :], start[:, None, :]) / (LEVELS - 1.0))


def one_at_a_time(centre: Floats) -> Floats:
    """The centre, then each coordinate at 0, then each at 1: (1 + 2 d, d).

    Parameters
    ----------
    centre : (d,)
        Position of the values that the others keep; it may lie outside the cube.
    """
    d = len(centre)
    points = np.tile(centre, (1 + 2 * d, 1))
    points[1 + np.arange(d), np.arange(d)] = 0.0
    points[1 + d + np.arange(d), np.arange(d)] = 1.0
    return points
