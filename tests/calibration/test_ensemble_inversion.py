"""Ensemble Kalman inversion against least squares in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.calibration.optimisers.ensemble import FEWEST, groups_of, moved, size_of
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space

D, MANY, SAMPLES = 6, 40, 300


def room() -> Space:
    return Space([Parameter(name, 0.5, 0.0, 1.0, "1", mark="E", source="test") for name in "abcdef"])


def ended(steps: int, residuals: Floats, design: Floats, ripple: float = 0.0) -> Floats:
    """Members after some steps in residuals + design · position, rippled with a period of a fiftieth of the range."""
    feasible, unit = FeasibleSet.of(room()), np.random.default_rng(1).random((MANY, D))
    for _ in range(steps):
        course = (unit + ripple * np.sin(50.0 * 2.0 * np.pi * unit)) @ design
        unit = moved(feasible, unit, course - residuals)
    return unit


@pytest.mark.parametrize("ripple", [0.0, 0.005])
def test_members_come_to_the_least_squares(ripple: float) -> None:
    """Each to the solution of the normal equations, where slopes at a point are 1 ± 1.6 too."""
    random = np.random.default_rng(0)
    design = random.standard_normal((D, SAMPLES)) * np.geomspace(1.0, 0.05, D)[:, None]
    right = random.uniform(0.2, 0.8, D)
    data = right @ design + 0.01 * random.standard_normal(SAMPLES)
    least = np.linalg.lstsq(design.T, data, rcond=None)[0]
    found = ended(20, data, design, ripple)
    # the last parameter moves the data least: 0.012 is its standard error
    assert found == pytest.approx(np.tile(least, (MANY, 1)), abs=0.05)
    assert found.mean(axis=0) == pytest.approx(least, abs=0.02)


def test_ensembles_have_members_enough() -> None:
    assert len(np.unique(groups_of(400, 3, D))) == 3
    assert len(np.unique(groups_of(2 * FEWEST * (D + 1), 8, D))) == 2
    assert (groups_of(5, 3, D) == 0).all()
    assert len(groups_of(0, 3, D)) == 0


def test_residuals_that_most_members_meet_exactly_have_a_size() -> None:
    """As of curves without an injection: the members that inject are led away from it, none to where no number is."""
    rows = np.zeros((5, 3))
    assert size_of(rows) == 1.0
    rows[0] = 3.0, -3.0, 3.0
    assert size_of(rows) == 3.0
    assert np.isfinite(moved(FeasibleSet.of(room()), np.random.default_rng(2).random((5, D)), rows)).all()
