"""Means of repeated measurements, and their standard errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from commonrail.base.arrays import Floats
from commonrail.data.curves.samples import Samples
from commonrail.data.curves.shots import mean_curve
from commonrail.data.repeats import average_groups, group_rows


def test_rows_of_one_place_come_together_in_the_order_of_their_first() -> None:
    places = np.array([[160.0, 700.0], [80.0, 300.0], [160.2, 700.0], [80.0, 700.0], [80.0, 300.0]])
    assert [rows.tolist() for rows in group_rows(places, 0.01)] == [[0, 2], [1, 4], [3]]
    assert [rows.tolist() for rows in group_rows(places, 1e-6)] == [[0], [1, 4], [2], [3]]


def test_the_standard_error_of_a_mean_is_that_of_normal_draws() -> None:
    random = np.random.default_rng(3)
    shots = 5.0 + random.normal(0.0, 0.4, (25, 400))
    found = average_groups(shots, [np.arange(25)])
    # 25 × 400 draws: the estimate scatters by 0.7 %, five times that is allowed.
    assert found.sigma == pytest.approx(0.4 / np.sqrt(25.0), rel=0.035)
    assert np.std(found.mean - 5.0) == pytest.approx(found.sigma, rel=0.15)
    assert found.counts.tolist() == [25]
    assert found.freedom == pytest.approx(24 * 400, rel=0.05)  # white noise: a chance autocorrelation may count


def test_scatter_is_pooled_over_groups_in_units_of_the_scale() -> None:
    values = np.array([1.0, 3.0, 20.0, 60.0])
    found = average_groups(values, [np.array([0, 1]), np.array([2, 3])], np.array([1.0, 1.0, 20.0, 20.0]))
    assert found.mean.tolist() == [2.0, 40.0]
    assert found.sigma == pytest.approx(np.sqrt(2.0 / 2.0))  # each pair has the variance 2, a mean of two half of it


def test_nothing_repeated_has_no_error() -> None:
    assert average_groups(np.array([1.0, 2.0]), [np.array([0]), np.array([1])]).sigma is None


def test_samples_that_follow_each_other_are_no_independent_ones() -> None:
    random = np.random.default_rng(5)
    shots = random.normal(0.0, 1.0, (25, 1000))
    for i in range(1, 1000):
        shots[:, i] = 0.9 * shots[:, i - 1] + np.sqrt(1.0 - 0.81) * shots[:, i]
    found = average_groups(shots, [np.arange(25)])
    # the autocorrelation 0.9^l has Σ r² = (1 + 0.81)/(1 − 0.81); from 24 000 samples it is known to some percent
    assert found.freedom == pytest.approx(24 * 1000 * 0.19 / 1.81, rel=0.1)


def test_samples_that_all_shots_state_as_zero_tell_nothing_of_the_noise() -> None:
    """A meter that shows exactly zero before and after an injection."""
    shots = 5.0 + np.random.default_rng(7).normal(0.0, 0.4, (6, 300))
    quiet = np.hstack([np.zeros((6, 500)), shots, np.zeros((6, 400))])
    alone, found = average_groups(shots, [np.arange(6)]), average_groups(quiet, [np.arange(6)])
    assert (found.sigma, found.freedom) == pytest.approx((alone.sigma, alone.freedom))
    assert found.mean.shape == (1, 1200)


def test_ringing_noise_counts_beyond_the_zeros_of_its_autocorrelation() -> None:
    """Samples of a resonance, whose autocorrelation follows its recursion."""
    random, n = np.random.default_rng(6), 520
    first, second = 2.0 * 0.98 * np.cos(np.pi / 8.0), -(0.98**2)
    related = [1.0, first / (1.0 - second)]
    for _ in range(2, n):
        related.append(first * related[-1] + second * related[-2])
    lags = np.arange(1, n)
    independent = n / (1.0 + 2.0 * np.sum((1.0 - lags / n) * np.square(related[1:])))  # 21
    found = []
    for _ in range(12):
        shots = random.normal(0.0, 1.0, (25, 400 + n))
        for i in range(2, shots.shape[1]):
            shots[:, i] += first * shots[:, i - 1] + second * shots[:, i - 2]
        found.append(average_groups(shots[:, 400:], [np.arange(25)]).freedom)
    # of one group it is known to a tenth; to stop at the first zero that a group shows gives half as much again
    assert np.mean(found) == pytest.approx(24 * independent, rel=0.15)
    assert np.max(found) < 1.5 * 24 * independent


def test_shots_that_differ_by_an_offset_count_once_each() -> None:
    random = np.random.default_rng(7)
    shots = random.normal(0.0, 1.0, (5, 1)) + random.normal(0.0, 0.05, (5, 520))
    assert average_groups(shots, [np.arange(5)]).freedom == pytest.approx(4.0, rel=0.1)


def test_few_repeats_have_few_degrees_of_freedom() -> None:
    found = average_groups(np.array([1.0, 3.0, 20.0, 24.0, 7.0]), [np.array([0, 1]), np.array([2, 3]), np.array([4])])
    assert found.freedom == 2.0


@pytest.mark.parametrize("scatter", [0.0, 0.02])
def test_a_mean_of_shots_knows_how_far_it_is_off_as_a_whole(scatter: float) -> None:
    """Shots whose quantities scatter, and noise of single samples, which is hardly anything of a quantity."""
    random, bounds = np.random.default_rng(11), np.linspace(0.0, 2e-3, 401)
    curve = 3e-5 * np.sin(np.pi * np.linspace(0.0, 1.0, 400))
    sizes = 1.0 + scatter * random.standard_normal(50)
    rates = sizes[:, None] * curve + 3e-7 * random.standard_normal((50, 400))
    found = mean_curve([Samples(bounds, rate, "m3/s", "s", "time") for rate in rates], 100e6, 1e-3)
    # 50 shots: the estimate scatters by 10 %, of which two and a half are allowed. The samples' noise moves a factor by
    # 0.07 %, which is no scatter: what is left of it is that by which its square is known, 20 %
    assert found.scatter == pytest.approx(scatter / 50.0**0.5, rel=0.25, abs=0.6 * 7e-4 / 50.0**0.5)


def test_a_shift_by_half_a_sample_is_no_low_pass() -> None:
    """Means of a course over intervals that lie half a sample apart, by its integral in closed form.

    An integral linear between the bounds averages neighbours: on these flanks, of 30 us, it is off by 0.17 % of the
    peak, eight times what the cubic is.
    """

    def integral(time: Floats) -> Floats:
        return np.asarray(0.5 * special.erf((time - 1e-3) / 30e-6) - 0.5 * special.erf((time - 1.5e-3) / 30e-6))

    bounds = np.arange(0.0, 2.5e-3, 5e-6)
    moved = bounds[10:-10] + 2.5e-6
    read, right = (np.diff(integral(at)) / np.diff(at) for at in (bounds, moved))
    found = Samples(bounds, read, "m3/s", "s", "time").on(moved)
    assert found.rate == pytest.approx(right, abs=3e-4 * right.max())
    whole = np.diff(integral(moved[[0, -1]]))[0]
    assert found.rate @ np.diff(moved) == pytest.approx(whole, abs=1e-12)


def test_noise_of_single_samples_is_told_from_what_shots_are_off_by_as_wholes() -> None:
    """Shots that scatter by 2 %, 0.6 at the peak, and noise of 0.3: the standard error is that of the noise alone."""
    random, bounds = np.random.default_rng(12), np.linspace(0.0, 2e-3, 401)
    curve = 3e-5 * np.sin(np.pi * np.linspace(0.0, 1.0, 400))
    sizes = 1.0 + 0.02 * random.standard_normal(50)
    rates = sizes[:, None] * curve + 3e-7 * random.standard_normal((50, 400))
    found = mean_curve([Samples(bounds, rate, "m3/s", "s", "time") for rate in rates], 100e6, 1e-3)
    assert found.sigma == pytest.approx(3e-7 / 50.0**0.5, rel=0.03)  # of 20,000 values: 0.5 %
