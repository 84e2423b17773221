"""Temperatures along the way and their effect, against sums of the test's own and simulations with changed values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import commonrail as cr
from commonrail.engine.reference import simulate_reference
from commonrail.plugins.heating import Heating, beside, heat_capacity, throttle
from tests.cli.conftest import Command

POINT = cr.OperatingPoint(120e6, 500e-6)
T = 313.15


@pytest.fixture(scope="module")
def cool(pwm: cr.Injector) -> cr.Injector:
    """The injector with fuel that stays inside its range."""
    return pwm.with_values({"fuel.temperature": T})


@pytest.fixture(scope="module")
def solution(cool: cr.Injector) -> cr.Solution:
    return cr.simulate(cool, POINT)


@pytest.fixture(scope="module")
def found(cool: cr.Injector, solution: cr.Solution) -> Heating:
    return cr.models.heating(cool, POINT, solution)


def rise(injector: cr.Injector, low: float) -> float:
    return float(throttle(injector.fuel, T, np.linspace(120e6, low, 65))[-1]) - T


def test_fuel_at_rest_has_the_enthalpy_of_the_rail(cool: cr.Injector, found: Heating) -> None:
    assert found.rail == T
    assert found.returned - T == pytest.approx(rise(cool, POINT.initial_pressures()[2]), abs=0.02)
    assert found.injected - T == pytest.approx(rise(cool, POINT.initial_pressures()[1]), abs=0.02)
    assert T < found.control_chamber < found.returned
    assert not found.beyond


def test_the_jet_lacks_the_heat_of_its_motion(cool: cr.Injector, solution: cr.Solution, found: Heating) -> None:
    channels, mass = solution.channels, np.diff(solution.injected)
    energy = channels["discharge_coefficient"] ** 2 * (channels["sac_pressure"] - POINT.initial_pressures()[1])
    energy = np.sum(mass * 0.5 * (energy[1:] + energy[:-1])) / mass.sum() / solution.reference_density
    missing = found.injected - found.jet
    # the density is that on the way, 3 % larger, and the heat capacity that of colder fuel
    assert missing == pytest.approx(energy / heat_capacity(cool.fuel, found.injected), rel=0.06)
    assert T < found.sac < found.jet < found.injected


@pytest.mark.parametrize("rail", [100e6, 160e6])
@pytest.mark.parametrize("start", [T, T + 20.0])
def test_the_jet_is_that_of_an_isentrope(cool: cr.Injector, solution: cr.Solution, rail: float, start: float) -> None:
    """Enthalpy of the rail less (c_d)² of what CoolProp's n-dodecane loses at constant entropy, in 1 K."""
    coolprop = pytest.importorskip("CoolProp.CoolProp", reason="the development extra has CoolProp")
    point, share, state = cr.OperatingPoint(rail, 500e-6), 0.7, coolprop.AbstractState("HEOS", "n-Dodecane")
    state.update(coolprop.PT_INPUTS, rail, start)
    enthalpy, entropy = state.hmass(), state.smass()
    state.update(coolprop.PSmass_INPUTS, float(point.initial_pressures()[1]), entropy)
    state.update(
        coolprop.HmassP_INPUTS, enthalpy - share * (enthalpy - state.hmass()), float(point.initial_pressures()[1])
    )
    steady = {"rail_pressure": rail, "sac_pressure": rail, "discharge_coefficient": share**0.5}
    channels = {**solution.channels, **{key: np.full_like(solution.time, value) for key, value in steady.items()}}
    warm = replace(cool.with_values({"fuel.temperature": start}), fuel=cr.load_fuel("n-dodecane"))
    found = cr.models.heating(warm, point, replace(solution, channels=channels), effect=False)
    assert found.jet == pytest.approx(state.T(), abs=1.0)


def test_leak_with_its_own_heat(cool: cr.Injector, found: Heating) -> None:
    p = np.linspace(120e6, POINT.initial_pressures()[2], 201)
    warm = throttle(cool.fuel, T, p)
    film = [np.trapezoid(1.0 / cool.fuel.kinematic_viscosity(p, t), p) for t in (warm, T)]
    assert found.leak_factor == pytest.approx(film[0] / film[1], rel=2e-3)
    assert 1.2 < found.leak_factor < 3.0


def test_effect_is_that_of_other_simulations(cool: cr.Injector, solution: cr.Solution, found: Heating) -> None:
    low = POINT.initial_pressures()[2]
    hot = found.control_chamber
    cold_film, hot_film = cool.fuel.kinematic_viscosity(0.5 * (120e6 + low), np.array([T, hot]))
    names = [f"plunger_needle.{guide}_guide_length" for guide in ("plunger", "needle")]
    shorter = {name: cool.values[name] * cold_film / hot_film / found.leak_factor for name in names}
    other = cr.simulate(cool.with_values({**shorter, "fuel.temperature": hot}), POINT)
    assert found.effect is not None
    assert found.effect.injected == pytest.approx(other.injected_mass / solution.injected_mass - 1.0, abs=1e-9)
    assert found.effect.returned == pytest.approx(other.returned_mass / solution.returned_mass - 1.0, abs=1e-9)
    assert found.effect.returned_by_leak > 0.0
    assert cr.models.heating(cool, POINT, solution, effect=False) == replace(found, effect=None)


def test_limits_are_named_where_they_are_met(cool: cr.Injector, solution: cr.Solution, found: Heating) -> None:
    assert any("A-hole cavitates" in limit for limit in found.limits)  # contraction 0.60, see the theory
    assert not any("boil" in limit for limit in found.limits)
    light = replace(cool.fuel.vapour_law, coefficients=((float(np.log(2e6)),),))
    boiling = cr.models.heating(replace(cool, fuel=replace(cool.fuel, vapour_law=light)), POINT, solution, effect=False)
    assert [limit for limit in boiling.limits if "boil" in limit] == [
        "the returned fuel would boil: its vapour pressure is 2 MPa, that of the return 0.5 MPa"
    ]
    wide = cool.with_values({"control_chamber.a_hole_contraction": 1.0})
    assert not any("A-hole" in limit for limit in cr.models.heating(wide, POINT, solution, effect=False).limits)


def test_what_does_not_flow_has_no_temperature(cool: cr.Injector) -> None:
    point = cr.OperatingPoint(40e6, 50e-6)
    nothing = cr.models.heating(cool, point, cr.simulate(cool, point), effect=False)
    assert np.isnan([nothing.jet, nothing.injected, nothing.sac]).all()
    assert nothing.returned > T
    assert nothing.record()["jet"] is None


def test_without_a_flow_through_the_valve_there_is_no_effect_of_its_heat(cool: cr.Injector) -> None:
    point = cr.OperatingPoint(40e6, 0.0)
    closed = cr.models.heating(cool, point, cr.simulate(cool, point))
    assert closed.returned > T
    assert closed.effect is None


def test_a_reference_solution_is_estimated_without_its_control_chamber(cool: cr.Injector) -> None:
    """Of the temperatures that its channels give, each is that of a fast solution."""
    point = cr.OperatingPoint(40e6, 20e-6, horizon=60e-6)
    found = cr.models.heating(cool, point, simulate_reference(cool, point))
    fast = cr.models.heating(cool, point, cr.simulate(cool, point))
    assert (found.returned, found.leak_factor) == pytest.approx((fast.returned, fast.leak_factor))
    assert np.isnan(found.control_chamber)
    assert found.effect is None


def test_a_failure_of_the_estimate_never_costs_the_simulation(cool: cr.Injector, solution: cr.Solution) -> None:
    channels = {name: values for name, values in solution.channels.items() if name != "sac_pressure"}
    shown = beside(cool, POINT, replace(solution, channels=channels), None)
    assert shown.record == {"heating": None}
    assert "not estimated" in shown.figures[0][1]
    assert "sac_pressure" in shown.figures[0][1]


def test_at_the_ends_of_the_fuels_range(cool: cr.Injector, solution: cr.Solution) -> None:
    """A jet may be colder than the fuel was; a fuel that would leave its range has no effect that could be stated."""
    low, high = cool.fuel.temperature_range
    fast = cool.with_values({"fuel.temperature": low, "nozzle.discharge_maximum": 0.99, "nozzle.hole_diameter": 90e-6})
    cold = cr.models.heating(fast, POINT, cr.simulate(fast, POINT))
    assert cold.jet < low < cold.injected
    hot = cr.models.heating(cool.with_values({"fuel.temperature": high}), POINT, solution)
    assert hot.beyond
    assert hot.effect is None


def test_an_adiabatic_fuel_is_hotter_in_the_rail(cool: cr.Injector, solution: cr.Solution) -> None:
    fuel = replace(cr.load_fuel("n-dodecane"), adiabatic=True)
    found = cr.models.heating(replace(cool, fuel=fuel), POINT, solution, effect=False)
    assert 14.0 < found.rail - T < 19.0  # CoolProp: 14.5 K to 100 MPa, 20.9 K to 160 MPa


def test_simulate_shows_and_records_it(command: Command) -> None:
    asked = ("simulate", "virtual-lino-2016", "--rail-pressure", "120MPa", "--energising-time", "500us")
    shown = command(*asked, "--full")
    assert shown.status == 0, shown.err
    assert "fuel temperatures" in shown.out
    heat = command(*asked, "--json").record["heating"]
    assert heat["returned"] > heat["control_chamber"] > heat["rail"]
    assert heat["effect"]["returned"] > 0.0


def test_a_fuel_without_heat_capacity_says_so(cool: cr.Injector, solution: cr.Solution) -> None:
    from commonrail.plugins.heating import beside

    said = beside(replace(cool, fuel=replace(cool.fuel, heat_capacity_law=None)), POINT, solution, None)
    assert "heat capacity" in said.figures[0][1]
    assert said.record == {"heating": None}


@pytest.mark.parametrize("other", [cr.OperatingPoint(119e6, 500e-6), cr.OperatingPoint(120e6, 600e-6)])
def test_the_solution_of_another_point_is_refused(
    cool: cr.Injector, solution: cr.Solution, other: cr.OperatingPoint
) -> None:
    with pytest.raises(cr.errors.ConfigurationError, match="another point"):
        cr.models.heating(cool, other, solution, effect=False)
