"""Measuring chains against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.plugins.paper.bench import Sensor

INTERVAL, CORNER = 1e-7, 50e3
RATE = 2.0 * np.pi * CORNER


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_an_ideal_sensor_shows_the_signal() -> None:
    signal = np.sin(np.arange(50.0))
    np.testing.assert_array_equal(Sensor().shown(signal, 3e-6, rng()), signal)
    np.testing.assert_array_equal(Sensor().shown(signal, 3e-6, rng(), signal[0]), signal)


def test_a_step_passes_two_low_passes() -> None:
    """1 − (1 + ω t) e^(−ω t), at the middles of the means."""
    time = (np.arange(400) + 0.5) * INTERVAL
    shown = Sensor(CORNER).shown(np.ones(400), INTERVAL, rng())
    expected = 1.0 - (1.0 + RATE * time) * np.exp(-RATE * time)
    # half an interval of the steepest slope, ω/e: the second low-pass sees means
    assert shown == pytest.approx(expected, abs=0.5 * RATE / np.e * INTERVAL)


def test_a_ramp_from_rest_is_followed_two_time_constants_late() -> None:
    """t − 2/ω + (t + 2/ω) e^(−ω t)."""
    time = np.arange(400) * INTERVAL
    shown = Sensor(CORNER).shown(5.0 + time, INTERVAL, rng(), 5.0 + time[0])
    expected = 5.0 + time - 2.0 / RATE + (time + 2.0 / RATE) * np.exp(-RATE * time)
    # the second low-pass sees a curve as chords: (ω T)²/12 of the way
    assert shown - 5.0 == pytest.approx(expected - 5.0, abs=(RATE * INTERVAL) ** 2 / 12.0 * time[-1])


def test_what_rested_is_shown_at_rest() -> None:
    assert Sensor(CORNER).shown(np.full(20, 160e6), 3e-6, rng(), 160e6) == pytest.approx(160e6, rel=1e-14)


@pytest.mark.parametrize("interval", [3e-6, 50e-6])
def test_a_pulse_keeps_its_area(interval: float) -> None:
    pulse = np.zeros(200)
    pulse[10:20] = 3.0
    shown = Sensor(CORNER).shown(pulse, interval, rng())
    # a mean of the filter's answer loses nothing; what is left after 180 intervals is below 1e-60
    assert np.sum(shown) == pytest.approx(30.0, rel=1e-12)


def test_noise_has_its_deviation_and_no_mean() -> None:
    shown = Sensor(noise=0.3).shown(np.zeros(20_000), 3e-6, rng())
    # four standard errors, 0.3/√20000 and 0.3/√40000
    assert abs(np.mean(shown)) < 4 * 0.3 / np.sqrt(20_000)
    assert np.std(shown) == pytest.approx(0.3, abs=4 * 0.3 / np.sqrt(40_000))


def test_noise_does_not_pass_the_low_pass() -> None:
    """It arises behind it: neighbours are independent."""
    shown = Sensor(1e3, noise=1.0).shown(np.zeros(20_000), 3e-6, rng())
    # four standard errors of a correlation, 1/√n
    assert abs(np.mean(shown[1:] * shown[:-1])) < 4 / np.sqrt(20_000)


def test_resolution_rounds() -> None:
    shown = Sensor(resolution=0.25).shown(np.array([0.1, 0.13, -0.6, 7.0]), 3e-6, rng())
    np.testing.assert_array_equal(shown, [0.0, 0.25, -0.5, 7.0])
