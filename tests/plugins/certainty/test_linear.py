"""Certainty of given values without a search, against the full estimate and over noise."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.errors import SimulationError
from commonrail.data.noise import Noise
from commonrail.plugins.certainty.linear import estimate_near
from tests.plugins.certainty.linear import TRUTH, design, fitted, likelihood, space
from tests.plugins.certainty.test_estimate import WHITE, Draw, autoregressive, curve, normal, outliers


@pytest.mark.parametrize("draw", [normal, autoregressive, outliers])
def test_at_the_top_the_intervals_are_those_of_the_search(draw: Draw) -> None:
    own = likelihood([curve(draw, 1)], [design()])
    whole = fitted(own)
    near = estimate_near(own, whole.unit)
    # Search and linear model end within 1e-2 of 2 ln L of the top: a tenth of a standard error. Draws know an error
    # to 2 %, neighbouring fits not quite by the same ones.
    np.testing.assert_allclose(near.half_widths(), whole.half_widths(), rtol=0.06 if draw is outliers else 0.03)
    assert near.likelihood.noises[0].law is whole.likelihood.noises[0].law


def test_the_distance_from_the_top_is_an_error_of_the_given_values() -> None:
    own = likelihood([curve(normal, 2)], [design()], [WHITE])
    top = fitted(own)
    off = np.array([0.02, -0.01, 0.03])
    near = estimate_near(own, top.unit + off)
    added = near.covariance.total - near.covariance.noise
    np.testing.assert_allclose(added, np.outer(off, off), atol=2e-4)  # the top is known to 1e-3 of a position
    np.testing.assert_allclose(near.covariance.noise, top.covariance.noise, rtol=1e-2)
    assert near.simulated == 1 + 6  # the positions, and two sides of three parameters


def test_a_constraint_ends_the_way_to_the_top() -> None:
    y = design() @ [2.0, 2.3, 5.0] + 0.2 * np.random.default_rng(5).standard_normal(300)
    room = space(constraints=["b < a"])
    near = estimate_near(likelihood([y], [design()], [WHITE], room=room), room.to_unit(np.array([2.2, 2.1, 5.0])))
    step = np.sqrt(np.diag(near.covariance.discrepancy))
    assert abs(step[0] - step[1]) == pytest.approx(0.1 / 9.9) or step[0] + step[1] == pytest.approx(0.1 / 9.9)


@pytest.mark.parametrize("draw", [normal, autoregressive])
def test_intervals_about_the_least_sum_of_magnitudes_hold_the_truth(draw: Draw) -> None:
    """Share of intervals that hold the truth: at 95 % it scatters by 1.3 to 2.2 % over 100 draws.

    The distance between two estimates is at most partly an error of the first, so that more than 95 % are right too.
    """
    x, inside = design(), []
    for seed in range(100):
        y = curve(draw, 300 + seed)
        weights = np.ones(len(y))
        for _ in range(30):  # least sum of magnitudes by reweighting
            root = np.sqrt(weights)
            best = np.linalg.lstsq(root[:, None] * x, root * y, rcond=None)[0]
            weights = 1.0 / np.maximum(np.abs(x @ best - y), 1e-4)
        near = estimate_near(likelihood([y], [x]), space().to_unit(best))
        low, high = near.interval()
        inside.append((low <= TRUTH) & (high >= TRUTH))
    assert np.mean(inside) >= 0.91


def test_values_that_fail_are_refused() -> None:
    own = likelihood([curve(normal, 3)], [design()], [Noise()])
    own._residuals = lambda points: np.full((len(points), 300), np.nan)
    with pytest.raises(SimulationError, match="cannot be simulated"):
        estimate_near(own, np.full(3, 0.5))
