"""Coil and magnet inside the engine: steady flux against Eq. (11), L/R rise, eddy lag."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from tests.tracing import trace_states

MU0 = 4e-7 * math.pi
HELD = {"valve.spring_preload": 1000.0, "valve.spring_stiffness": 0.0}  # no magnet lifts it off its seat
LINEAR = {"solenoid.knee_flux_density": 1e3}  # [T], never reached


@pytest.mark.parametrize("gaps", [1.0, 2.0])
def test_a_held_current_belongs_to_the_flux_of_equation_11(regulated: Injector, gaps: float) -> None:
    injector = regulated.with_values(HELD | {"solenoid.air_gaps": gaps})
    point = OperatingPoint(80e6, 2e-3, horizon=1.9e-3)
    rows = trace_states(injector, point, 1e-6)
    s = injector.parameters.solenoid
    gap = s.residual_gap + 55e-6 - rows["valve.lift"][-1]  # the seat yields 10 um to 1000 N

    def excess(flux: float) -> float:
        b = flux / s.pole_area
        field = b / (MU0 * s.permeability) * (1 + (b / s.knee_flux_density) ** 8)
        return gaps * gap * b / MU0 + s.iron_length * field - s.turns * 12.0

    flux = brentq(excess, 0.0, 1e-3, xtol=1e-18)
    # 1.5 ms after the peak; the regulator's lag L/(R + G) is 2 us
    assert rows["solenoid.flux"][-1] == pytest.approx(flux, rel=1e-9)
    force = simulate(injector, point).channels["magnetic_force"][-1]
    assert force == pytest.approx(gaps * flux**2 / (2 * MU0 * s.pole_area), rel=1e-8)


def test_flux_rises_with_the_time_constant_of_coil_and_gap(by_voltage: Injector) -> None:
    lag, volts = 25e-6, 2.0
    injector = by_voltage.with_values(HELD | LINEAR | {"solenoid.eddy_lag": lag, "solenoid.resistance": 2.0})
    steady = Trace.of([-1.0, 1.0], [volts, volts])
    rows = trace_states(injector, OperatingPoint(80e6, 1e-3, drive=steady, horizon=1e-3), 1e-6)
    s = injector.parameters.solenoid
    gap = s.residual_gap + 55e-6 - rows["valve.lift"][0]
    reluctance = (2 * gap + s.iron_length / s.permeability) / (MU0 * s.pole_area)
    constant = s.turns**2 / reluctance / s.resistance  # L/R
    final = volts / s.resistance * s.turns / reluctance
    t = rows["time"]
    exact = final * (1 - np.exp(-t / constant))
    # the relaxation formula errs by (dt R/L)³/72 a step; the seat yields to the magnet by 0.02 um of 165
    assert rows["solenoid.flux"] == pytest.approx(exact, abs=5e-4 * final)
    assert constant > 100e-6  # else there is nothing to see
    lagged = final * (1 - (constant * np.exp(-t / constant) - lag * np.exp(-t / lag)) / (constant - lag))
    assert rows["solenoid.pulling_flux"] == pytest.approx(lagged, abs=5e-4 * final)
    assert np.max(np.abs(lagged - exact)) > 0.05 * final


def test_without_eddy_currents_the_flux_pulls_at_once(regulated: Injector) -> None:
    rows = trace_states(regulated, OperatingPoint(80e6, 300e-6, horizon=500e-6), 1e-6)
    assert np.array_equal(rows["solenoid.flux"], rows["solenoid.pulling_flux"])
