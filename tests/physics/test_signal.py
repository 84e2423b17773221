"""Signal of a meter against closed forms: ramp, step, mass, and the bits of candidates side by side."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import gammainc

from commonrail.base.errors import ConfigurationError
from commonrail.physics.meters import Flow, LowPass, Meter, given_values, low_pass, shown_quantities, shown_rates

STEP = 1e-6
STEPS = 1200
BOUNDS = 3e-6 * np.arange(401)  # the samples cover the simulated time
MIDDLE = 0.5 * (BOUNDS[1:] + BOUNDS[:-1])
END = STEP * np.arange(1, STEPS + 1)


def shown(rates: np.ndarray, bounds: np.ndarray = BOUNDS, law: str = "cascade", **values: float) -> np.ndarray:
    """Samples of flows (candidates, steps) through a meter with these quantities."""
    meter = Meter("bench", values, law)
    rates = np.atleast_2d(rates)
    return shown_rates(meter, given_values(meter, {}, len(rates)), Flow(rates, 0.0, STEP), bounds)


def ramp() -> np.ndarray:
    """Means over the steps of a rate that rises by 1 m³/s in a second."""
    return END - 0.5 * STEP


def hump() -> np.ndarray:
    """A smooth injection, at rest for 300 us before it and after it."""
    time = END - 0.5 * STEP
    return np.where(np.abs(time - 600e-6) < 300e-6, np.cos(np.pi * (time - 600e-6) / 600e-6) ** 2, 0.0)


@pytest.mark.parametrize("delay", [0.0, 0.37e-6, 5.3e-6, 41e-6])
def test_a_ramp_is_delayed_by_parts_of_a_step(delay: float) -> None:
    """A mean of a ramp is its value in the middle; the cumulated ramp is a parabola, which the cubic meets."""
    after = (BOUNDS[:-1] > delay + 2.0 * STEP) & (BOUNDS[1:] < END[-1] + delay - 2.0 * STEP)
    assert shown(ramp(), delay=delay)[0, after] == pytest.approx(MIDDLE[after] - delay, rel=1e-9)


def test_a_negative_delay_shows_a_ramp_early() -> None:
    before = BOUNDS[1:] < END[-1] - 10e-6
    assert shown(ramp(), delay=-4.6e-6)[0, before] == pytest.approx(MIDDLE[before] + 4.6e-6, rel=1e-9)


def test_samples_are_smooth_functions_of_the_delay() -> None:
    """Slopes left and right of a whole step differ by curvature alone; linear interpolation has a kink there."""
    rate, h = np.where(END < 300e-6, 1.0, 0.0), 1e-3 * STEP
    early, there, late = (shown(rate, delay=6e-6 + sign * h)[0] for sign in (-1, 0, 1))
    np.testing.assert_allclose((there - early) / h, (late - there) / h, atol=2e-2 * np.abs((late - there) / h).max())


@pytest.mark.parametrize(
    "values",
    [
        {"delay": 12.7e-6},
        {"cutoff": 30e3},
        {"cutoff": 30e3, "delay": 20e-6},
    ],
)
@pytest.mark.parametrize("law", ["cascade", "butterworth", "zero-phase"])
def test_delay_and_low_pass_conserve_the_volume(values: dict[str, float], law: str) -> None:
    """Before and after the injection lie 40 time constants of the slowest filter: e^-40 is lost."""
    volume = np.sum(shown(hump(), law=law, **values)[0] * np.diff(BOUNDS))
    assert volume == pytest.approx(STEP * np.sum(hump()), rel=1e-9)


@pytest.mark.parametrize(
    "values",
    [
        {"echo_share": 0.06, "echo_delay": 0.35e-3, "echo_lag": 0.14e-3},
        {"echo_share": 0.0955, "echo_delay": 302.5e-6, "second_echo_share": 0.0324, "second_echo_delay": 3e-3},
        {"echo_share": -0.05, "echo_delay": 41.3e-6, "echo_lag": 20e-6},
        {"second_echo_share": 0.3, "second_echo_delay": 0.5e-3, "delay": 12.7e-6, "cutoff": 30e3},
    ],
)
def test_echoes_conserve_the_volume(values: dict[str, float]) -> None:
    """The echo's own delay and 40 of its time constants lie behind the injection: e^-40 is lost."""
    rate = np.concatenate([hump(), np.zeros(9000 - STEPS)])
    bounds = 3e-6 * np.arange(3001)
    volume = np.sum(shown(rate, bounds, **values)[0] * np.diff(bounds))
    assert volume == pytest.approx(STEP * np.sum(hump()), rel=1e-9)


def test_gain_and_offset_are_linear() -> None:
    neutral = shown(hump())
    np.testing.assert_allclose(shown(hump(), gain=1.03, offset=-2e-3), 1.03 * neutral - 2e-3, rtol=1e-14)


def test_neutral_samples_are_means_of_their_steps() -> None:
    np.testing.assert_allclose(shown(hump())[0], hump().reshape(-1, 3).mean(axis=1), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("echo", "lag"), [("echo", 140e-6), ("second_echo", 140e-6), ("echo", 0.0)])
def test_the_echo_of_a_step_follows_after_the_tube_and_its_lag(echo: str, lag: float) -> None:
    share, late = 0.06, 351e-6
    values = {f"{echo}_share": share, f"{echo}_delay": late, f"{echo}_lag": lag}
    since = np.maximum(BOUNDS - late, 0.0)
    risen = since + (lag * np.expm1(-since / lag) if lag else 0.0)  # integral of 1 − exp(−t/lag)
    expected = 1.0 - share + share * np.diff(risen) / np.diff(BOUNDS)
    assert shown(np.ones(STEPS), **values)[0] == pytest.approx(expected, rel=1e-9)


def test_the_signal_is_zero_after_the_direct_part_has_fallen() -> None:
    """An exponential decay reaches 1 % of its peak after ln 100 time constants; before that nothing changes."""
    tau = 80e-6
    rate = np.exp(-(END - 0.5 * STEP) / tau)
    plain, zeroed = shown(rate)[0], shown(rate, zeroing=0.01)[0]
    end = tau * math.log(100.0)
    assert np.array_equal(zeroed[BOUNDS[1:] < end - 3.0 * STEP], plain[BOUNDS[1:] < end - 3.0 * STEP])
    assert np.abs(zeroed[BOUNDS[:-1] > end + 3.0 * STEP]).max() < 1e-12 * plain.max()


def test_zeroing_moves_on_steadily_with_its_share() -> None:
    """No jump where the crossing passes from one step to the next: the volume is continuous in the share."""
    rate = np.exp(-(END - 0.5 * STEP) / 80e-6)
    volumes = [shown(rate, zeroing=share)[0].sum() for share in np.linspace(0.0100, 0.0104, 81)]
    steps = -np.diff(volumes)
    assert steps.min() > 0.0
    assert steps.max() < 3.0 * np.median(steps)


def test_the_late_cutoff_takes_over_from_the_opening_peak() -> None:
    rise = np.clip((END - 100e-6) / 50e-6, 0.0, 1.0)
    rate = rise * np.exp(-np.maximum(END - 150e-6, 0.0) / 400e-6)
    both = shown(rate, law="zero-phase", cutoff=9e3, late_cutoff=2.7e3, blend=200e-6)[0]
    early, late = (shown(rate, law="zero-phase", cutoff=f)[0] for f in (9e3, 2.7e3))
    peak = MIDDLE[np.argmax(early)]
    before = BOUNDS[1:] < peak - 10e-6
    np.testing.assert_allclose(both[before], early[before], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(both[BOUNDS[:-1] > peak + 210e-6], late[BOUNDS[:-1] > peak + 210e-6], rtol=1e-9)
    half = np.argmin(np.abs(MIDDLE - peak - 100e-6))
    assert both[half] == pytest.approx(0.5 * (early[half] + late[half]), rel=0.02)  # the peak is known to one sample


def pulse(duration: float, steps: int = 6000) -> np.ndarray:
    """A rate of 1 for a duration between ramps of 60 us, at rest for 1.5 ms before it."""
    since = STEP * (np.arange(steps) + 0.5) - 1.5e-3
    return np.clip(np.minimum(since, duration + 60e-6 - since) / 60e-6, 0.0, 1.0)


@pytest.mark.parametrize(
    ("order", "duration", "percent"),
    [
        (1, 0.3e-3, 3.5),
        (2, 0.2e-3, 3.6),
        (2, 0.3e-3, 0.4),
        (2, 0.5e-3, 0.5),
        (2, 1e-3, 0.3),
        (2, 2e-3, 0.1),
        (4, 0.3e-3, 0.1),
    ],
)
def test_the_late_cutoff_changes_the_volume_by_as_much_as_the_page_says(
    order: int, duration: float, percent: float
) -> None:
    meter = Meter("bench", {"cutoff": 9e3, "late_cutoff": 2.7e3, "blend": 200e-6}, "zero-phase", order)
    rate, bounds = pulse(duration)[None], 3e-6 * np.arange(2001)
    seen = shown_rates(meter, given_values(meter, {}, 1), Flow(rate, 0.0, STEP), bounds)
    change = 100.0 * (np.sum(seen * np.diff(bounds)) / (STEP * rate.sum()) - 1.0)
    assert change == pytest.approx(percent, abs=0.05)  # the page rounds to one digit


@pytest.mark.parametrize("law", ["butterworth", "cascade"])
def test_a_late_cutoff_with_a_law_that_delays_is_refused(law: str) -> None:
    with pytest.raises(ConfigurationError, match=r'late_cutoff.*"zero-phase"'):
        Meter("bench", {"cutoff": 9e3, "late_cutoff": 2.7e3}, law)


@pytest.mark.parametrize(
    ("order", "cutoff", "worst"),
    [(1, 60e3, 2e-7), (2, 10e3, 3.1e-4), (2, 60e3, 8.2e-3), (2, 200e3, 4.0e-2), (3, 60e3, 5.4e-3)],
)
def test_a_cascade_is_as_far_from_its_step_response_as_the_page_says(order: int, cutoff: float, worst: float) -> None:
    """The response of n equal lags is the incomplete gamma function; 200 points of it make the mean of a step."""
    found = low_pass(np.ones(400), STEP, LowPass.CASCADE, order, cutoff)
    time = STEP * (np.arange(400 * 200) + 0.5) / 200
    exact = gammainc(order, 2.0 * np.pi * cutoff * time).reshape(400, 200).mean(axis=1)
    error = float(np.abs(found - exact).max())
    assert error <= worst
    assert order == 1 or error > 0.9 * worst


def test_candidates_have_the_bits_that_they_have_alone_and_failed_ones_no_number() -> None:
    rates = np.array([hump(), np.full(STEPS, np.nan), 0.7 * hump(), ramp()])
    meter = Meter("bench", {"zeroing": 0.01, "echo_share": 0.05, "echo_delay": 3.3e-5, "echo_lag": 1e-5}, "zero-phase")
    columns = {"delay": np.array([0.0, 1e-6, 2.2e-6, 9e-6]), "cutoff": np.array([30e3, 30e3, 12e3, 30e3])}
    together = shown_rates(meter, given_values(meter, columns, 4), Flow(rates, 0.0, STEP), BOUNDS)
    assert np.isnan(together[1]).all()
    for i in (0, 2, 3):
        own = given_values(meter, {key: value[i : i + 1] for key, value in columns.items()}, 1)
        np.testing.assert_array_equal(
            shown_rates(meter, own, Flow(rates[i : i + 1], 0.0, STEP), BOUNDS)[0], together[i]
        )


def test_quantities_have_gain_and_offset_of_their_own() -> None:
    meter = Meter("bench", {"gain": 0.98, "quantity_offset": "0.1 mm3", "offset": 1.0})
    found = shown_quantities(given_values(meter, {}, 1), np.array([[10e-9, 50e-9]]))
    assert found[0] == pytest.approx([9.9e-9, 49.1e-9], rel=1e-12)
