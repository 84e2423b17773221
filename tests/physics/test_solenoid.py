"""Magnetic circuit, Eq. (11): roots found independently, force, number of air gaps."""

from __future__ import annotations

import math

import pytest
from scipy.optimize import brentq

from commonrail.physics.components import solenoid

MU0 = 4e-7 * math.pi
AREA, TURNS, GAP, IRON, MU_R, KNEE = 70e-6, 30.0, 50e-6, 0.04, 2000.0, 1.4


def drawn(gaps: float) -> solenoid.Parameters:
    return solenoid.Parameters(TURNS, 0.2, AREA, GAP, gaps, IRON, MU_R, KNEE, 0.0)


def flux_for(current: float, gaps: float, opening: float) -> float:
    """Root of Eq. (11): N i = n_g l_a φ/(μ0 A) + l_s H_s(φ/A)."""

    def excess(flux: float) -> float:
        b = flux / AREA
        field = b / (MU0 * MU_R) * (1 + (b / KNEE) ** 8)
        return gaps * (GAP + opening) * b / MU0 + IRON * field - TURNS * current

    return float(brentq(excess, 0.0, 1e-3, xtol=1e-18))


@pytest.mark.parametrize("gaps", [1.0, 2.0])
@pytest.mark.parametrize(("current", "opening"), [(1.0, 55e-6), (12.0, 55e-6), (19.0, 0.0)])
def test_current_belongs_to_its_flux(gaps: float, current: float, opening: float) -> None:
    c = solenoid.coefficients(drawn(gaps))
    flux = flux_for(current, gaps, opening)
    assert solenoid.circuit(c, flux, opening).current == pytest.approx(current, rel=1e-10)  # the root's tolerance


@pytest.mark.parametrize("flux", [1e-6, 5e-5, 1.2e-4])
def test_slope_is_the_derivative_of_the_current(flux: float) -> None:
    c = solenoid.coefficients(drawn(2.0))
    h = 1e-5 * flux
    ahead, behind = (solenoid.circuit(c, flux + s, 20e-6).current for s in (h, -h))
    # truncation: B⁸ bends by (8 · 1e-5)²
    assert solenoid.circuit(c, flux, 20e-6).slope == pytest.approx((ahead - behind) / (2 * h), rel=1e-7)


@pytest.mark.parametrize("gaps", [1.0, 2.0])
def test_force_is_that_of_every_gap(gaps: float) -> None:
    c = solenoid.coefficients(drawn(gaps))
    assert solenoid.magnetic_force(c, 8e-5) == pytest.approx(gaps * 8e-5**2 / (2 * MU0 * AREA), rel=1e-12)


def test_force_is_the_derivative_of_the_field_energy() -> None:
    """The virtual work of the gap, at constant flux: F = −½ φ² d(reluctance)/d(gap), so flux and force agree on n_g."""
    c = solenoid.coefficients(drawn(2.0))
    flux, h = 8e-5, 1e-7
    energy = [0.5 * flux * TURNS * solenoid.circuit(c, flux, x).current for x in (20e-6 - h, 20e-6 + h)]
    assert solenoid.magnetic_force(c, flux) == pytest.approx(
        (energy[1] - energy[0]) / (2 * h), rel=1e-9
    )  # linear in the gap
