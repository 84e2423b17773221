"""Energisings read from virtual currents of peak and hold, or refused. All of them are SYNTHETIC."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.data.currents import read_energisings

STARTS = 5e-3 + 20e-3 * np.arange(10)


def current(rate: float, seed: int, hold: float, fall: float = 30e-6) -> tuple[Floats, Floats, Floats]:
    """Times [s], current [A] and durations [s]: a peak of 18 A until 150 us, noise, and an offset of the clamp."""
    random = np.random.default_rng(seed)
    starts, durations = STARTS + random.uniform(0.0, 1.0 / rate, 10), random.uniform(280e-6, 600e-6, 10)
    time = np.arange(0.0, 0.21, 1.0 / rate)
    value = 0.4 + 0.15 * random.standard_normal(len(time))
    for start, duration in zip(starts, durations, strict=True):
        corners = start + np.array([0.0, 90e-6, 150e-6, 200e-6, duration, duration + fall])
        value += np.interp(time, corners, 18.0 * np.array([0.0, 1.0, 1.0, hold, hold, 0.0]))
    return time, value, durations


# a sampling interval and more is what samples between the edges leave open; at 200 kHz noise and bends
@pytest.mark.parametrize(("rate", "within"), [(20e3, 35e-6), (50e3, 17e-6), (200e3, 8e-6), (1e6, 8e-6)])
def test_a_hold_below_the_peak_does_not_shorten_an_energising(rate: float, within: float) -> None:
    found = 0
    for seed in range(4):
        time, value, durations = current(rate, seed, (0.4, 0.5, 2.0 / 3.0, 0.8)[seed])
        read = read_energisings(time, value)
        assert len(read) == len(durations)
        off = np.array([one.duration for one in read]) - durations
        sure = np.isfinite([one.error for one in read])
        found += int(sure.sum())
        assert np.abs(off[sure]).max(initial=0.0) <= within
        assert abs(off[sure].mean()) < 0.5 * within
    assert found >= 32


def test_a_current_that_fades_has_no_end() -> None:
    time, value, _ = current(100e3, 1, 0.5, 400e-6)
    assert np.isinf([one.error for one in read_energisings(time, value)]).all()


def test_a_record_of_less_than_two_averages_shows_no_energising() -> None:
    assert read_energisings(1e-6 * np.arange(8), np.array([0.0, 0.0, 5.0, 9.0, 9.0, 9.0, 0.0, 0.0])) == []
