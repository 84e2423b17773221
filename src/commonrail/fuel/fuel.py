"""A fuel as the host sees it: density, moduli, viscosity, wave speed over pressure, temperature.

The hot loop does not call this: `commonrail.fuel.coefficients` turns a `Fuel` at one temperature
into the polynomials of `commonrail.fuel.kernel`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arguments import array
from commonrail.arrays import Bools, Floats
from commonrail.elementary import exp
from commonrail.errors import ConfigurationError, InputError
from commonrail.fuel import laws

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
        What was measured, fitted or assumed, and by whom.
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
    """

    coefficients: tuple[Polynomial, ...]
    origin: Origin

    def at(self, temperature: ArrayLike) -> tuple[Floats, ...]:
        """Return every K at a temperature [K]."""
        return tuple(laws.coefficient(k, temperature) for k in self.coefficients)


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
        K_nu1...K_nu3 [mm2/s, MPa].
    vapour_law : Law
        One polynomial: the logarithm of the vapour pressure in Pa.
    pressure_range, temperature_range : (float, float)
        Where the stated errors hold [Pa], [K]. Temperatures outside raise `InputError`.
    mark, source : str
        The weakest mark among the laws; one sentence on the whole.
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
            If one is no finite number, or their shapes do not broadcast (so do all methods of this class).
        InputError
            If a temperature lies outside `temperature_range` (so do all methods of this class).
        """
        held, tension, at = self._read(p, temperature)
        stretch = exp(tension / self._modulus(held, at))
        return np.asarray(self._density(held, at) * stretch)

    def bulk_modulus(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the isothermal bulk modulus rho dp/d(rho) [Pa]; shapes as in `density`."""
        held, _, at = self._read(p, temperature)
        return np.asarray(_MPA * self._modulus(held, at))

    def isentropic_bulk_modulus(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the isentropic bulk modulus [Pa], the one that waves feel."""
        if self.isentropic_law is None:
            return self.bulk_modulus(p, temperature)
        held, _, at = self._read(p, temperature)
        return np.asarray(_MPA * laws.saturating_law(held, *self.isentropic_law.at(at)))

    def sound_speed(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the speed of sound sqrt(K_S/rho) [m/s]."""
        modulus = self.isentropic_bulk_modulus(p, temperature)
        return np.asarray(np.sqrt(modulus / self.density(p, temperature)))

    def kinematic_viscosity(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the kinematic viscosity [m2/s], Eq. (2)."""
        held, _, at = self._read(p, temperature)
        return np.asarray(_MM2_PER_S * laws.power_law(held, *self.viscosity_law.at(at)))

    def vapour_pressure(self, temperature: ArrayLike) -> Floats:
        """Return the vapour pressure [Pa], the exponential of a polynomial in temperature."""
        return np.asarray(exp(self.vapour_law.at(self._temperature(temperature))[0]))

    def _density(self, held: Floats, temperature: ArrayLike) -> Floats:
        if self.bulk_modulus_law is None:
            return laws.saturating_law(held, *self.density_law.at(temperature))
        compression = laws.log_compression(held, *self.bulk_modulus_law.at(temperature))
        return np.asarray(self.density_law.at(temperature)[0] * exp(compression))

    def _modulus(self, held: Floats, temperature: ArrayLike) -> Floats:
        """Isothermal modulus [MPa] at pressures inside the range [MPa]."""
        if self.bulk_modulus_law is not None:
            return laws.saturating_law(held, *self.bulk_modulus_law.at(temperature))
        _, k2, k3, k4 = self.density_law.at(temperature)
        return self._density(held, temperature) / laws.saturating_slope(held, k2, k3, k4)

    def _read(self, p: ArrayLike, temperature: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Pressure held at the range's lower end, what lies below it, both in MPa, and temperature [K]."""
        at, pressure = self._temperature(temperature), array(p, "Pa", "pressure") / _MPA
        try:
            np.broadcast_shapes(pressure.shape, at.shape)
        except ValueError:
            raise ConfigurationError(
                f"The pressure of shape {pressure.shape} and the temperature of shape {at.shape} must be of one shape, "
                "or one of them a single number."
            ) from None
        low = self.pressure_range[0] / _MPA
        return np.maximum(pressure, low), np.minimum(pressure - low, 0.0), at

    def defined_at(self, temperature: ArrayLike) -> Bools:
        """Return which temperatures [K] lie in `temperature_range`."""
        asked = np.asarray(temperature, dtype=np.float64)
        low, high = self.temperature_range
        return np.asarray((asked >= low - _TEMPERATURE_TOLERANCE) & (asked <= high + _TEMPERATURE_TOLERANCE))

    def _temperature(self, temperature: ArrayLike) -> Floats:
        asked = array(temperature, "K", "temperature", finite=False)
        low, high = self.temperature_range
        inside = self.defined_at(asked)
        if not np.all(inside):
            wrong = float(np.atleast_1d(asked)[~np.atleast_1d(inside)][0])
            raise InputError(
                f"Fuel {self.name} is defined from {low:g} to {high:g} K but was asked for at "
                f"{wrong:g} K: give an absolute temperature inside this range, or another fuel."
            )
        return asked
