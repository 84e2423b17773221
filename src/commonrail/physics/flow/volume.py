"""A lumped volume, Eq. (3), kept in mass.

The state is the mass m; density is m/V and pressure follows from it, so dm/dt = Σ q conserves mass to
rounding and (K_f/V)(−dV/dt + Σ Q) of Eq. (3) is its consequence. Over one step the flows are taken
linear in the pressure, q(p) = q_n + Σ s (p − p_n) with Σ s = −S, and the geometry that of mid-step. The
pressure then relaxes as exp(−y), y = dt · S · (dp/dρ)/V; its mean departure from p_n over the step is

    δ = dt · dp/dt · φ2(y),   φ2(y) = (1/2 + y/6)/(1 + 2y/3 + y²/6)

a rational form of (1 − (1 − e^(−y))/y)/y: second order for y → 0, exact equilibrium for y → ∞ (L-stable).
Every flow's mean over the step is q_n ± s δ, and the mass changes by exactly their sum.
"""

from __future__ import annotations

from typing import NamedTuple

from commonrail.physics import fuel_kernel as fuel
from commonrail.physics.law import physics


@physics
def relaxation(y: float) -> float:
    """φ1(y) = (1 + y/6)/(1 + 2y/3 + y²/6) ≈ (1 − e^(−y))/y: change over a step, divided by dt times its first rate [1].

    `y`: step over relaxation time [1], ≥ 0.
    """
    return (1.0 + y * (1.0 / 6.0)) / (1.0 + y * (2.0 / 3.0 + y * (1.0 / 6.0)))


@physics
def mean_departure(net_flow: float, slope: float, stiffness: float, volume: float, growth: float, dt: float) -> float:
    """Mean over the step of p − p_n [Pa].

    `net_flow`: Σ q at the start of the step [kg/s], positive into the volume; `slope`: S = −∂(Σ q)/∂p ≥ 0 [kg/(s Pa)];
    `stiffness`: dp/dρ = K/ρ [Pa m³/kg]; `volume`: V in mid-step [m³], > 0; `growth`: ρ dV/dt [kg/s], subtracted from
    the net flow; `dt`: step [s].
    """
    spring = dt * stiffness  # V² times numerator and denominator of φ2: one division
    yv = spring * slope  # y V
    numerator = spring * (net_flow - growth) * (0.5 * volume + yv * (1.0 / 6.0))
    return numerator / (volume * volume + yv * (volume * (2.0 / 3.0) + yv * (1.0 / 6.0)))


# Fuel held by a lumped volume, Eq. (3): the mass is the state, pressure follows from mass/volume.


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

    `mass`: m [kg]; `per_volume`: 1/V [1/m³].
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
    """Contents of a volume at a given pressure; `pressure`: p [Pa], above the vapour pressure; `volume`: V [m³]."""
    return contents(f, fuel.density(f, pressure) * volume, 1.0 / volume)
