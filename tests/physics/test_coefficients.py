"""The hot loop's polynomials against the laws they stand for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.physics import fuel_kernel
from commonrail.physics.fuel_kernel import FuelCoefficients
from commonrail.physics.fuel_polynomials import _errors, _Values, coefficient_rows, fuel_coefficients
from commonrail.readers.fuel import load_fuel

CASES = [(n, t) for n in ("iso4113", "n-dodecane") for t in (293.15, 313.15, 353.15, 393.15)]
INSIDE = np.linspace(0.0, 250e6, 101)
BEYOND = np.linspace(250e6, 350e6, 21)
TENSION = np.linspace(-20e6, 0.0, 11)


def evaluate(law: object, f: FuelCoefficients, values: np.ndarray) -> np.ndarray:
    return np.array([law(f, value) for value in values])  # type: ignore[operator]


@pytest.mark.parametrize(("name", "temperature"), CASES)
def test_polynomials_follow_the_laws_inside_the_range(name: str, temperature: float) -> None:
    fuel, f = load_fuel(name), fuel_coefficients(load_fuel(name), temperature)
    rho = fuel.density(INSIDE, temperature)
    modulus = fuel.bulk_modulus(INSIDE, temperature)
    # the bounds that docs/theory/fuel.md states
    assert evaluate(fuel_kernel.density, f, INSIDE) == pytest.approx(rho, rel=1e-5)
    assert evaluate(fuel_kernel.pressure, f, rho) == pytest.approx(INSIDE, abs=1e-5 * modulus.max())
    assert evaluate(fuel_kernel.stiffness, f, rho) * rho == pytest.approx(modulus, rel=0.002)
    viscosity = fuel.kinematic_viscosity(INSIDE, temperature)
    assert evaluate(fuel_kernel.kinematic_viscosity, f, INSIDE) == pytest.approx(viscosity, rel=0.035)
    # half the errors of both moduli
    speed = fuel.sound_speed(INSIDE, temperature)
    assert evaluate(fuel_kernel.sound_speed, f, rho) == pytest.approx(speed, rel=0.0036)
    assert f.vapour_pressure == pytest.approx(fuel.vapour_pressure(temperature), rel=1e-15)


@pytest.mark.parametrize(("name", "temperature"), CASES)
def test_polynomials_follow_the_laws_in_overshoot_and_tension(name: str, temperature: float) -> None:
    fuel, f = load_fuel(name), fuel_coefficients(load_fuel(name), temperature)
    rho = fuel.density(BEYOND, temperature)
    assert evaluate(fuel_kernel.density, f, BEYOND) == pytest.approx(rho, rel=3e-5)
    modulus = fuel.bulk_modulus(BEYOND, temperature)
    assert evaluate(fuel_kernel.stiffness, f, rho) * rho == pytest.approx(modulus, rel=0.003)
    # in tension the loop holds dp/d(rho), the law holds K: at -20 MPa they differ by p/K
    rho = fuel.density(TENSION, temperature)
    assert evaluate(fuel_kernel.density, f, TENSION) == pytest.approx(rho, rel=1e-3)


@pytest.mark.parametrize(("name", "temperature"), CASES)
def test_measured_errors_are_those_of_the_kernel(name: str, temperature: float) -> None:
    fuel, f = load_fuel(name), fuel_coefficients(load_fuel(name), temperature)
    pressures = np.linspace(*fuel.pressure_range, 101)
    error = _errors(_Values.of(fuel, pressures, np.array([temperature])), pressures, f)
    rho, modulus = fuel.density(INSIDE, temperature), fuel.bulk_modulus(INSIDE, temperature)
    found = evaluate(fuel_kernel.stiffness, f, rho) * rho / modulus - 1.0
    assert error.bulk_modulus == pytest.approx(np.abs(found).max(), rel=1e-6)
    found = (evaluate(fuel_kernel.pressure, f, rho) - INSIDE) / modulus
    assert error.density == pytest.approx(np.abs(found).max(), rel=1e-6)
    viscosity = fuel.kinematic_viscosity(INSIDE, temperature)
    found = evaluate(fuel_kernel.kinematic_viscosity, f, INSIDE) / viscosity - 1.0
    assert error.kinematic_viscosity == pytest.approx(np.abs(found).max(), rel=1e-6)


def test_moduli_that_are_equal_stay_equal() -> None:
    f = fuel_coefficients(load_fuel("iso4113"), 353.15)
    assert (f.r0, f.r1, f.r2) == pytest.approx((1.0, 0.0, 0.0), abs=1e-13)


def test_fields_are_plain_floats() -> None:
    f = fuel_coefficients(load_fuel("n-dodecane"), 353.15)
    assert {type(value) for value in f} == {float}


def test_results_are_cached_by_content_not_by_name() -> None:
    fuel = load_fuel("iso4113")
    first = fuel_coefficients(fuel, 333.15)
    assert fuel_coefficients(dataclasses.replace(fuel), 333.15) is first
    denser = dataclasses.replace(fuel.density_law, coefficients=((800.0, -25.8),))
    other = fuel_coefficients(dataclasses.replace(fuel, density_law=denser), 333.15)
    assert other.reference_density > first.reference_density


@pytest.mark.parametrize("name", ["iso4113", "n-dodecane"])
def test_temperatures_together_have_the_bits_that_each_has_alone(name: str) -> None:
    fuel, temperatures = load_fuel(name), np.linspace(320.0, 350.0, 37)  # more than are evaluated at once
    together = coefficient_rows(fuel, tuple(temperatures.tolist()))
    for own, temperature in zip(together, temperatures.tolist(), strict=True):
        assert own.tobytes() == np.array(fuel_coefficients(fuel, temperature)).tobytes()


def test_of_several_temperatures_the_one_that_is_refused_is_named() -> None:
    with pytest.raises(InputError, match="80 K"):
        coefficient_rows(load_fuel("iso4113"), (340.0, 80.0))
    with pytest.raises(ConfigurationError, match=r"n-dodecane-eq2 at 353\.15 K"):
        coefficient_rows(load_fuel("n-dodecane-eq2"), (353.15, 340.0))


def test_explicit_density_law_is_refused_with_a_cure() -> None:
    with pytest.raises(ConfigurationError, match='kind "integrated"'):
        fuel_coefficients(load_fuel("n-dodecane-eq2"), 353.15)


def test_temperature_outside_the_range_is_refused() -> None:
    with pytest.raises(InputError, match=r"iso4113 .*293\.15.* 80 K"):
        fuel_coefficients(load_fuel("iso4113"), 80.0)


def test_a_law_without_a_number_is_refused() -> None:
    fuel = load_fuel("iso4113")
    without = dataclasses.replace(fuel.viscosity_law, coefficients=((0.0,), (0.0,), (1.0,)))  # fluidity: 1/0
    with pytest.raises(ConfigurationError, match=r"353\.15 K .*coefficients"):
        fuel_coefficients(dataclasses.replace(fuel, viscosity_law=without), 353.15)
