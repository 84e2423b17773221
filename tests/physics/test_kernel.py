"""The hot loop's scalar laws: exact derivative, exact inverse, safe at any density."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest

from commonrail.compiler.laws import declare_laws
from commonrail.physics import fuel_kernel
from commonrail.physics.fuel_kernel import FuelCoefficients
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.readers.fuel import load_fuel

FUELS = [
    pytest.param(fuel_coefficients(load_fuel(name), temperature), id=f"{name} {temperature:.0f} K")
    for name in ("iso4113", "n-dodecane")
    for temperature in (293.15, 353.15, 393.15)
]
every_fuel = pytest.mark.parametrize("f", FUELS)


def naive_pressure(f: FuelCoefficients, rho: float) -> float:
    """The definition, term by term."""
    x = rho / f.reference_density - 1.0
    if x < 0.0:
        return f.p1 * x
    terms = (f.p1, f.p2, f.p3, f.p4, f.p5, f.p6, f.p7)
    return math.fsum(p * x**power for power, p in enumerate(terms, start=1))


@every_fuel
def test_pressure_is_the_polynomial_that_the_fields_describe(f: FuelCoefficients) -> None:
    for rho in np.linspace(0.95, 1.22, 28) * f.reference_density:
        # rounding: x carries 1e-16 absolute, times a modulus of at most 5 GPa
        assert fuel_kernel.pressure(f, rho) == pytest.approx(naive_pressure(f, rho), rel=1e-13, abs=5e-6)


@every_fuel
def test_stiffness_is_the_derivative_of_pressure(f: FuelCoefficients) -> None:
    for rho in np.array([0.9, 0.97, 1.01, 1.05, 1.1, 1.15]) * f.reference_density:
        h = 1e-5 * f.reference_density
        slope = (fuel_kernel.pressure(f, rho + h) - fuel_kernel.pressure(f, rho - h)) / (2 * h)
        # central difference: truncation some 1e-7 at the far end, rounding 1e-11
        assert fuel_kernel.stiffness(f, rho) == pytest.approx(slope, rel=1e-6)


@every_fuel
def test_integral_of_stiffness_is_pressure_so_mass_cannot_drift(f: FuelCoefficients) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(8)  # exact for a polynomial of degree 15
    low, high = f.reference_density, fuel_kernel.density(f, 250e6)
    half = 0.5 * (high - low)
    slopes = [fuel_kernel.stiffness(f, low + half * (1 + node)) for node in nodes]
    # rounding of a 250 MPa sum
    assert half * np.dot(weights, slopes) == pytest.approx(fuel_kernel.pressure(f, high), rel=1e-12)


@every_fuel
def test_both_at_once_are_the_two_laws(f: FuelCoefficients) -> None:
    for rho in np.array([0.95, 1.0, 1.07, 1.15]) * f.reference_density:
        both = fuel_kernel.pressure_and_stiffness(f, rho)
        # the compiler may contract multiply-adds differently where it inlines
        assert both.pressure == pytest.approx(fuel_kernel.pressure(f, rho), rel=1e-13, abs=5e-6)
        assert both.stiffness == pytest.approx(fuel_kernel.stiffness(f, rho), rel=1e-13)


@every_fuel
def test_density_inverts_pressure(f: FuelCoefficients) -> None:
    for p in np.linspace(-20e6, 350e6, 75):
        rho = fuel_kernel.density(f, p)
        missed = fuel_kernel.pressure(f, rho) - p
        assert abs(missed) <= 1e-12 * rho * fuel_kernel.stiffness(f, rho)  # 1e-12 of the density
    for rho in np.linspace(0.9 * f.reference_density, fuel_kernel.density(f, 350e6), 26):
        assert fuel_kernel.density(f, fuel_kernel.pressure(f, rho)) == pytest.approx(rho, rel=1e-12)


@every_fuel
def test_pressure_rises_with_density_far_outside_the_range(f: FuelCoefficients) -> None:
    top = fuel_kernel.density(f, 400e6)
    rho = np.concatenate([np.linspace(1.0, f.reference_density, 200), np.linspace(f.reference_density, top, 400)])
    assert all(fuel_kernel.stiffness(f, value) > 0.0 for value in rho)
    assert np.all(np.diff([fuel_kernel.pressure(f, value) for value in rho[200:]])[1:] > 0.0)


@every_fuel
def test_viscosity_and_wave_speed_stay_positive_and_monotone(f: FuelCoefficients) -> None:
    pressures = np.linspace(0.0, 350e6, 71)
    for law, values in (
        (fuel_kernel.kinematic_viscosity, pressures),
        (fuel_kernel.sound_speed, [fuel_kernel.density(f, p) for p in pressures]),
    ):
        found = np.array([law(f, value) for value in values])
        assert np.all(found > 0.0)
        assert np.all(np.diff(found)[:60] > 0.0)
        assert np.all(np.diff(found) >= 0.0)  # the viscosity stays constant above 300 MPa
    assert fuel_kernel.kinematic_viscosity(f, -20e6) == 1.0 / f.u0
    assert fuel_kernel.sound_speed(f, fuel_kernel.density(f, -20e6)) > 0.0


@every_fuel
def test_zero_pressure_is_the_reference_density(f: FuelCoefficients) -> None:
    # one rounding of rho/reference - 1, times the modulus
    assert abs(fuel_kernel.pressure(f, f.reference_density)) <= 2.3e-16 * f.p1
    assert fuel_kernel.density(f, 0.0) == pytest.approx(f.reference_density, rel=1e-15)


@every_fuel
def test_slope_is_continuous_where_tension_begins(f: FuelCoefficients) -> None:
    below = fuel_kernel.stiffness(f, f.reference_density * (1 - 1e-9))
    above = fuel_kernel.stiffness(f, f.reference_density * (1 + 1e-9))
    assert below == pytest.approx(above, rel=1e-6)  # the slope changes by some 20 x strain


def test_a_density_that_is_not_a_number_stays_visible() -> None:
    f = fuel_coefficients(load_fuel("iso4113"), 353.15)
    assert math.isnan(fuel_kernel.pressure(f, math.nan))


def test_laws_run_inside_a_compiled_loop_over_lanes() -> None:
    f = fuel_coefficients(load_fuel("iso4113"), 353.15)
    pressures = np.linspace(-20e6, 300e6, 33)

    declare_laws("f64")

    @numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
    def there_and_back(f: FuelCoefficients, p: np.ndarray, out: np.ndarray) -> None:
        for lane in range(p.size):
            out[lane] = fuel_kernel.pressure_and_stiffness(f, fuel_kernel.density(f, p[lane])).pressure

    found = np.empty_like(pressures)
    there_and_back(f, pressures, found)
    # 1e-12 of the density at 3.8 GPa
    assert found == pytest.approx(pressures, abs=4e-3)
