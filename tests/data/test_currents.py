"""Energisings read from virtual currents of peak and hold, or refused. All of them are SYNTHETIC."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.data.currents import LIMIT, read_energisings

STARTS = 5e-3 + 10e-3 * np.arange(20)


def current(rate: float, seed: int, hold: float, fall: float = 30e-6) -> tuple[Floats, Floats, Floats, Floats]:
    """Times [s], current [A], starts and durations [s]: a peak of 18 A until 150 us, noise, an offset of the clamp."""
    random = np.random.default_rng(seed)
    starts, durations = STARTS + random.uniform(0.0, 1.0 / rate, 20), random.uniform(210e-6, 600e-6, 20)
    time = np.arange(0.0, 0.21, 1.0 / rate)
    value = 0.4 + 0.15 * random.standard_normal(len(time))
    for start, duration in zip(starts, durations, strict=True):
        corners = start + np.array([0.0, 90e-6, 150e-6, 200e-6, duration, duration + fall])
        value += np.interp(time, corners, 18.0 * np.array([0.0, 1.0, 1.0, hold, hold, 0.0]))
    return time, value, starts, durations


@pytest.mark.parametrize("rate", [10e3, 20e3, 50e3, 100e3, 200e3, 1e6])
@pytest.mark.parametrize("fall", [15e-6, 30e-6, 60e-6])
def test_an_energising_is_read_to_5_us_or_refused(rate: float, fall: float) -> None:
    """Holds from 0.4 to 0.8 of the peak; a sampling interval of 50 us and more leaves the end of a fall open."""
    sure = 0
    for seed, hold in enumerate((0.4, 0.5, 2.0 / 3.0, 0.8)):
        time, value, starts, durations = current(rate, seed, hold, fall)
        read = read_energisings(time, value)
        assert len(read) == len(durations)
        for one, start, duration in zip(read, starts, durations, strict=True):
            assert (one.error <= LIMIT) or np.isinf(one.error)
            if np.isfinite(one.error):
                sure += 1
                assert abs(one.duration - duration) <= LIMIT
                assert abs(one.start - start) <= LIMIT
    assert sure == 0 if rate <= 20e3 else sure >= 60 if rate >= 200e3 else True


@pytest.mark.parametrize("rate", [200e3, 1e6])
def test_a_pilot_that_is_cut_near_the_peak_hides_no_main(rate: float) -> None:
    """The coil is discharged at one voltage: from 17 A a fall lasts 1.7 times as long as from a hold of 10 A."""
    random = np.random.default_rng(3)
    time = np.arange(0.0, 0.1, 1.0 / rate)
    value = 0.05 * random.standard_normal(len(time))
    begun = 5e-3 + 9e-3 * np.arange(10) + random.uniform(0.0, 1e-5, 10)
    for start in begun:
        pilot, main = np.array([0.0, 90e-6, 160e-6, 228e-6]), np.array([0.0, 90e-6, 150e-6, 250e-6, 800e-6, 840e-6])
        value += np.interp(time, start + pilot, [0.0, 18.0, 17.0, 0.0])
        value += np.interp(time, start + 2e-3 + main, [0.0, 18.0, 17.0, 10.0, 10.0, 0.0])
    read = read_energisings(time, value)
    assert np.isfinite([one.error for one in read]).all()
    assert [one.duration for one in read] == pytest.approx([160e-6, 800e-6] * 10, abs=LIMIT)


def test_readings_state_their_errors() -> None:
    """Two standard deviations and more: of 400 durations hardly any is off by more than is stated."""
    beyond = 0
    for seed in range(20):
        time, value, _, durations = current(200e3, seed, (0.5, 2.0 / 3.0)[seed % 2])
        beyond += sum(
            abs(r.duration - d) > r.error for r, d in zip(read_energisings(time, value), durations, strict=True)
        )
    assert beyond <= 4


def test_a_current_that_fades_has_no_end() -> None:
    time, value, _, _ = current(200e3, 1, 0.5, 400e-6)
    assert np.isinf([one.error for one in read_energisings(time, value)]).all()


def test_a_record_of_less_than_two_averages_shows_no_energising() -> None:
    assert read_energisings(1e-6 * np.arange(8), np.array([0.0, 0.0, 5.0, 9.0, 9.0, 9.0, 0.0, 0.0])) == []
