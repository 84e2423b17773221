"""Low-passes against their analytic amplitude, sum and centroid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from commonrail.physics.meters import LowPass, first_order, look_ahead, low_pass

STEP, CUTOFF = 1e-6, 20e3
PULSE = np.zeros(4000)
PULSE[1000:1010] = 1.0
TIME = STEP * (np.arange(len(PULSE)) + 0.5)
EVERY = [(law, order) for law in LowPass for order in (1, 2, 3)]


def amplitude(law: LowPass, order: int) -> complex:
    """Response to a sine of the cut-off frequency, over whole periods in the middle of the signal."""
    sine = np.exp(2j * np.pi * CUTOFF * TIME)
    real, imaginary = (low_pass(part, STEP, law, order, CUTOFF) for part in (sine.real, sine.imag))
    inside = slice(1500, 2500)  # 20 periods; what the ends have set off has died away to 1e-7
    return complex(np.mean((real + 1j * imaginary)[inside] / sine[inside]))


@pytest.mark.parametrize("order", [1, 2, 3])
def test_butterworth_has_lost_3_db_at_the_cutoff(order: int) -> None:
    assert abs(amplitude(LowPass.BUTTERWORTH, order)) == pytest.approx(math.sqrt(0.5), rel=1e-6)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_each_lag_of_a_cascade_has_lost_3_db_at_the_cutoff(order: int) -> None:
    # The input is constant over a step: with d = 2π f Δt, each lag differs by d²/12 = 0.13 % at 20 kHz and 1 us.
    assert abs(amplitude(LowPass.CASCADE, order)) == pytest.approx(0.5 ** (order / 2), rel=1.5e-3 * order)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_zero_phase_filter_halves_the_cutoff_and_shifts_nothing(order: int) -> None:
    found = amplitude(LowPass.ZERO_PHASE, order)
    assert abs(found) == pytest.approx(0.5, rel=1e-6)
    assert abs(np.angle(found)) < 1e-6


@pytest.mark.parametrize(("law", "order"), EVERY)
def test_the_sum_is_kept(law: LowPass, order: int) -> None:
    """The tail of the slowest filter has decayed by e^-140 at the end of the signal: what is left is rounding."""
    assert low_pass(PULSE, STEP, law, order, CUTOFF).sum() == pytest.approx(PULSE.sum(), rel=1e-9)


@pytest.mark.parametrize(("law", "order"), EVERY)
def test_a_signal_has_the_same_bits_alone_and_among_others(law: LowPass, order: int) -> None:
    signals = np.random.default_rng(1).normal(size=(5, 700))
    together = low_pass(signals, STEP, law, order, CUTOFF)
    for one, row in zip(signals, together, strict=True):
        np.testing.assert_array_equal(low_pass(one, STEP, law, order, CUTOFF), row)


def test_a_cascade_delays_by_its_time_constants() -> None:
    """Two lags of 60 kHz, those of the virtual bench: 5.3 us."""
    passed = low_pass(PULSE, STEP, LowPass.CASCADE, 2, 60e3)
    delay = np.sum(passed * TIME) / np.sum(passed) - np.sum(PULSE * TIME) / np.sum(PULSE)
    assert delay == pytest.approx(2.0 / (2.0 * math.pi * 60e3), rel=1e-9)


def test_without_cutoff_nothing_changes() -> None:
    for law in LowPass:
        assert low_pass(PULSE, STEP, law, 2, math.inf) is PULSE


def test_a_lag_rests_at_its_first_value() -> None:
    assert first_order(np.full(20, 160e6), 0.7, 160e6) == pytest.approx(160e6, rel=1e-14)


def test_a_cutoff_near_half_the_sampling_frequency_stays_stable() -> None:
    for cutoff in (0.49e6, 0.5e6, 5e6):
        assert np.abs(low_pass(PULSE, STEP, LowPass.BUTTERWORTH, 4, cutoff)).max() < 2.0


def test_only_the_zero_phase_filter_looks_ahead() -> None:
    """One seventh of what it looks ahead is the slowest time constant, 1/(2π f sin(π/2n))."""
    assert look_ahead(LowPass.ZERO_PHASE, 1, 2.5e3) == pytest.approx(7.0 / (2.0 * math.pi * 2.5e3))
    assert look_ahead(LowPass.ZERO_PHASE, 2, 2.5e3) == pytest.approx(7.0 * math.sqrt(2.0) / (2.0 * math.pi * 2.5e3))
    assert look_ahead(LowPass.ZERO_PHASE, 2, math.inf) == look_ahead(LowPass.CASCADE, 2, 1e3) == 0.0
