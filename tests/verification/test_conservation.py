"""Mass: what leaves the rail is injected, returned or still inside."""

from __future__ import annotations

from dataclasses import replace

import pytest

from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.simulate import simulate
from commonrail.physics import fuel_kernel as fuel
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.readers.fuel import load_fuel
from tests.tracing import trace_states

# a few thousand bookings of 1e-16 of the mass in the pipe, which is 100 times what is injected
ROUNDING = 1e-11


@pytest.mark.parametrize("wiring", ["pwm", "regulated", "rigid", "volume"])
@pytest.mark.parametrize("pressure", [40e6, 100e6, 180e6])
def test_books_balance(request: pytest.FixtureRequest, wiring: str, pressure: float) -> None:
    injector = request.getfixturevalue(wiring)
    pulses = (Energising(100e-6, 300e-6), Energising(1.0e-3, 600e-6))
    solution = simulate(injector, OperatingPoint(pressure, pulses))
    assert solution.injected_mass > 1e-6
    assert abs(solution.balance) < ROUNDING


def test_books_balance_with_a_fuel_that_is_compressed_adiabatically(regulated: Injector) -> None:
    point = OperatingPoint(160e6, 300e-6)
    solutions = [
        simulate(replace(regulated, fuel=replace(load_fuel("n-dodecane"), adiabatic=adiabatic)), point)
        for adiabatic in (False, True)
    ]
    assert all(abs(solution.balance) < ROUNDING for solution in solutions)
    assert abs(solutions[1].injected_mass / solutions[0].injected_mass - 1.0) > 0.01  # it matters for a short injection


def test_books_balance_when_pressures_move_and_waves_travel(regulated: Injector) -> None:
    injector = regulated.with_values(
        {"feed_pipe.length": 0.8, "return_line.length": 1.3, "control_chamber.z_hole_from_inlet": 0.4}
    )
    rail = Trace.of([0.0, 400e-6, 900e-6], [150e6, 158e6, 144e6])
    cylinder = Trace.of([0.0, 1e-3], [4e6, 11e6])
    point = OperatingPoint(rail, 700e-6, cylinder_pressure=cylinder)
    assert abs(simulate(injector, point).balance) < ROUNDING


@pytest.mark.parametrize(("widening", "eccentricity"), [(0.0, 0.0), (2e-14, 0.4)])
def test_with_the_needle_shut_only_the_guides_leak(regulated: Injector, widening: float, eccentricity: float) -> None:
    guided = {"plunger_needle.gap_widening": widening, "plunger_needle.eccentricity": eccentricity}
    injector = regulated.with_values({"return_line.length": 0.0, "feed_pipe.friction_factor": 0.0, **guided})
    rows = trace_states(injector, OperatingPoint(160e6, (), horizon=4e-3), 1e-6)
    p = injector.parameters.plunger_needle
    f = fuel_coefficients(injector.fuel, injector.values[FUEL_TEMPERATURE])
    expected = 0.0
    for diameter, gap, length, before in (
        (p.plunger_diameter, p.plunger_gap, p.plunger_guide_length, rows["control_chamber.fuel.pressure"]),
        (p.guide_diameter, p.needle_gap, p.needle_guide_length, rows["accumulation.fuel.pressure"]),
    ):
        pressure = before[-1000:].mean()
        viscosity = fuel.kinematic_viscosity(f, 0.5 * (pressure + 0.5e6))
        cubed = (gap + widening * 0.5 * (pressure + 0.5e6)) ** 3 * (1.0 + 1.5 * eccentricity**2)
        expected += 3.141592653589793 * diameter * cubed / (12 * length) * (pressure - 0.5e6) / viscosity
    returned = (rows["cumulative_flows.returned"][-1] - rows["cumulative_flows.returned"][-1001]) / 1e-3
    # the pressures tremble by 1e-4 when the leakage sets in
    assert returned == pytest.approx(expected, rel=1e-6)
    assert rows["nozzle.injected"][-1] == 0.0
