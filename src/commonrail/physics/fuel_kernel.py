"""A fuel at one temperature as the hot loop sees it: polynomials and scalar laws."""

from __future__ import annotations

import math
from typing import NamedTuple

from commonrail.physics.law import physics

# The state of every volume is a density, so pressure is a polynomial of density, and dp/d(rho) is its
# exact derivative: mass then neither appears nor drifts. In tension (below the density at zero
# pressure) pressure continues along the tangent, so it stays monotone at any density. The coefficients
# come from `commonrail.physics.fuel_polynomials.fuel_coefficients`, which states their error against
# Eq. (2).

_PER_100_MPA = 1e-8


class FuelCoefficients(NamedTuple):
    """A fuel at one temperature.

    Pressure is ``p1 x + p2 x^2 + ... + p7 x^7`` [Pa] with ``x = rho/reference_density - 1`` for
    x >= 0, and ``p1 x`` for x < 0. The other polynomials are in ``s = p/(100 MPa)``, p >= 0.
    """

    reference_density: float
    """Density at zero pressure [kg/m3]."""
    inverse_reference_density: float
    """Its inverse [m3/kg], so that the loop does not divide."""
    p1: float
    """Coefficients of pressure [Pa]; p1 is the bulk modulus at zero pressure."""
    p2: float
    p3: float
    p4: float
    p5: float
    p6: float
    p7: float
    d1: float
    """Coefficients of x in s [-]: where the inverse of the pressure polynomial starts."""
    d2: float
    d3: float
    d4: float
    u0: float
    """Coefficients of the inverse kinematic viscosity in s [s/m2], up to s = 3: leakage multiplies."""
    u1: float
    u2: float
    u3: float
    u4: float
    u5: float
    r0: float
    """Coefficients of the ratio of isentropic to isothermal modulus in s [-]."""
    r1: float
    r2: float
    vapour_pressure: float
    """Pressure at which the liquid boils [Pa]."""


class PressureAndStiffness(NamedTuple):
    """Pressure of a lumped volume and its slope."""

    pressure: float
    """Pressure [Pa]."""
    stiffness: float
    """dp/d(rho) = K/rho, isothermal [Pa m3/kg]."""


@physics
def pressure(f: FuelCoefficients, rho: float) -> float:
    """Return the pressure [Pa] at a density, negative in tension.

    `rho`: density ρ [kg/m3], > 0; fitted up to 1.4 times the fuel's range of pressure.
    """
    return _pressure_of_strain(f, rho * f.inverse_reference_density - 1.0)


@physics
def stiffness(f: FuelCoefficients, rho: float) -> float:
    """Return dp/d(rho) = K/rho [Pa m3/kg], the exact derivative of `pressure`; isothermal.

    Arguments as in `pressure`.
    """
    x = rho * f.inverse_reference_density - 1.0
    return _slope_of_strain(f, x) * f.inverse_reference_density


@physics
def pressure_and_stiffness(f: FuelCoefficients, rho: float) -> PressureAndStiffness:
    """Return `pressure` and `stiffness` at a density, without a division.

    Arguments as in `pressure`.
    """
    x = rho * f.inverse_reference_density - 1.0
    c = max(x, 0.0)
    # Horner's scheme for the polynomial and, in step with it, for its derivative
    b5 = f.p6 + c * f.p7
    b4 = f.p5 + c * b5
    b3 = f.p4 + c * b4
    b2 = f.p3 + c * b3
    b1 = f.p2 + c * b2
    slope = b1 + c * (b2 + c * (b3 + c * (b4 + c * (b5 + c * f.p7))))
    secant = c * b1  # of the non-linear part
    return PressureAndStiffness(f.p1 * x + c * secant, (f.p1 + secant + c * slope) * f.inverse_reference_density)


@physics
def density(f: FuelCoefficients, p: float) -> float:
    """Return the density [kg/m3] at a pressure: the inverse of `pressure`, by three Newton steps from a quartic guess.

    `p`: pressure p [Pa]. Exact to rounding up to 350 MPa (1.4 times the fuel's range) and in tension, where the
    polynomial is a line; within 1e-10 up to 400 MPa.
    """
    s = max(p, 0.0) * _PER_100_MPA
    start = s * (f.d1 + s * (f.d2 + s * (f.d3 + s * f.d4)))
    x = _newton(f, _newton(f, _newton(f, start, p), p), p)
    return f.reference_density * (1.0 + x)


@physics
def fluidity(f: FuelCoefficients, p: float) -> float:
    """Return the inverse kinematic viscosity [s/m2] at a pressure, 1/ν of Eq. (2).

    `p`: pressure p [Pa]; the result is constant in tension and above 300 MPa.
    """
    s = min(max(p * _PER_100_MPA, 0.0), 3.0)
    return f.u0 + s * (f.u1 + s * (f.u2 + s * (f.u3 + s * (f.u4 + s * f.u5))))


@physics
def kinematic_viscosity(f: FuelCoefficients, p: float) -> float:
    """Return the kinematic viscosity [m2/s] at a pressure, ν of Eq. (2).

    Arguments as in `fluidity`.
    """
    return 1.0 / fluidity(f, p)


@physics
def dynamic_viscosity(f: FuelCoefficients, p: float) -> float:
    """Return the dynamic viscosity η = ρ ν [Pa s] at a pressure.

    Arguments as in `fluidity`.
    """
    return density(f, p) / fluidity(f, p)


@physics
def sound_speed(f: FuelCoefficients, rho: float) -> float:
    """Return the isentropic speed of sound [m/s] at a density, a of Eq. (6): a^2 = K_S/rho.

    `rho`: density ρ [kg/m3], > 0; in tension the ratio of the moduli is that at zero pressure.
    """
    state = pressure_and_stiffness(f, rho)
    s = max(state.pressure, 0.0) * _PER_100_MPA
    return math.sqrt(state.stiffness * (f.r0 + s * (f.r1 + s * f.r2)))


@physics
def _pressure_of_strain(f: FuelCoefficients, x: float) -> float:
    """Pressure [Pa] at a strain; `x`: strain ρ/ρ0 − 1 [1], > −1."""
    c = max(x, 0.0)
    secant = c * (f.p2 + c * (f.p3 + c * (f.p4 + c * (f.p5 + c * (f.p6 + c * f.p7)))))
    return f.p1 * x + c * secant


@physics
def _slope_of_strain(f: FuelCoefficients, x: float) -> float:
    """Derivative of `_pressure_of_strain` [Pa].

    Arguments as in `_pressure_of_strain`.
    """
    c = max(x, 0.0)
    high = 5.0 * f.p5 + c * (6.0 * f.p6 + c * (7.0 * f.p7))
    return f.p1 + c * (2.0 * f.p2 + c * (3.0 * f.p3 + c * (4.0 * f.p4 + c * high)))


@physics
def _newton(f: FuelCoefficients, x: float, p: float) -> float:
    """Strain [1] after one Newton step towards a pressure.

    `x`: strain ρ/ρ0 − 1 [1] before; `p`: pressure to be reached [Pa].
    """
    return x - (_pressure_of_strain(f, x) - p) / _slope_of_strain(f, x)
