"""The operators of DE/rand/1/bin, Eq. (18) and (19): draws first, then pure functions of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats, IndexArray

__all__ = ["Draws", "crossover", "draw", "mutate"]


class Draws(NamedTuple):
    """The random numbers behind k trials of d parameters.

    `others` (3, k) are the members r1, r2, r3; `factor` (k, d) is F; `chance` (k, d) is the
    rnd of Eq. (19); `forced` (k,) is j_rand.
    """

    others: IndexArray
    factor: Floats
    chance: Floats
    forced: IndexArray


def draw(
    rng: np.random.Generator,
    members: IndexArray,
    population: tuple[int, ...],
    factor: tuple[float, float],
) -> Draws:
    """Draw everything that one mutation and crossover needs.

    Parameters
    ----------
    rng : numpy.random.Generator
    members : (k,) array of int
        Parents.
    population : (n, d)
        Shape of the population, n >= 4.
    factor : (float, float)
        Range of F.

    Notes
    -----
    r1, r2, r3 are drawn from as many numbers as there are members left to choose from, and then
    shifted past those already taken, in ascending order: uniform over all ordered triples of
    other members, without a loop or a repeat.
    """
    size, dimension = population
    count = len(members)
    others = np.empty((3, count), np.intp)
    taken: list[IndexArray] = [members]  # in ascending order for each member
    for k, other in enumerate(others):
        other[:] = rng.integers(0, size - len(taken), count)
        for earlier in taken:
            other += other >= earlier
        if k < 2:
            taken = _sorted_with(taken, other)
    low, high = factor
    return Draws(
        others=others,
        factor=low + (high - low) * rng.random((count, dimension)),
        chance=rng.random((count, dimension)),
        forced=rng.integers(0, dimension, count),
    )


def _sorted_with(ascending: list[IndexArray], further: IndexArray) -> list[IndexArray]:
    """One more row in the ascending order of each column."""
    rows = []
    for row in ascending:
        rows.append(np.minimum(row, further))
        further = np.maximum(row, further)
    return [*rows, further]


def mutate(population: Floats, draws: Draws) -> Floats:
    """Mutants (k, d) of a population (n, d): v = x_r1 + F (x_r2 - x_r3), Eq. (18)."""
    first, second, third = population[draws.others]
    return np.asarray(first + draws.factor * (second - third))


def crossover(parents: Floats, mutants: Floats, draws: Draws, rate: float) -> Floats:
    """Trials (k, d): the mutant's value where rnd <= CR or j = j_rand, else the parent's (19).

    Parameters
    ----------
    parents, mutants : (k, d) array
    draws : Draws
    rate : float
        CR.
    """
    taken = draws.chance <= rate
    taken[np.arange(len(taken)), draws.forced] = True
    return np.where(taken, mutants, parents)
