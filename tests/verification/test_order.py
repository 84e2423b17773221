"""Measured order of the scheme: errors at 2, 1, 0.5, 0.25 us against 1/32 us."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.physics.injector import Injector
from tests.tracing import sampled, trace_states

STEPS = np.array([2.0, 1.0, 0.5, 0.25])  # [us]
FINEST = 1 / 32  # [us]
HORIZON = 1.6e-3


def rate(injector: Injector, point: OperatingPoint, dt_us: float) -> np.ndarray:
    return sampled(trace_states(injector, point, dt_us * 1e-6)["nozzle.injected"], dt_us * 1e-6)


@pytest.fixture(scope="module")
def errors(regulated: Injector) -> np.ndarray:
    """L1 of the rate, relative, at each of `STEPS`; the current's plan is smooth."""
    point = OperatingPoint(160e6, 700e-6, horizon=HORIZON)
    fine = rate(regulated, point, FINEST)
    return np.array([np.abs(rate(regulated, point, dt) - fine).sum() / fine.sum() for dt in STEPS])


def test_order_of_a_whole_injection_is_nearly_two(errors: np.ndarray) -> None:
    """Smooth stretches are second order; a contact met inside a step errs by a share of it, at random."""
    slope = np.polyfit(np.log(STEPS), np.log(errors), 1)[0]
    print("L1 errors [%]:", 100 * errors, "order:", slope)
    # near one: something is lagged by a step somewhere; above two only as contacts happen to fall
    assert 1.3 < slope < 2.5


def test_every_halving_of_the_step_helps(errors: np.ndarray) -> None:
    assert np.all(errors[1:] < 0.8 * errors[:-1])


def test_the_default_step_is_good_to_a_thousandth(errors: np.ndarray) -> None:
    assert errors[1] < 1e-3


def test_a_wave_in_the_pipe_is_second_order(regulated: Injector) -> None:
    """Without needle and contacts: a smooth pulse of rail pressure rings in pipe and volume."""
    t = np.linspace(0.0, 200e-6, 801)
    pulse = Trace.of(t, 100e6 + 5e6 * np.sin(np.pi * t / 200e-6) ** 4)
    point = OperatingPoint(pulse, (), horizon=600e-6)

    def pressure(dt_us: float) -> np.ndarray:
        rows = trace_states(regulated, point, dt_us * 1e-6)
        return np.asarray(rows["accumulation.fuel.pressure"][:: round(4 / dt_us)])

    fine = pressure(FINEST)
    found = np.array([np.abs(pressure(dt) - fine).max() for dt in STEPS])
    slope = np.polyfit(np.log(STEPS), np.log(found), 1)[0]
    print("errors [Pa]:", found, "order:", slope)
    # pipe, volume and chain are each of second order where nothing touches
    assert 1.7 < slope < 2.5
