"""Leakage through a guide, Eq. (5), its gap widened by pressure, its rod off the centre."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from commonrail.physics.connections import guide_leak, widening_leak
from commonrail.physics.flow import Guide, conductance_growth, gap_conductance, guide_of, leakage_slope
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.readers.injector import load_injector

WIDENING = 4e-3 / (210e9 * (1.0 - (4.0 / 17.0) ** 2))  # Lamé: a guide of 4 mm in a steel body of 17 mm


def test_a_number_worked_out_by_hand() -> None:
    # d = 4 mm, g = 2.5 um, l = 20 mm:  π · 4e-3 · 15.625e-18 / 0.24 = 8.18123e-19 m³
    conductance = gap_conductance(4e-3, 2.5e-6, 20e-3, 0.0)
    assert conductance == pytest.approx(8.18123e-19, rel=1e-6)  # six digits were worked out
    # ν = 2 mm²/s, Δp = 160 MPa:  8.18123e-19 / 2e-6 · 160e6 = 6.54498e-5 kg/s
    assert leakage_slope(conductance, 1.0 / 2e-6) * 160e6 == pytest.approx(6.54498e-5, rel=1e-6)


def test_it_grows_with_the_cube_of_the_gap() -> None:
    wide, narrow = (gap_conductance(4e-3, gap, 20e-3, 0.0) for gap in (5e-6, 2.5e-6))
    assert wide == pytest.approx(8 * narrow, rel=1e-14)


@pytest.mark.parametrize("eccentricity", [0.3, 1.0])
def test_a_rod_off_the_centre_leaks_what_the_films_around_it_do(eccentricity: float) -> None:
    """Sum over the circumference of plane Poiseuille flows, each with the local gap g (1 + ε cos φ)."""
    around, _ = quad(lambda angle: (1.0 + eccentricity * math.cos(angle)) ** 3 / (2.0 * math.pi), 0.0, 2.0 * math.pi)
    shape = [gap_conductance(4e-3, 2.5e-6, 20e-3, each) for each in (eccentricity, 0.0)]
    assert shape[0] / shape[1] == pytest.approx(around, rel=1e-10)


def test_the_gap_widens_in_proportion_to_the_pressure_and_a_tight_guide_stays_tight() -> None:
    guide = guide_of(4e-3, 2.5e-6, 20e-3, 0.0, WIDENING)
    assert conductance_growth(guide.growth, 80e6) == pytest.approx((1.0 + WIDENING * 80e6 / 2.5e-6) ** 3, rel=1e-12)
    assert guide_of(4e-3, 0.0, 20e-3, 0.0, WIDENING) == Guide(0.0, 0.0)


# Largest error of the midpoint rule. Without widening it is that of Eq. (5), with ν at the mean pressure.
@pytest.mark.parametrize(
    ("pressure", "widening", "error"),
    [(40e6, 0.0, 0.01), (160e6, 0.0, 0.12), (40e6, WIDENING, 0.004), (100e6, WIDENING, 0.015), (160e6, WIDENING, 0.04)],
)
def test_it_is_near_the_integral_of_reynolds_equation_along_the_gap(
    pressure: float, widening: float, error: float
) -> None:
    """q l = π d/12 ∫ g(p)³/ν(p) dp with the local gap and viscosity, by quadrature."""
    injector = load_injector("cri2-16")
    temperature, gap, low = injector.values[FUEL_TEMPERATURE], 2.5e-6, 0.1e6

    def mobility(p: float) -> float:
        viscosity = injector.fuel.kinematic_viscosity(np.array([p]), temperature)[0]
        return float((gap + widening * p) ** 3 / viscosity)

    integral, _ = quad(mobility, low, pressure)
    expected = math.pi * 4e-3 / (12.0 * 20e-3) * integral
    coefficients = type("Coefficients", (), {"fuel": fuel_coefficients(injector.fuel, temperature)})
    guide = guide_of(4e-3, gap, 20e-3, 0.0, widening)
    leak = widening_leak(coefficients, guide, pressure, low)  # type: ignore[arg-type]
    assert leak.mass_flow == pytest.approx(expected, rel=error)
    plain = guide_leak(coefficients, guide, pressure, low)  # type: ignore[arg-type]
    # at the pressure that the law is for, a rigid gap would be outside of that error
    assert (plain.mass_flow == leak.mass_flow) == (widening == 0.0)
    assert widening == 0.0 or pressure < 100e6 or plain.mass_flow < 0.6 * expected
