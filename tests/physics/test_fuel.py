"""The fuels of the catalogue against tables, a reference equation of state and thermodynamics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.physics import fuel_kernel
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.readers.fuel import fuel_catalogue, load_fuel

NAMES = fuel_catalogue()
TEMPERATURES = np.linspace(293.15, 393.15, 11)[:, None]
EVERYWHERE = np.linspace(-20e6, 350e6, 75)  # Pa: the declared range, tension and overshoot

# n-dodecane at 80 °C from CoolProp: p, rho, a, K_T, K_S, nu in MPa, kg/m3, m/s, MPa, MPa, mm2/s.
TABLE = [
    (0.1, 705.0, 1075, 685, 814, 0.891),
    (80.0, 760.8, 1500, 1490, 1713, 1.758),
    (160.0, 794.8, 1776, 2214, 2508, 2.848),
]


@pytest.mark.parametrize("row", TABLE)
def test_n_dodecane_matches_the_table_at_80_degrees(row: tuple[float, ...]) -> None:
    p, rho, speed, isothermal, isentropic, viscosity = row
    fuel, state = load_fuel("n-dodecane"), (p * 1e6, 353.15)
    # stated errors of the fits, plus half a unit of the table's last digit
    assert fuel.density(*state) == pytest.approx(rho, abs=0.05 + 1e-4 * rho)
    assert fuel.sound_speed(*state) == pytest.approx(speed, abs=0.5 + 0.0035 * speed)
    assert fuel.bulk_modulus(*state) / 1e6 == pytest.approx(isothermal, abs=0.5 + 0.006 * isothermal)
    assert fuel.isentropic_bulk_modulus(*state) / 1e6 == pytest.approx(isentropic, abs=0.5 + 0.007 * isentropic)
    assert fuel.kinematic_viscosity(*state) * 1e6 == pytest.approx(viscosity, abs=0.05)


@pytest.mark.parametrize("name", ["n-dodecane", "n-dodecane-eq2"])
def test_n_dodecane_keeps_its_stated_errors_against_coolprop(name: str) -> None:
    coolprop = pytest.importorskip("CoolProp.CoolProp", reason="the development extra has CoolProp")
    fuel, state = load_fuel(name), coolprop.AbstractState("HEOS", "n-Dodecane")
    for temperature in (293.15, 315.0, 353.15, 393.15):  # 315 K is not a temperature of the fit
        for p in (0.1e6, 1e6, 10e6, 47e6, 80e6, 160e6, 200e6, 250e6):
            state.update(coolprop.PT_INPUTS, p, temperature)
            rho = state.rhomass()
            slope = state.first_partial_deriv(coolprop.iDmass, coolprop.iP, coolprop.iT)
            true = {"density": rho, "bulk_modulus": rho / slope}
            true["isentropic_bulk_modulus"] = rho * state.speed_sound() ** 2
            if p <= 200e6:  # where the viscosity was fitted
                true["kinematic_viscosity"] = state.viscosity() / rho
            for prop in true.keys() & fuel.errors.keys():
                found = getattr(fuel, prop)(p, temperature)
                assert found == pytest.approx(true[prop], rel=fuel.errors[prop]), (prop, p)
        state.update(coolprop.QT_INPUTS, 0, temperature)
        allowed = fuel.errors["vapour_pressure"]
        assert fuel.vapour_pressure(temperature) == pytest.approx(state.p(), rel=allowed)


def test_explicit_density_law_gives_no_usable_modulus_at_low_pressure() -> None:
    # the reason for the integrated kind: CoolProp has 685 MPa at 0.1 MPa and 80 °C
    modulus = load_fuel("n-dodecane-eq2").bulk_modulus(0.1e6, 353.15)
    assert modulus < 0.6 * 685e6


def test_iso4113_equals_its_definition_at_80_degrees() -> None:
    fuel = load_fuel("iso4113")
    p = np.array([0.0, 20.0, 80.0, 160.0, 250.0])
    modulus = 1050 + (1 - np.exp(-p / 20)) * 12.5 * p**0.945
    viscosity = 1.30 + 0.0105 * p**1.09
    assert fuel.bulk_modulus(p * 1e6, 353.15) / 1e6 == pytest.approx(modulus, rel=1e-14)
    assert fuel.isentropic_bulk_modulus(p * 1e6, 353.15) / 1e6 == pytest.approx(modulus, rel=1e-14)
    assert fuel.kinematic_viscosity(p * 1e6, 353.15) * 1e6 == pytest.approx(viscosity, rel=1e-14)
    assert fuel.density(0.0, 353.15) == 783.0


def test_iso4113_has_the_published_figures_at_160_mpa() -> None:
    fuel, state = load_fuel("iso4113"), (160e6, 353.15)
    # half a unit of the last published digit
    assert fuel.density(*state) == pytest.approx(861, abs=0.5)
    assert fuel.bulk_modulus(*state) == pytest.approx(2562e6, abs=0.5e6)
    assert fuel.sound_speed(*state) == pytest.approx(1725, abs=0.5)
    assert fuel.kinematic_viscosity(*state) == pytest.approx(3.95e-6, abs=0.005e-6)


def test_iso4113_passes_through_the_middle_of_its_specification() -> None:
    fuel = load_fuel("iso4113")
    per_kelvin = (783.0 - 825.0) / 65.0  # 825 kg/m3 at 15 °C, outside the declared range
    assert fuel.density(0.0, 293.15) == pytest.approx(825.0 + 5 * per_kelvin, abs=1e-3)
    assert fuel.kinematic_viscosity(0.0, 313.15) * 1e6 == pytest.approx(2.6, abs=1e-6)


def test_iso4113_viscosity_follows_the_walther_line() -> None:
    low, high = (np.log10(np.log10(nu + 0.7)) for nu in (2.6, 1.30))
    t0, t1 = np.log10([313.15, 353.15])
    line = low + (np.log10(TEMPERATURES) - t0) * (high - low) / (t1 - t0)
    wanted = 10 ** (10**line) - 0.7
    found = load_fuel("iso4113").kinematic_viscosity(0.0, TEMPERATURES) * 1e6
    assert found == pytest.approx(wanted, rel=0.003)  # the polynomial's distance, 0.28 %


def test_iso4113_modulus_has_the_relative_trend_of_n_dodecane() -> None:
    for p in (0.0, 160e6):
        oil, model = (load_fuel(n).isentropic_bulk_modulus for n in ("iso4113", "n-dodecane"))
        trend = model(0.0, TEMPERATURES) / model(0.0, 353.15)
        if p:
            rise = model(p, TEMPERATURES) - model(0.0, TEMPERATURES)
            trend = rise / (model(p, 353.15) - model(0.0, 353.15))
        ours = oil(p, TEMPERATURES) - (oil(0.0, TEMPERATURES) if p else 0.0)
        ours = ours / (oil(p, 353.15) - (oil(0.0, 353.15) if p else 0.0))
        assert ours == pytest.approx(trend, rel=1e-4)  # rounding of the coefficients


@pytest.mark.parametrize("name", NAMES)
def test_wave_speed_squared_is_isentropic_modulus_over_density(name: str) -> None:
    fuel = load_fuel(name)
    state = (EVERYWHERE, TEMPERATURES)
    wanted = fuel.isentropic_bulk_modulus(*state) / fuel.density(*state)
    assert fuel.sound_speed(*state) ** 2 == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("name", NAMES)
def test_density_slope_is_density_over_isothermal_modulus(name: str) -> None:
    fuel = load_fuel(name)
    p, h = np.array([-15e6, -1e6, 1e6, 10e6, 80e6, 160e6, 250e6, 340e6]), 2e3
    difference = fuel.density(p + h, TEMPERATURES) - fuel.density(p - h, TEMPERATURES)
    wanted = fuel.density(p, TEMPERATURES) / fuel.bulk_modulus(p, TEMPERATURES)
    # central difference over 4 kPa: truncation is below 2e-7 (at 1 MPa), rounding some 1e-8
    assert difference / (2 * h) == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_properties_are_positive_and_monotone_inside_and_outside_the_range(name: str) -> None:
    fuel = load_fuel(name)
    density = fuel.density(EVERYWHERE, TEMPERATURES)
    speed = fuel.sound_speed(EVERYWHERE, TEMPERATURES)
    modulus = fuel.isentropic_bulk_modulus(EVERYWHERE, TEMPERATURES)
    viscosity = fuel.kinematic_viscosity(EVERYWHERE, TEMPERATURES)
    for values in (density, speed, modulus, viscosity, fuel.bulk_modulus(EVERYWHERE, TEMPERATURES)):
        assert np.all(values > 0.0)
    assert np.all(np.diff(density, axis=1) > 0.0)
    for values in (modulus, viscosity):  # held constant in tension
        assert np.all(np.diff(values, axis=1) >= 0.0)
    for values in (density, speed, modulus, viscosity):  # hotter: lighter, softer, thinner
        assert np.all(np.diff(values, axis=0) < 0.0)
    assert np.all(np.diff(fuel.vapour_pressure(TEMPERATURES), axis=0) > 0.0)


def test_modulus_of_n_dodecane_is_larger_isentropic_than_isothermal() -> None:
    fuel = load_fuel("n-dodecane")
    ratio = fuel.isentropic_bulk_modulus(EVERYWHERE, TEMPERATURES) / fuel.bulk_modulus(EVERYWHERE, TEMPERATURES)
    assert np.all(ratio > 1.05)
    assert np.all(ratio < 1.25)


def test_shapes_broadcast() -> None:
    fuel = load_fuel("iso4113")
    assert fuel.density(160e6, 353.15).shape == ()
    assert fuel.density(EVERYWHERE, TEMPERATURES).shape == (11, 75)
    one = fuel.density(EVERYWHERE[40], TEMPERATURES[3, 0])
    assert fuel.density(EVERYWHERE, TEMPERATURES)[3, 40] == pytest.approx(one, rel=1e-15)


def test_shapes_that_do_not_broadcast_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"pressure .*\(2,\) .*temperature .*\(3,\)"):
        load_fuel("iso4113").density([1e6, 2e6], [300.0, 310.0, 320.0])


@pytest.mark.parametrize("temperature", [80.0, 293.0, 400.0, float("nan")])
def test_temperature_outside_the_range_is_refused(temperature: float) -> None:
    fuel = load_fuel("iso4113")
    for call in (fuel.density, fuel.sound_speed, fuel.kinematic_viscosity):
        with pytest.raises(InputError, match=r"iso4113 .*293\.15.* 393\.15 K"):
            call(1e6, [353.15, temperature])


def test_temperatures_rounded_from_celsius_are_inside() -> None:
    fuel = load_fuel("iso4113")
    assert fuel.density(0.0, np.nextafter(293.15, 0.0)) > fuel.density(0.0, 393.15000000000003)


def test_adiabatic_compression_follows_the_isentropic_modulus() -> None:
    """ρ = ρ(0) exp ∫ dp/K_S by quadrature; volumes and waves then feel one modulus."""
    plain, temperature = load_fuel("n-dodecane"), 353.15
    fuel = replace(plain, adiabatic=True)
    low = plain.pressure_range[0]
    compression, _ = quad(lambda p: 1.0 / float(plain.isentropic_bulk_modulus(p, temperature)), low, 160e6)
    expected = float(fuel.density(low, temperature)) * np.exp(compression)
    assert fuel.density(160e6, temperature) == pytest.approx(expected, rel=1e-7)  # of the quadrature
    f = fuel_coefficients(fuel, temperature)
    stiffness = fuel_kernel.stiffness(f, expected)
    modulus = float(plain.isentropic_bulk_modulus(160e6, temperature))
    assert stiffness * expected == pytest.approx(modulus, rel=2e-3)  # of the polynomials
    assert fuel_kernel.sound_speed(f, expected) ** 2 == pytest.approx(stiffness, rel=1e-9)


@pytest.mark.parametrize("temperature", [313.15, 353.15])
def test_an_adiabatic_fuel_is_near_the_isentrope_of_coolprop(temperature: float) -> None:
    coolprop = pytest.importorskip("CoolProp.CoolProp", reason="the development extra has CoolProp")
    plain, state = load_fuel("n-dodecane"), coolprop.AbstractState("HEOS", "n-Dodecane")
    fuel = replace(plain, adiabatic=True)
    state.update(coolprop.PT_INPUTS, 0.1e6, temperature)
    entropy = state.smass()
    for p in (80e6, 160e6):
        state.update(coolprop.PSmass_INPUTS, p, entropy)
        density, modulus = state.rhomass(), state.rhomass() * state.speed_sound() ** 2
        # it takes K_S at the temperature before the compression, which heats by 12 to 23 K
        assert fuel.density(p, temperature) == pytest.approx(density, rel=5e-3)
        assert modulus < fuel.bulk_modulus(p, temperature) < 1.08 * modulus
        assert plain.density(p, temperature) > 1.008 * density
        assert plain.bulk_modulus(p, temperature) < 0.95 * modulus


def test_a_fuel_of_one_modulus_is_not_called_adiabatic() -> None:
    with pytest.raises(ConfigurationError, match=r"iso4113 .*isentropic modulus"):
        replace(load_fuel("iso4113"), adiabatic=True)
