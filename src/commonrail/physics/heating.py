"""Temperature of a fuel along a change of pressure, throttled or compressed without exchange of heat.

An estimate beside a simulation, whose temperature is one number. The slopes are those of thermodynamics,

    throttled, at constant enthalpy:    dT/dp = (alpha T - 1)/(rho c_p)
    compressed, at constant entropy:    dT/dp = alpha T/(rho c_p)

with alpha the expansivity of the density law and c_p stated by the fuel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.physics.fuel import Fuel

_HALF_DIFFERENCE = 0.5  # K: of temperatures for the slope of density; third derivatives are negligible over it


def density_and_expansivity(fuel: Fuel, pressure: float, temperature: float) -> tuple[float, float]:
    """Density [kg/m3] and isobaric expansivity alpha = -(d rho/dT)/rho [1/K], a central difference.

    `pressure` [Pa]; `temperature` [K]: one outside the fuel's range counts as that at its end.
    """
    low, high = fuel.temperature_range
    at = min(max(temperature, low + _HALF_DIFFERENCE), high - _HALF_DIFFERENCE)
    real = replace(fuel, adiabatic=False)  # whose density is that at its temperature
    cold, hot = real.density(pressure, np.array([at - _HALF_DIFFERENCE, at + _HALF_DIFFERENCE])).tolist()
    mean = 0.5 * (cold + hot)
    return mean, (cold - hot) / (2.0 * _HALF_DIFFERENCE * mean)


def heat_capacity(fuel: Fuel, temperature: float) -> float:
    """Isobaric specific heat capacity [J/(kg K)] at a temperature [K], which is held at the ends of the fuel's range.

    Raises ConfigurationError if the fuel states none.
    """
    if fuel.heat_capacity_law is None:
        raise ConfigurationError(
            f"Fuel {fuel.name} states no heat capacity; add a table [heat_capacity] to its file (docs/howto/fuel.md)."
        )
    low, high = fuel.temperature_range
    return float(fuel.heat_capacity_law.at(min(max(temperature, low), high))[0])


def throttled(fuel: Fuel, temperature: float, pressures: Floats) -> Floats:
    """Temperatures (n,) [K] at pressures (n,) [Pa] that a fuel passes at constant enthalpy.

    As in a hole or a guide whose outflow has lost its motion, without heat to the walls. The midpoint rule between the
    pressures: 16 intervals over 160 MPa are exact to 0.01 K.

    `temperature`: at the first pressure [K]. Raises ConfigurationError as `heat_capacity` does.
    """
    return _along(fuel, temperature, pressures, 1.0)


def compressed(fuel: Fuel, temperature: float, pressures: Floats) -> Floats:
    """Temperatures (n,) [K] at pressures (n,) [Pa] that a fuel passes at constant entropy; as `throttled`."""
    return _along(fuel, temperature, pressures, 0.0)


def _along(fuel: Fuel, temperature: float, pressures: Floats, dissipated: float) -> Floats:
    """Solution of dT/dp = (alpha T - dissipated)/(rho c_p) by the midpoint rule."""

    def slope(p: float, t: float) -> float:
        rho, alpha = density_and_expansivity(fuel, p, t)
        return (alpha * t - dissipated) / (rho * heat_capacity(fuel, t))

    found = [temperature]
    for p, step in zip(pressures[:-1].tolist(), np.diff(pressures).tolist(), strict=True):
        half = found[-1] + 0.5 * step * slope(p, found[-1])
        found.append(found[-1] + step * slope(p + 0.5 * step, half))
    return np.array(found)
