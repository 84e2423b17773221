"""Several injections in a trace: divided at stated rates, also when they fuse; noise makes none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from commonrail.plugins.features.injections import FeatureStatus, average
from commonrail.plugins.features.rate_trace import RateTrace
from commonrail.plugins.features.run import find_features
from commonrail.plugins.features.settings import FeatureSettings
from tests.plugins.features.analytic import PEAK, SAMPLE, noisy, straight

PILOT = 0.4 * PEAK
# pilot: triangle from 300 to 500 us; main: trapezoid from 1000 to 1600 us
APART = ((300e-6, 400e-6, 500e-6, 1000e-6, 1100e-6, 1500e-6, 1600e-6), (0.0, PILOT, 0.0, 0.0, PEAK, PEAK, 0.0))
ENERGISED = [(0.0, 200e-6), (700e-6, 500e-6)]
QUANTITIES = (PILOT * 100e-6, PEAK * 500e-6)


def train(valley: float = 0.0, end: float = 2.5e-3) -> RateTrace:
    """Pilot and main with a rate between them that falls to a share of the pilot at 700 us."""
    time = (300e-6, 400e-6, 700e-6, 1100e-6, 1500e-6, 1600e-6)
    energisings = [(0.0, 200e-6), (500e-6, 500e-6)]
    return straight(time, (0.0, PILOT, valley * PILOT, PEAK, PEAK, 0.0), end=end, energisings=energisings)


def test_a_pilot_and_a_main_are_two_injections_with_their_quantities() -> None:
    found = find_features(straight(*APART, energisings=ENERGISED))
    assert [one.energising for one in found.injections] == [1, 2]
    assert [one["quantity"] for one in found.injections] == pytest.approx(QUANTITIES, rel=1e-9)
    assert [one["total_quantity"] for one in found.injections] == pytest.approx(QUANTITIES, rel=1e-9)
    assert found.quantity == pytest.approx(sum(QUANTITIES), rel=1e-9)
    # threshold: a tenth of the peak, 25 us up the pilot's ramp of 100 us to 0.4 of it
    expected = [325e-6, 1010e-6 - 700e-6]
    assert [one["opening_delay"] for one in found.injections] == pytest.approx(expected, abs=1e-12)
    assert found.value("separation", 2) == pytest.approx(1010e-6 - 475e-6, abs=1e-12)
    assert math.isnan(found.value("separation", 1))


@pytest.mark.parametrize("seed", range(10))
def test_noise_makes_no_false_injections(seed: int) -> None:
    """2 % of the peak on a threshold of 10 %: four standard deviations of the averaged rate within its hysteresis."""
    found = find_features(noisy(straight(*APART, energisings=ENERGISED), 0.02, seed))
    assert [one.energising for one in found.injections] == [1, 2]


def test_on_a_slow_ramp_the_rate_passes_the_threshold_many_times_and_there_is_one_injection() -> None:
    """0.1 % of the peak a sample, and noise of 0.9 % after averaging: hysteresis tells them from injections."""
    slow = straight((200e-6, 5200e-6, 5500e-6, 5600e-6), (0.0, PEAK, PEAK, 0.0), end=6e-3)
    passes = []
    for seed in range(5):
        ramp = noisy(slow, 0.02, seed)
        found = find_features(ramp)
        course = average(ramp, found.levels.width)
        passes.append(np.count_nonzero(np.diff(course.rate > found.levels.threshold)))
        assert len(found.injections) == 1
    assert max(passes) >= 6  # once up and once down would be 2


def test_noise_that_reaches_over_the_hysteresis_is_told_apart_from_injections() -> None:
    found = find_features(noisy(straight(*APART, energisings=ENERGISED), 0.1, 1))
    assert (found.status, found.injections) == (FeatureStatus.HIDDEN_IN_NOISE, ())
    assert find_features(
        noisy(straight(*APART, energisings=ENERGISED), 0.1, 1), settings=FeatureSettings(averaging="300 us")
    ).injections


def test_ripple_on_a_plateau_divides_nothing() -> None:
    trace = straight((300e-6, 400e-6, 1500e-6, 1600e-6), (0.0, PEAK, PEAK, 0.0))
    middles = 0.5 * (trace.bounds[1:] + trace.bounds[:-1])
    wave = np.where(trace.rate > 0.9 * PEAK, 1.0 + 0.3 * np.sin(2.0 * np.pi * middles / 200e-6), 1.0)
    assert len(find_features(RateTrace(trace.bounds, trace.rate * wave)).injections) == 1


def test_fused_injections_are_divided_where_the_rate_is_smallest() -> None:
    """The valley, 0.3 of the pilot, lies above the threshold: no closing and no opening there."""
    found = find_features(train(0.3))
    first, second = found.injections
    assert FeatureStatus.FUSED in first.statuses
    assert FeatureStatus.FUSED in second.statuses
    assert math.isnan(first["closing"])
    assert math.isnan(second["opening"])
    up_to_valley = 0.5 * PILOT * 100e-6 + 0.5 * (1.0 + 0.3) * PILOT * 300e-6
    assert first["quantity"] == pytest.approx(up_to_valley, abs=0.1 * SAMPLE * PEAK)
    assert first["quantity"] + second["quantity"] == pytest.approx(found.quantity, rel=1e-9)
    assert [one.energising for one in found.injections] == [1, 2]


@pytest.mark.parametrize(("valley", "count"), [(0.45, 2), (0.55, 1)])
def test_the_stated_share_decides_whether_they_are_two(valley: float, count: int) -> None:
    assert len(find_features(train(valley)).injections) == count
    assert len(find_features(train(valley), settings=FeatureSettings(split=0.8)).injections) == 2


def test_a_valley_between_threshold_and_release_has_instants() -> None:
    """The rate falls to 0.2 of the pilot, 0.08 of the peak: below the threshold, not below its hysteresis."""
    first, second = find_features(train(0.2)).injections
    assert FeatureStatus.FUSED not in (*first.statuses, *second.statuses)
    assert first["closing"] < second["opening"]


def test_an_energising_without_an_injection_is_named() -> None:
    found = find_features(straight(APART[0][3:], APART[1][3:], energisings=ENERGISED))
    assert found.silent == (1,)
    assert math.isnan(found.value("quantity", 1))
    assert found.value("quantity", 2) == pytest.approx(QUANTITIES[1], rel=1e-9)


def test_a_second_opening_after_one_energising_is_named() -> None:
    found = find_features(straight(*APART, energisings=[(0.0, 200e-6)]))
    assert [one.energising for one in found.injections] == [1, None]
    assert FeatureStatus.REOPENED in found.injections[1].statuses
    assert math.isnan(found.injections[1]["opening_delay"])
    assert found.value("quantity") == pytest.approx(QUANTITIES[0], rel=1e-9)
    assert found.value("total_quantity") == pytest.approx(sum(QUANTITIES), rel=1e-9)
    assert math.isnan(found.injections[1]["total_quantity"])


def test_an_injection_before_any_energising_is_named() -> None:
    found = find_features(straight(*APART, energisings=[(700e-6, 500e-6)]))
    assert [one.energising for one in found.injections] == [None, 1]
    assert FeatureStatus.NO_ENERGISING in found.injections[0].statuses


def test_energisings_closer_than_the_hydraulic_delay_keep_their_injections() -> None:
    """The second one starts 30 us before the first injection opens."""
    found = find_features(straight(*APART, energisings=[(0.0, 200e-6), (295e-6, 500e-6)]))
    assert [one.energising for one in found.injections] == [1, 2]


def test_without_energisings_injections_count_in_order() -> None:
    trace = straight(*APART)
    assert find_features(trace).value("quantity", 2) == pytest.approx(QUANTITIES[1], rel=1e-9)
    assert math.isnan(find_features(trace).value("opening_delay", 2))
    assert find_features(trace).of(3) is None
