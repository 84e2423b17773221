"""Return line of a whole injector: mass through its cavity, and where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import coefficients_at
from commonrail.physics.injector import Injector
from tests.tracing import trace_states

LOW, DT, STEPS = 0.5e6, 1e-6, 700  # steps of a round trip
TWICE = ((0.0, 250e-6), (1150e-6, 500e-6))


@pytest.fixture(scope="module")
def tight(regulated: Injector) -> Injector:
    """Guides without leakage; waves come back after a whole number of steps."""
    probe = coefficients_at(regulated.with_values({"return_line.length": 1.0}), OperatingPoint(160e6, TWICE), DT)
    length = STEPS * DT / probe.return_line.round_trip
    gaps = dict.fromkeys(("plunger_needle.plunger_gap", "plunger_needle.needle_gap"), 0.0)
    return regulated.with_values({"return_line.length": length, **gaps})


def test_the_line_takes_what_the_valve_gives_and_the_cavity_what_is_missing(tight: Injector) -> None:
    point = OperatingPoint(160e6, TWICE, return_pressure=LOW)
    rows = trace_states(tight, point, DT)
    c = coefficients_at(tight, point, DT)
    pressure, cavity = rows["return_line.pressure"], rows["return_line.cavity"]
    # what arrives is what left a round trip ago, inverted at the tank
    left = np.concatenate((np.full(STEPS, LOW), rows["waves.back"][1:]))[: len(pressure) - 1]
    line_flow = (pressure[1:] - (2.0 * LOW - left)) / c.return_line.impedance
    drained = rows["cumulative_flows.returned"][1:]
    assert cavity.max() > 0.01 * drained[-1]  # there is one
    assert np.abs(DT * np.cumsum(line_flow) - drained - cavity[1:]).max() < 1e-10 * drained[-1]
    assert (pressure[cavity > 0.0] == c.fuel.vapour_pressure).all()
    assert pressure.min() == c.fuel.vapour_pressure


def test_a_high_return_pressure_leaves_no_cavity(tight: Injector) -> None:
    rows = trace_states(tight, OperatingPoint(160e6, TWICE, return_pressure=8e6), DT)
    assert rows["return_line.pressure"].min() > 1e6
    assert (rows["return_line.cavity"] == 0.0).all()
