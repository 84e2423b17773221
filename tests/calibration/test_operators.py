"""Eq. (18) and (19) against loops fed with the same draws, and the draws themselves."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.calibration.optimisers.evolution import Draws, crossover, draw, mutate

PAPER_F = (0.4, 1.0)


def naive_trial(population: list[list[float]], i: int, draws: Draws, k: int, rate: float) -> list[float]:
    """Eq. (18) and (19), one number after another."""
    r1, r2, r3 = (int(member) for member in draws.others[:, k])
    trial = []
    for j in range(len(population[0])):
        mutant = population[r1][j] + draws.factor[k, j] * (population[r2][j] - population[r3][j])
        taken = draws.chance[k, j] <= rate or j == draws.forced[k]
        trial.append(mutant if taken else population[i][j])
    return trial


@pytest.mark.parametrize("rate", [0.0, 0.8, 1.0])
def test_operators_match_the_loops(rate: float) -> None:
    rng = np.random.default_rng(4)
    population = rng.random((9, 4))
    members = np.array([0, 3, 3, 8, 5])
    draws = draw(rng, members, population.shape, PAPER_F)
    trials = crossover(population[members], mutate(population, draws), draws, rate)
    for k, i in enumerate(members):
        # The same operations in the same order: the same bits.
        assert trials[k].tolist() == naive_trial(population.tolist(), int(i), draws, k, rate)


def test_chance_equal_to_the_rate_takes_the_mutant() -> None:
    draws = Draws(np.array([[1], [2], [3]]), np.ones((1, 2)), np.array([[0.8, 0.9]]), np.array([0]))
    trial = crossover(np.zeros((1, 2)), np.ones((1, 2)), draws._replace(forced=np.array([0])), 0.8)
    assert trial.tolist() == [[1.0, 0.0]]
    other = crossover(np.zeros((1, 2)), np.ones((1, 2)), draws._replace(forced=np.array([1])), 0.8)
    assert other.tolist() == [[1.0, 1.0]]  # rnd = CR counts, and so does j_rand


@pytest.mark.parametrize("size", [4, 5, 50])
def test_others_are_distinct_from_each_other_and_from_the_parent(size: int) -> None:
    members = np.tile(np.arange(size), 200)
    others = draw(np.random.default_rng(0), members, (size, 3), PAPER_F).others
    together = np.sort(np.vstack([members, others]), axis=0)
    assert (np.diff(together, axis=0) > 0).all()
    assert together.min() == 0
    assert together.max() == size - 1


def test_every_ordered_triple_of_others_is_equally_likely() -> None:
    n = 60_000
    others = draw(np.random.default_rng(1), np.full(n, 2), (5, 1), PAPER_F).others
    code = others[0] * 25 + others[1] * 5 + others[2]
    _, counts = np.unique(code, return_counts=True)
    assert len(counts) == 4 * 3 * 2
    # 2500 of each expected, spread 50: five spreads.
    assert np.abs(counts - n / 24).max() < 250


def test_factor_is_drawn_anew_for_each_member_and_parameter_from_0_4_to_1() -> None:
    draws = draw(np.random.default_rng(2), np.arange(50), (50, 7), PAPER_F)
    assert draws.factor.shape == (50, 7)
    assert len(np.unique(draws.factor)) == 350
    many = draw(np.random.default_rng(2), np.zeros(20_000, int), (50, 7), PAPER_F)
    assert many.factor.min() >= 0.4
    assert many.factor.max() <= 1.0
    # 140 000 draws: the ends are reached within 1e-4, mean and variance within five errors.
    assert many.factor.min() < 0.4001
    assert many.factor.max() > 0.9999
    assert many.factor.mean() == pytest.approx(0.7, abs=5 * 0.6 / np.sqrt(12 * 140_000))
    assert many.factor.var() == pytest.approx(0.03, rel=0.02)
    between = np.corrcoef(many.factor.T) - np.eye(7)
    assert np.abs(between).max() < 5.0 / np.sqrt(20_000)


def test_share_of_mutant_values_is_cr_and_the_forced_one() -> None:
    members = np.zeros(40_000, int)
    draws = draw(np.random.default_rng(3), members, (50, 7), PAPER_F)
    trials = crossover(np.zeros((40_000, 7)), np.ones((40_000, 7)), draws, 0.8)
    # P = CR + (1 - CR)/d; 280 000 draws leave 0.07 % of noise.
    assert trials.mean() == pytest.approx(0.8 + 0.2 / 7.0, abs=0.004)
    assert trials.any(axis=1).all()
