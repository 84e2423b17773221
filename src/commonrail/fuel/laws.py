"""The fuel laws of Eq. (2) (paper = Lino, Maione, Saponaro, Li 2016), vectorised and unit-free.

    density, bulk modulus   y(p) = K1 + (1 - exp(-p/K2)) K3 p^K4
    kinematic viscosity     y(p) = K1 + K2 p^K3

Every K is a polynomial in temperature. Units follow the coefficients; pressures are in
MPa here (a power of a pressure has no natural unit) and `commonrail.fuel.fuel` converts to SI.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import ArrayLike

from commonrail.arrays import Floats
from commonrail.elementary import cosine, expm1, power

TEMPERATURE_ORIGIN = 353.15
"""Temperature [K] at which a K is the first coefficient of its polynomial: the paper's 80 °C."""

TEMPERATURE_SCALE = 40.0
"""Temperature difference [K] that changes the scaled temperature by one."""

_GAUSS_POINTS = 48


def _gauss_legendre(n: int) -> tuple[Floats, Floats]:
    """Return nodes and weights from 0 to 1, by Newton's method on the Legendre polynomial.

    NumPy's come from an eigenvalue solver of LAPACK, whose last bits depend on the processor.
    """
    x = cosine(np.pi * (np.arange(n) + 0.75) / (n + 0.5))
    for _ in range(8):  # quadratic convergence from a guess of four digits
        before, value = np.ones(n), x
        for k in range(2, n + 1):
            before, value = value, ((2 * k - 1) * x * value - (k - 1) * before) / k
        slope = n * (before - x * value) / (1.0 - x * x)
        x = x - value / slope
    return 0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope)


_NODES, _WEIGHTS = _gauss_legendre(_GAUSS_POINTS)


def scaled_temperature(temperature: ArrayLike) -> Floats:
    """Return (T - 353.15 K)/(40 K), the variable of every coefficient polynomial, for a temperature T [K]."""
    return (np.asarray(temperature, dtype=np.float64) - TEMPERATURE_ORIGIN) / TEMPERATURE_SCALE


def coefficient(polynomial: Sequence[float], temperature: ArrayLike) -> Floats:
    """Return K(T) of a polynomial, ascending, in the scaled temperature of T [K]."""
    return np.asarray(polyval(scaled_temperature(temperature), np.asarray(polynomial)))


def saturating_law(p: ArrayLike, k1: Floats, k2: Floats, k3: Floats, k4: Floats) -> Floats:
    """Return K1 + (1 - exp(-p/K2)) K3 p^K4, the density and bulk modulus of Eq. (2).

    Parameters
    ----------
    p : array_like
        Pressure, >= 0, in the unit that the coefficients were fitted in.
    k1, k2, k3, k4 : arrays
        Coefficients at the wanted temperature; K2 = 0 means the limit in which the bracket is 1.
    """
    p = np.asarray(p, dtype=np.float64)
    return np.asarray(k1 + _bracket(p, k2) * k3 * _power(p, k4))


def saturating_slope(p: ArrayLike, k2: Floats, k3: Floats, k4: Floats) -> Floats:
    """Return the derivative of `saturating_law` with respect to pressure.

    Parameters
    ----------
    p : array_like
        Pressure, > 0, in the unit that the coefficients were fitted in.
    k2, k3, k4 : arrays
        Coefficients at the wanted temperature, as in `saturating_law`.
    """
    p = np.asarray(p, dtype=np.float64)
    rise = (1.0 - _bracket(p, k2)) / np.where(k2 > 0.0, k2, np.inf)
    return np.asarray(k3 * power(p, k4) * (rise + _bracket(p, k2) * k4 / p))


def power_law(p: ArrayLike, k1: Floats, k2: Floats, k3: Floats) -> Floats:
    """Return K1 + K2 p^K3, the kinematic viscosity of Eq. (2).

    Parameters
    ----------
    p : array_like
        Pressure, >= 0, in the unit that the coefficients were fitted in.
    k1, k2, k3 : arrays
        Coefficients at the wanted temperature.
    """
    return np.asarray(k1 + k2 * power(p, k3))


def log_compression(p: ArrayLike, k1: Floats, k2: Floats, k3: Floats, k4: Floats) -> Floats:
    """Return ln(rho(p)/rho(0)), the integral of dp/K from 0 to p, for K of Eq. (2).

    It integrates d(rho)/dp = rho/K by 48 Gauss points in the cube root of pressure, which removes
    the weak singularity of p^K4 at zero; the result is exact to rounding (about 1e-13).

    Parameters
    ----------
    p : array_like
        Pressure, >= 0, in the unit that the coefficients were fitted in.
    k1, k2, k3, k4 : arrays
        Coefficients of the modulus, as in `saturating_law`.
    """
    p = np.asarray(p, dtype=np.float64)[..., None]
    modulus = saturating_law(p * _NODES * _NODES * _NODES, *(np.asarray(k)[..., None] for k in (k1, k2, k3, k4)))
    return np.asarray(np.sum(3.0 * _NODES * _NODES * _WEIGHTS * p / modulus, axis=-1))


def _bracket(p: Floats, k2: Floats) -> Floats:
    """Return 1 - exp(-p/K2), 1 where K2 = 0."""
    absent = np.asarray(k2) <= 0.0
    return np.where(absent, 1.0, -expm1(-p / np.where(absent, 1.0, k2)))


def _power(p: Floats, exponent: Floats) -> Floats:
    """Return p^K4, taken as 0 at p = 0: the bracket makes the product vanish there for K4 > -1."""
    positive = p > 0.0
    return np.where(positive, power(np.where(positive, p, 1.0), exponent), 0.0)
