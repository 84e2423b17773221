"""Disturbance of a pressure: its covariance against simulated processes, and what is learnt of it."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.plugins.observer.disturbance import MEAN, TREND, Disturbance, learn

SPACING = 20e-6


def test_the_covariance_is_that_of_an_integrated_rate() -> None:
    """5,000 paths of an Ornstein-Uhlenbeck rate, summed up; 6 % are three standard errors of a variance."""
    rng = np.random.default_rng(2)
    memory, fine, paths = 1e-3, 20e-6, 5000
    rate = np.empty((paths, 201))
    rate[:, 0] = rng.standard_normal(paths)
    kept = np.exp(-fine / memory)
    for i in range(200):
        rate[:, i + 1] = kept * rate[:, i] + np.sqrt(1.0 - kept**2) * rng.standard_normal(paths)
    path = np.cumsum(0.5 * (rate[:, 1:] + rate[:, :-1]), axis=1) * fine * 1e9
    time = np.asarray(fine * np.arange(201), float)
    model = Disturbance(0.0, 1e9, memory, 0.0, 1e3, 1e-3).covariance(time)[1:, 1:]
    model = model - MEAN**2 - TREND**2 * np.outer(time[1:], time[1:])
    at = [49, 99, 199]
    found = np.cov(path.T)[np.ix_(at, at)]
    assert found == pytest.approx(model[np.ix_(at, at)], rel=0.06)


def test_noise_and_wave_are_learnt_from_quiet_stretches() -> None:
    rng = np.random.default_rng(3)
    time = SPACING * np.arange(150)
    stretches = [
        120e6
        + 0.4e9 * rng.standard_normal() * time
        + 0.3e6 * np.sin(2.0 * np.pi * (1800.0 * time + rng.random()))
        + 50e3 * rng.standard_normal(len(time))
        for _ in range(12)
    ]
    found = learn(stretches, SPACING)
    assert found.noise == pytest.approx(50e3, rel=0.1)
    assert found.frequency == pytest.approx(1800.0, rel=0.05)
    assert 0.1e6 < found.wave < 0.5e6  # rms 0.21 MPa; its size and its decay can stand in for one another


def test_a_tone_beyond_the_highest_wave_is_noise_and_does_not_stop_the_search() -> None:
    rng = np.random.default_rng(4)
    time = SPACING * np.arange(100)
    stretches = [
        0.2e9 * rng.standard_normal() * time
        + 20e3 * np.sin(2.0 * np.pi * (23e3 * time + rng.random()))
        + 50e3 * rng.standard_normal(len(time))
        for _ in range(10)
    ]
    found = learn(stretches, SPACING)
    assert found.noise**2 + found.wave**2 == pytest.approx(50e3**2 + 0.5 * 20e3**2, rel=0.1)
    assert found.wave < 20e3


def test_without_a_quiet_stretch_there_is_an_estimate() -> None:
    assert learn([np.empty(0)], SPACING, 80e3).noise == 80e3


@pytest.mark.filterwarnings("error")
def test_a_dead_signal_has_next_to_no_disturbance_and_no_warning() -> None:
    found = learn([np.full(100, 120e6)] * 3, SPACING)
    assert all(np.isfinite(found))
    assert found.noise < 10.0


def test_a_pump_in_step_with_the_shots_is_not_steady_behind_the_stretches() -> None:
    """Every stretch rises alike; 2 ms later the pressure is far less certain than by its mean and slope alone."""
    rng = np.random.default_rng(6)
    time = SPACING * np.arange(100)
    found = learn([0.4e9 * time + 20e3 * rng.standard_normal(len(time)) for _ in range(8)], SPACING)

    def ahead(disturbance: Disturbance) -> float:
        covariance = disturbance.covariance(np.asarray(SPACING * np.arange(200), float))
        known, last = covariance[:100, :100], covariance[-1, :100]
        return float(np.sqrt(covariance[-1, -1] - last @ np.linalg.solve(known, last) - disturbance.noise**2))

    assert ahead(found) > 3.0 * ahead(found._replace(rate=0.0, wave=0.0))
