"""Profiles of the likelihood: those of a linear model are its local intervals, and a better optimum is met and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.analysis.certainty.estimate import estimate
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.profile import profiles_of
from commonrail.kinds.noise import Correlation, Law, Noise
from tests.analysis.certainty.linear import TRUTH, Floats, N, design, fitted, likelihood

STATED = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.2)


def curve(seed: int) -> Floats:
    return np.asarray(design() @ TRUTH + 0.2 * np.random.default_rng(seed).standard_normal(N))


def test_profiles_of_a_linear_model_end_where_its_intervals_do() -> None:
    found = fitted(likelihood([curve(1)], [design()], [STATED]))
    low, high = found.interval()
    done = profiles_of(found)
    assert done.better is None
    for i, profile in enumerate(done.found):
        assert profile.low.finished
        assert profile.high.finished
        # an end is found within 5 % of the wanted root
        half = 0.5 * (high[i] - low[i])
        assert profile.low.value == pytest.approx(low[i], abs=0.06 * half)
        assert profile.high.value == pytest.approx(high[i], abs=0.06 * half)


def test_a_bound_ends_a_profile_at_a_wall() -> None:
    y = design() @ [2.0, 3.0, 9.99] + 0.2 * np.random.default_rng(2).standard_normal(N)
    found = profiles_of(fitted(likelihood([y], [design()], [STATED])), [2]).found[0]
    low, high = found.low, found.high
    assert (low.finished, low.wall) == (True, False)
    assert (high.finished, high.wall, high.value) == (False, True, 10.0)


def test_a_profile_point_that_beats_the_optimum_is_told() -> None:
    """Two valleys: the start leads into the shallower one, and the profile crosses the ridge."""
    x = np.linspace(-1.0, 1.0, 50)

    def residuals(points: Floats) -> Floats:
        a = points[:, :1]
        bend = 0.3 * np.sin(6.0 * (a - 5.0))
        return np.asarray(0.05 * (a - 5.0) + bend + (points[:, 1:2] - 3.0) * x)

    own = likelihood([np.zeros(50)], [np.column_stack([x, x])], [replace(STATED, sigma=0.2)])
    bent = Likelihood(own.space, own.blocks, residuals)
    found = estimate(bent, np.array([[0.66, 0.3]]))
    assert found.point[0] > 5.5  # the shallower valley
    assert profiles_of(found, [0], rounds=8).better is not None
