"""Fuel held by a lumped volume, Eq. (3): the mass is the state, pressure follows from mass/volume."""

from __future__ import annotations

from typing import NamedTuple

from commonrail.compile import physics
from commonrail.fuel import kernel as fuel


class Contents(NamedTuple):
    """Mass [kg], density [kg/m³], pressure [Pa] and dp/dρ [Pa m³/kg] of the fuel in a volume."""

    mass: float
    density: float
    pressure: float
    stiffness: float


@physics
def contents(f: fuel.FuelCoefficients, mass: float, per_volume: float) -> Contents:
    """Contents of a volume that holds a given mass.

    Below the vapour pressure the volume holds vapour: the pressure stays there, dp/dρ is zero, and the
    missing mass is kept in the state until fuel has filled the cavity.

    Parameters
    ----------
    f : FuelCoefficients
        Fuel at one temperature.
    mass : float
        m [kg].
    per_volume : float
        1/V [1/m³].
    """
    density = mass * per_volume
    liquid = fuel.pressure_and_stiffness(f, density)
    cavity = liquid[0] < f.vapour_pressure
    return Contents(
        mass,
        density,
        f.vapour_pressure if cavity else liquid[0],
        0.0 if cavity else liquid[1],
    )


@physics
def filled(f: fuel.FuelCoefficients, pressure: float, volume: float) -> Contents:
    """Contents of a volume at a given pressure.

    Parameters
    ----------
    f : FuelCoefficients
        Fuel at one temperature.
    pressure : float
        p [Pa], above the vapour pressure.
    volume : float
        V [m³].
    """
    return contents(f, fuel.density(f, pressure) * volume, 1.0 / volume)
