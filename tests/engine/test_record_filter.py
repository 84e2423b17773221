"""Low-pass of measured pressures: noise goes, waves stay, pilots do not depend on the record before the command."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.record_filter import LOWEST, low_pass
from commonrail.engine.simulate import simulate_batch
from commonrail.physics.injector import Injector

RAIL, NOISE, INTERVAL = 80e6, 0.2e6, 20e-6


def record(seed: int, begin: float, end: float = 6e-3) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(begin, end, INTERVAL)
    return time, RAIL + NOISE * np.random.default_rng(seed).standard_normal(len(time))


def wave(time: np.ndarray) -> np.ndarray:
    """Water-hammer of a pipe after an injection at t = 0 and its third harmonic, over a drop of 4 MPa."""
    after = np.maximum(time - 0.6e-3, 0.0)
    first = 2e6 * np.exp(-after / 3e-3) * np.sin(2e3 * np.pi * after)
    return np.asarray(
        first + 0.7e6 * np.exp(-after / 1.5e-3) * np.sin(6e3 * np.pi * after) - 4e9 * np.clip(after, 0, 1e-3)
    )


def test_a_pilot_is_the_same_after_any_time_at_a_noisy_pressure(regulated: Injector) -> None:
    points = [OperatingPoint(RAIL, 250e-6)]
    for before in (0.0, 2e-3, 20e-3):
        noisy = (Trace.of(*record(seed, -before)).low_pass() for seed in range(16))
        points += [OperatingPoint(rail, [(0.0, 250e-6)], horizon=before + 2.5e-3, start=-before) for rail in noisy]
    mass = simulate_batch(regulated, points).injected_mass[0]
    assert mass[1:] == pytest.approx(mass[0], rel=0.01)  # raw records scatter by 0.1


def test_a_pilot_is_the_same_wherever_in_a_falling_pressure_the_simulation_begins(regulated: Injector) -> None:
    rail = Trace((0.0, 12e-3), (RAIL + 2.5e6, RAIL - 3.5e6))
    starts = (0.0, 2.5e-3, 5e-3)
    points = [OperatingPoint(rail, [(5e-3, 250e-6)], horizon=8e-3 - start, start=start) for start in starts]
    mass = simulate_batch(regulated, points).injected_mass[0]
    assert mass == pytest.approx(mass[-1], rel=0.01)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_waves_of_the_rail_stay(noise: float) -> None:
    time, pressure = record(1, -2e-3, 8e-3)
    exact = RAIL + wave(time)
    filtered = low_pass(time, exact + noise * (pressure - RAIL))
    assert 4e3 < filtered.cut_off <= 20e3
    difference = np.interp(time, filtered.time, filtered.value) - exact
    assert np.std(difference) < (0.02e6, 0.5 * NOISE)[round(noise)]  # 1 % of the wave: the corner where it sets in
    for frequency in (1e3, 3e3):
        swing = np.exp(2j * np.pi * frequency * time)
        assert abs(difference @ swing) < (0.01, 0.2)[round(noise)] * abs(wave(time) @ swing)  # noise has some of it


@pytest.mark.parametrize(("interval", "jitter"), [(5e-6, 0.2), (20e-6, 0.2), (50e-6, 0.0)])
def test_a_record_without_waves_loses_its_noise(interval: float, jitter: float) -> None:
    rng = np.random.default_rng(7)
    time = np.cumsum(interval * rng.uniform(1.0 - jitter, 1.0 + jitter, round(30e-3 / interval)))
    filtered = low_pass(time, RAIL - 5e8 * time + NOISE * rng.standard_normal(len(time)))
    assert filtered.cut_off == LOWEST
    assert np.abs(filtered.value - RAIL + 5e8 * filtered.time).max() < 0.3 * NOISE
    assert filtered.removed == pytest.approx(NOISE, rel=0.25)  # interpolation takes some of it


def test_a_stated_cut_off_counts_without_a_shift_in_time() -> None:
    time = np.arange(500) * INTERVAL
    slow, fast = (np.cos(2.0 * np.pi * f * time) for f in (0.5e3, 2.5e3))
    filtered = low_pass(time, slow + fast, 1e3)
    assert np.abs(filtered.value - slow)[50:-50].max() < 0.02  # the record ends within a period
    assert low_pass(time, fast, 50e3).value is fast
    assert Trace.of(time, slow + fast).low_pass("1 kHz") == Trace.of(filtered.time, filtered.value)


def test_a_record_too_slow_or_too_short_to_show_its_noise_stays_as_it_is() -> None:
    for interval, count in ((100e-6, 1000), (1e-6, 40)):
        time = interval * np.arange(count)
        value = RAIL + 5e6 * np.exp(-time / 2e-3) * np.sin(2 * np.pi * 2.7e3 * time)
        assert low_pass(time, value).value is value
