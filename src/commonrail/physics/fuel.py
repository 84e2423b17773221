"""Fuel properties for Python code: density, moduli, viscosity, wave speed over pressure, temperature.

Kernels do not call this: `commonrail.physics.fuel_polynomials` fits polynomials to a `Fuel` at one temperature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import ArrayLike

from commonrail.base.arguments import array, settle
from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.physics.elementary import cosine, exp, expm1, power

# The fuel laws of Eq. (2) (paper = Lino, Maione, Saponaro, Li 2016), vectorised and unit-free.
#
#     density, bulk modulus   y(p) = K1 + (1 - exp(-p/K2)) K3 p^K4
#     kinematic viscosity     y(p) = K1 + K2 p^K3
#
# Every K is a polynomial in temperature. Units follow the coefficients; pressures are in
# MPa here (a power of a pressure has no natural unit) and `Fuel` converts to SI.

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

    `p`: pressure, >= 0, in the unit that the coefficients were fitted in; `k1`, `k2`, `k3`, `k4`: coefficients at the
    wanted temperature; K2 = 0 means the limit in which the bracket is 1.
    """
    p = np.asarray(p, dtype=np.float64)
    return np.asarray(k1 + _bracket(p, k2) * k3 * _power(p, k4))


def saturating_slope(p: ArrayLike, k2: Floats, k3: Floats, k4: Floats) -> Floats:
    """Return the derivative of `saturating_law` with respect to pressure.

    `p`: pressure, > 0, in the unit that the coefficients were fitted in; `k2`, `k3`, `k4`: coefficients at the wanted
    temperature, as in `saturating_law`.
    """
    p = np.asarray(p, dtype=np.float64)
    rise = (1.0 - _bracket(p, k2)) / np.where(k2 > 0.0, k2, np.inf)
    return np.asarray(k3 * power(p, k4) * (rise + _bracket(p, k2) * k4 / p))


def power_law(p: ArrayLike, k1: Floats, k2: Floats, k3: Floats) -> Floats:
    """Return K1 + K2 p^K3, the kinematic viscosity of Eq. (2).

    `p`: pressure, >= 0, in the unit that the coefficients were fitted in; `k1`, `k2`, `k3`: coefficients at the wanted
    temperature.
    """
    return np.asarray(k1 + k2 * power(p, k3))


def log_compression(p: ArrayLike, k1: Floats, k2: Floats, k3: Floats, k4: Floats) -> Floats:
    """Return ln(rho(p)/rho(0)), the integral of dp/K from 0 to p, for K of Eq. (2).

    It integrates d(rho)/dp = rho/K by 48 Gauss points in the cube root of pressure, which removes
    the weak singularity of p^K4 at zero; the result is exact to rounding (about 1e-13).

    `p`: pressure, >= 0, in the unit that the coefficients were fitted in; `k1`, `k2`, `k3`, `k4`: coefficients of the
    modulus, as in `saturating_law`.
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


Polynomial = tuple[float, ...]

_MPA = 1e6
_MM2_PER_S = 1e-6
_TEMPERATURE_TOLERANCE = 1e-6  # K: rounding of a conversion from °C must not count as outside


@dataclass(frozen=True, slots=True)
class Origin:
    """Source of the numbers of one law.

    Attributes
    ----------
    mark : str
        M measured, C ECU calibration, F fitted or derived, E engineering estimate.
    source : str
        Origin: measured, fitted or assumed, and by whom.
    error : float
        Largest relative deviation from that source over the declared range; for a law marked E,
        the relative uncertainty that its author expects.
    """

    mark: str
    source: str
    error: float


@dataclass(frozen=True, slots=True)
class Law:
    """The coefficients K of one law of Eq. (2), each a polynomial in (T - 353.15 K)/(40 K).

    Attributes
    ----------
    coefficients : tuple of tuples of float
        One ascending polynomial per K; pressures in MPa, see `Fuel` for the unit of the result.
    origin : Origin
        Mark, source and error of the numbers.
    logarithmic : bool
        Eq. (2) is the natural logarithm of a viscosity, an addition: nu = exp(K1 + K2 p^K3) mm2/s.
    """

    coefficients: tuple[Polynomial, ...]
    origin: Origin
    logarithmic: bool = False

    def __post_init__(self) -> None:
        settle(self, coefficients=self.coefficients)

    def at(self, temperature: ArrayLike) -> tuple[Floats, ...]:
        """Return every K at a temperature [K]."""
        return tuple(coefficient(k, temperature) for k in self.coefficients)


@dataclass(frozen=True, slots=True)
class Fuel:
    """A liquid whose properties follow Eq. (2).

    The density law has two kinds. *Explicit* (``"eq2"``): rho is Eq. (2) itself and the isothermal
    modulus is its derivative. *Integrated*: the isothermal modulus is Eq. (2) and rho follows from
    d(rho)/dp = rho/K. Either way K = rho dp/d(rho) holds exactly.

    Below `pressure_range` the moduli and the viscosity are held at the values of its lower end, so
    that all stay positive and density stays monotone in tension; above it the laws are extrapolated.

    Attributes
    ----------
    name, title : str
        Key in the catalogue; what it is.
    density_law : Law
        K_rho1...K_rho4 [kg/m3, MPa] (explicit); the density at zero pressure [kg/m3] (integrated).
    bulk_modulus_law : Law or None
        K_B1...K_B4 of the isothermal modulus [MPa]; None where the density is explicit.
    isentropic_law : Law or None
        K_B1...K_B4 of the isentropic modulus [MPa]; None where it equals the isothermal one.
    viscosity_law : Law
        K_nu1...K_nu3 [mm2/s, MPa], of the logarithm where it is `Law.logarithmic`.
    vapour_law : Law
        One polynomial: the logarithm of the vapour pressure in Pa.
    pressure_range, temperature_range : (float, float)
        Where the stated errors hold [Pa], [K]. Temperatures outside raise `InputError`.
    mark, source : str
        The weakest mark among the laws; one sentence on the whole.
    adiabatic : bool
        Compressed without exchange of heat: the isentropic modulus, at the stated temperature, takes the place of the
        isothermal one in volumes and in the density that is integrated from it.
    heat_capacity_law : Law or None
        One polynomial: the isobaric specific heat capacity [J/(kg K)], the same at all pressures; None where it is not
        stated. No simulation reads it: see `commonrail.plugins.heating`.
    """

    name: str
    title: str
    density_law: Law
    bulk_modulus_law: Law | None
    isentropic_law: Law | None
    viscosity_law: Law
    vapour_law: Law
    pressure_range: tuple[float, float]
    temperature_range: tuple[float, float]
    mark: str
    source: str
    adiabatic: bool = False
    heat_capacity_law: Law | None = None

    def __post_init__(self) -> None:
        settle(self, pressure_range=self.pressure_range, temperature_range=self.temperature_range)
        if self.adiabatic and (self.bulk_modulus_law is None or self.isentropic_law is None):
            raise ConfigurationError(
                f"Fuel {self.name} states no isentropic modulus beside an isothermal one, so that adiabatic "
                "compression is the same as isothermal; omit compression, or state both moduli."
            )

    @property
    def compression_law(self) -> Law | None:
        """Law of the modulus that volumes feel; None where the density is explicit."""
        return self.isentropic_law if self.adiabatic else self.bulk_modulus_law

    @property
    def density_kind(self) -> str:
        """``"eq2"`` for an explicit density law, ``"integrated"`` for one that follows from K."""
        return "eq2" if self.bulk_modulus_law is None else "integrated"

    @property
    def errors(self) -> dict[str, float]:
        """Stated relative error of each law, by the name of the property."""
        stated = {"density": self.density_law, "bulk_modulus": self.bulk_modulus_law}
        stated |= {"isentropic_bulk_modulus": self.isentropic_law}
        stated |= {"kinematic_viscosity": self.viscosity_law, "vapour_pressure": self.vapour_law}
        stated |= {"heat_capacity": self.heat_capacity_law}
        return {name: law.origin.error for name, law in stated.items() if law is not None}

    def density(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the density [kg/m3], Eq. (2).

        Parameters
        ----------
        p, temperature : array_like
            Pressure [Pa] and temperature [K], or texts with units; they broadcast against each other.

        Raises
        ------
        ConfigurationError
            If one is not a finite number, or their shapes do not broadcast (so do all methods of this class).
        InputError
            If a temperature lies outside `temperature_range` (so do all methods of this class).
        """
        p_in_range, tension, at = self._read_arguments(p, temperature)
        stretch = exp(tension / _modulus(self, p_in_range, at))
        return np.asarray(_density(self, p_in_range, at) * stretch)

    def bulk_modulus(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the bulk modulus rho dp/d(rho) [Pa], isothermal unless `adiabatic`; shapes as in `density`."""
        p_in_range, _, at = self._read_arguments(p, temperature)
        return np.asarray(_MPA * _modulus(self, p_in_range, at))

    def isentropic_bulk_modulus(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the isentropic bulk modulus [Pa], the one that waves feel."""
        if self.isentropic_law is None:
            return self.bulk_modulus(p, temperature)
        p_in_range, _, at = self._read_arguments(p, temperature)
        return np.asarray(_MPA * saturating_law(p_in_range, *self.isentropic_law.at(at)))

    def sound_speed(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the speed of sound sqrt(K_S/rho) [m/s]."""
        modulus = self.isentropic_bulk_modulus(p, temperature)
        return np.asarray(np.sqrt(modulus / self.density(p, temperature)))

    def kinematic_viscosity(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the kinematic viscosity [m2/s], Eq. (2), or its exponential where the law is logarithmic."""
        p_in_range, _, at = self._read_arguments(p, temperature)
        value = power_law(p_in_range, *self.viscosity_law.at(at))
        return np.asarray(_MM2_PER_S * (exp(value) if self.viscosity_law.logarithmic else value))

    def vapour_pressure(self, temperature: ArrayLike) -> Floats:
        """Return the vapour pressure [Pa], the exponential of a polynomial in temperature."""
        return np.asarray(exp(self.vapour_law.at(_check_temperature(self, temperature))[0]))

    def _read_arguments(self, p: ArrayLike, temperature: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Pressure held at the range's lower end, what lies below it, both in MPa, and temperature [K]."""
        at, pressure = _check_temperature(self, temperature), array(p, "Pa", "pressure") / _MPA
        try:
            np.broadcast_shapes(pressure.shape, at.shape)
        except ValueError:
            raise ConfigurationError(
                f"The pressure of shape {pressure.shape} and the temperature of shape {at.shape} must be of one shape, "
                "or one of them a single number."
            ) from None
        low = self.pressure_range[0] / _MPA
        return np.maximum(pressure, low), np.minimum(pressure - low, 0.0), at

    def is_defined_at(self, temperature: ArrayLike) -> Bools:
        """Return which temperatures [K] lie in `temperature_range`."""
        asked = np.asarray(temperature, dtype=np.float64)
        low, high = self.temperature_range
        return np.asarray((asked >= low - _TEMPERATURE_TOLERANCE) & (asked <= high + _TEMPERATURE_TOLERANCE))


def _check_temperature(fuel: Fuel, temperature: ArrayLike) -> Floats:
    """Temperatures [K] as an array; InputError if one lies outside the fuel's range."""
    asked = array(temperature, "K", "temperature", finite=False)
    low, high = fuel.temperature_range
    inside = fuel.is_defined_at(asked)
    if not np.all(inside):
        wrong = float(np.atleast_1d(asked)[~np.atleast_1d(inside)][0])
        raise InputError(
            f"Fuel {fuel.name} is defined from {low:g} to {high:g} K but was asked for at "
            f"{wrong:g} K: give an absolute temperature inside this range, or another fuel."
        )
    return asked


def _density(fuel: Fuel, p: Floats, temperature: ArrayLike) -> Floats:
    """Density [kg/m3] at pressures inside the range [MPa]."""
    if fuel.compression_law is None:
        return saturating_law(p, *fuel.density_law.at(temperature))
    compression = log_compression(p, *fuel.compression_law.at(temperature))
    return np.asarray(fuel.density_law.at(temperature)[0] * exp(compression))


def _modulus(fuel: Fuel, p: Floats, temperature: ArrayLike) -> Floats:
    """Modulus rho dp/d(rho) [MPa] at pressures inside the range [MPa]."""
    if fuel.compression_law is not None:
        return saturating_law(p, *fuel.compression_law.at(temperature))
    _, k2, k3, k4 = fuel.density_law.at(temperature)
    return _density(fuel, p, temperature) / saturating_slope(p, k2, k3, k4)
