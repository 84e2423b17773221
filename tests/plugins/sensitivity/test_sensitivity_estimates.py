"""Estimates of sensitivity: against closed forms, against SALib, and where simulations failed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from SALib.analyze import morris as salib_morris
from SALib.analyze import sobol as salib_sobol

from commonrail.plugins.sensitivity.estimates import (
    LEVELS,
    Indices,
    morris_effects,
    one_at_a_time,
    saltelli,
    sobol_indices,
    trajectories,
)

Floats = NDArray[np.float64]

PROBLEM = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[-math.pi, math.pi]] * 3}

# Ishigami and Homma (1990) with a = 7, b = 0.1: closed forms of the variances.
_A, _B = 7.0, 0.1
V1, V2, V13 = 0.5 * (1 + _B * math.pi**4 / 5) ** 2, _A**2 / 8, 8 * _B**2 * math.pi**8 / 225
VARIANCE = V1 + V2 + V13
FIRST = np.array([V1, V2, 0.0]) / VARIANCE
TOTAL = np.array([V1 + V13, V2, V13]) / VARIANCE

COEFFICIENTS = np.array([4.0, -2.0, 1.0, 0.0])


def ishigami(x: Floats) -> Floats:
    a, b, c = (math.pi * (2.0 * x[..., j] - 1.0) for j in range(3))
    return np.asarray(np.sin(a) + _A * np.sin(b) ** 2 + _B * c**4 * np.sin(a))


def radial(dimension: int, samples: int, seed: int) -> Floats:
    """A, AB_1 … AB_d, B of each base point: (samples, d + 2, d)."""
    a, b = saltelli(dimension, samples, np.random.default_rng(seed))
    rows = np.repeat(a[:, None], dimension + 2, axis=1)
    for j in range(dimension):
        rows[:, 1 + j, j] = b[:, j]
    rows[:, -1] = b
    return rows


def indices(y: Floats, seed: int = 0, resamples: int = 300) -> Indices:
    found = sobol_indices(y, np.random.default_rng(seed), resamples, 0.95)
    assert found is not None
    return found


def test_the_indices_of_ishigamis_function_are_those_of_its_closed_form() -> None:
    found = indices(ishigami(radial(3, 8192, 1)))
    assert found.variance == pytest.approx(VARIANCE, rel=0.01)
    # random points have a standard error of 0.01 here, and these are more even
    assert found.first.value == pytest.approx(FIRST, abs=0.02)
    assert found.total.value == pytest.approx(TOTAL, abs=0.02)


def test_a_linear_function_has_the_squares_of_its_coefficients() -> None:
    found = indices(radial(4, 1024, 2) @ COEFFICIENTS)
    expected = COEFFICIENTS**2 / np.sum(COEFFICIENTS**2)
    assert found.total.value == pytest.approx(expected, abs=0.005)
    assert found.first.value == pytest.approx(expected, abs=0.03)
    assert found.total.value[3] == 0.0  # no effect: not even rounding


def test_the_indices_are_those_of_salib() -> None:
    y = ishigami(radial(3, 256, 3))
    found, theirs = indices(y), salib_sobol.analyze(PROBLEM, y.ravel(), calc_second_order=False, seed=1)
    assert found.first.value == pytest.approx(theirs["S1"], abs=1e-12)
    assert found.total.value == pytest.approx(theirs["ST"], abs=1e-12)
    # both intervals are of the bootstrap: theirs normal, ours of percentiles
    width = 0.5 * (found.total.high - found.total.low)
    assert width == pytest.approx(theirs["ST_conf"], rel=0.25)


def test_the_intervals_hold_the_closed_form_as_often_as_they_say() -> None:
    hits = []
    for seed in range(40):
        found = indices(ishigami(radial(3, 128, seed)), seed)
        for estimate, truth in ((found.first, FIRST), (found.total, TOTAL)):
            hits += list((estimate.low <= truth) & (truth <= estimate.high))
    # 240 intervals of 95 %; on quasi-random points they are wider than needed. Fewer than 92 % would be 2 s.e. below.
    assert np.mean(hits) >= 0.92


def test_failed_simulations_cost_their_effects_and_nothing_else() -> None:
    points = radial(3, 2048, 4)
    y = ishigami(points)
    lost = np.random.default_rng(5).random(y.shape) < 0.03
    spoilt = np.where(lost, np.nan, y)
    found = indices(spoilt)
    pairs = [~lost[:, [0, 1 + j, -1]].any(axis=1) for j in range(3)]
    assert found.used.tolist() == [int(pair.sum()) for pair in pairs]
    for estimate, truth in ((found.first, FIRST), (found.total, TOTAL)):
        assert np.isfinite(np.stack(estimate)).all()
        assert ((estimate.low <= truth) & (truth <= estimate.high)).all()


@pytest.mark.parametrize("value", [np.nan, 3.0])
def test_an_output_without_values_or_without_variance_has_no_indices(value: float) -> None:
    assert sobol_indices(np.full((16, 5), value), np.random.default_rng(0), 100, 0.95) is None


def test_a_parameter_whose_simulations_all_failed_has_no_indices() -> None:
    y = ishigami(radial(3, 64, 1))
    y[:, 2] = np.nan
    assert sobol_indices(y, np.random.default_rng(0), 100, 0.95) is None


def test_the_effects_of_a_linear_function_are_its_coefficients() -> None:
    points = trajectories(4, 10, np.random.default_rng(1))
    found = morris_effects(points, points @ COEFFICIENTS, np.random.default_rng(2), 100, 0.95)
    assert found is not None
    assert found.mean.value == pytest.approx(COEFFICIENTS, abs=1e-12)
    assert found.magnitude.value == pytest.approx(np.abs(COEFFICIENTS), abs=1e-12)
    assert found.spread == pytest.approx(0.0, abs=1e-12)


def test_the_effects_are_those_of_salib() -> None:
    points = trajectories(3, 30, np.random.default_rng(3))
    y = ishigami(points)
    found = morris_effects(points, y, np.random.default_rng(4), 500, 0.95)
    assert found is not None
    design = math.pi * (2.0 * points.reshape(-1, 3) - 1.0)
    theirs = salib_morris.analyze(PROBLEM, design, y.ravel(), num_levels=LEVELS, seed=1)
    for own, other in ((found.mean.value, "mu"), (found.magnitude.value, "mu_star"), (found.spread, "sigma")):
        assert own == pytest.approx(theirs[other], abs=1e-9)


def test_a_failed_simulation_of_a_trajectory_costs_the_two_effects_beside_it() -> None:
    points = trajectories(4, 12, np.random.default_rng(5))
    y = points @ COEFFICIENTS
    y[3, 2] = np.nan
    found = morris_effects(points, y, np.random.default_rng(6), 100, 0.95)
    assert found is not None
    moved = np.argmax(np.abs(np.diff(points[3], axis=0)), axis=1)[[1, 2]]
    assert sorted(np.flatnonzero(found.used == 11).tolist()) == sorted(moved.tolist())
    assert found.mean.value == pytest.approx(COEFFICIENTS, abs=1e-12)


def test_a_trajectory_moves_each_coordinate_once_by_two_thirds() -> None:
    points = trajectories(5, 50, np.random.default_rng(7))
    moves = np.diff(points, axis=1)
    assert points.min() >= 0.0
    assert points.max() <= 1.0
    assert np.abs(moves).sum(axis=1) == pytest.approx(2.0 / 3.0)
    assert np.count_nonzero(moves, axis=2).tolist() == np.ones((50, 5), int).tolist()


def test_one_parameter_at_a_time_goes_to_both_ends() -> None:
    points = one_at_a_time(np.array([0.5, 1.2]))
    assert points.tolist() == [[0.5, 1.2], [0.0, 1.2], [0.5, 0.0], [1.0, 1.2], [0.5, 1.0]]
