"""Profiles of the likelihood: those of a linear model are its local intervals, and a better optimum is met and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.stages import telling
from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.profile import ROUNDS, profiles_of
from tests.plugins.certainty.linear import TRUTH, Floats, N, design, fitted, likelihood

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
    found = fitted(likelihood([curve(3)], [design()], [STATED]))
    assert profiles_of(found, [0]).better is None
    unit = found.unit + 3.0 * np.sqrt(np.diag(found.covariance.noise)) * [1.0, 0.0, 0.0]
    errors = found.likelihood.residuals(found.likelihood.space.from_unit(unit[None]))[0]
    better = profiles_of(replace(found, unit=unit, errors=errors), [0]).better
    assert better is not None
    assert abs(better[0] - found.unit[0]) < abs(unit[0] - found.unit[0])


def test_profiles_tell_their_rounds_and_how_many_ends_they_have_found() -> None:
    told: list[tuple[str, int, int, str]] = []
    with telling(lambda *stage: told.append(stage)):
        profiles_of(fitted(likelihood([curve(1)], [design()], [STATED])), [0, 1])
    search = [stage for stage in told if stage[0] == "search"]
    rounds = [stage for stage in told if stage[0] == "profiles"]
    assert search[0][1:] == (0, search[0][2], "1 of 1 ascents go on")
    assert [stage[1] for stage in rounds] == list(range(len(rounds)))
    assert rounds[0][2:] == (ROUNDS, "0 of 4 ends found")
    before = len(told)
    profiles_of(fitted(likelihood([curve(1)], [design()], [STATED])), [0])
    assert len(told) == before  # outside the block nobody is told
