"""Flow through an orifice, Eq. (4), with a laminar limit and cavitation.

Eq. (4) has an infinite slope at Δp = 0. A viscous term, linear in the flow, is added to its
quadratic loss, Δp = ρ Q²/(2 c_d² A²) · (1 + Q_t/|Q|), which a short orifice really has: the two are
equal at the transition flow Q_t = Re_t ν A/D_h. Solved for the mass flow q = ρ Q:

    q = sgn(Δp) · ( sqrt(q_h² + 2 ρ (c_d A)² |Δp|) − q_h ),    q_h = ρ Q_t/2 = η Re_t (A/D_h)/2

At Re ≫ Re_t it is Eq. (4) less q_h. `drive` below is (c_d A)² Δp and `gain` its derivative with
respect to Δp, so that a cavitating orifice needs no law of its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from commonrail.compile import physics

__all__ = ["Flow", "Jet", "choked", "jet", "laminar_offset", "orifice", "series", "square"]


class Flow(NamedTuple):
    """Mass flow [kg/s] and its slope with respect to the driving pressure [kg/(s Pa)]."""

    mass_flow: float
    slope: float


@physics
def square(x: float) -> float:
    """x², infinite where it overflows: Python's own x**2 would raise."""
    return x * x


@physics
def laminar_offset(dynamic_viscosity: float, transition_reynolds: float, area_per_diameter: float) -> float:
    """Half the mass flow at which viscous and inertial loss are equal, q_h [kg/s].

    Parameters
    ----------
    dynamic_viscosity : float
        η = ρ ν at a reference pressure [Pa s].
    transition_reynolds : float
        Reynolds number Re_t at which the two losses are equal [1].
    area_per_diameter : float
        A/D_h summed over the holes [m]: N π d/4 for round holes, π d/2 for a ring gap of diameter d.
    """
    return 0.5 * dynamic_viscosity * transition_reynolds * area_per_diameter


class Jet(NamedTuple):
    """Mass flow [kg/s], and the root [kg/s] whose inverse makes its slope: ρ · gain/root."""

    mass_flow: float
    root: float


@physics
def jet(drive: float, density: float, offset: float) -> Jet:
    """Mass flow through an orifice, Eq. (4) with a laminar limit.

    Parameters
    ----------
    drive : float
        (c_d A)² Δp [m⁴ Pa]; its sign is that of the flow.
    density : float
        ρ of the upstream fluid [kg/m³], > 0.
    offset : float
        q_h of `laminar_offset` [kg/s], > 0.
    """
    root = math.sqrt(offset * offset + 2.0 * density * abs(drive))
    magnitude = root - offset
    return Jet(magnitude if drive >= 0.0 else -magnitude, root)


@physics
def orifice(drive: float, gain: float, density: float, offset: float) -> Flow:
    """Mass flow through an orifice as of `jet`, with its slope.

    Parameters
    ----------
    drive : float
        (c_d A)² Δp [m⁴ Pa]; its sign is that of the flow.
    gain : float
        d(drive)/dp [m⁴]: (c_d A)², or zero where the flow does not depend on that pressure.
    density : float
        ρ of the upstream fluid [kg/m³], > 0.
    offset : float
        q_h of `laminar_offset` [kg/s], > 0.
    """
    flow = jet(drive, density, offset)
    return Flow(flow.mass_flow, density * gain / flow.root)


@physics
def choked(drive: float, gain: float, choked_drive: float, choked_gain: float) -> tuple[float, float]:
    """Drive [m⁴ Pa] and gain [m⁴] of an orifice, limited by cavitation in its contraction.

    A cavitating orifice passes q = C_c A sqrt(2 ρ (p₁ − p_v)) whatever the pressure behind it
    (Nurick 1976, doi:10.1115/1.3448452). Reverse flow (negative drive) is not limited.

    Parameters
    ----------
    drive : float
        (c_d A)² Δp without cavitation [m⁴ Pa].
    gain : float
        Its derivative in the pressure of interest [m⁴].
    choked_drive : float
        (C_c A)² (p₁ − p_v) [m⁴ Pa].
    choked_gain : float
        Its derivative in the same pressure [m⁴].
    """
    limited = drive > choked_drive
    return (choked_drive if limited else drive), (choked_gain if limited else gain)


@physics
def series(first: float, second: float) -> float:
    """(c_d A)² of two orifices one behind the other [m⁴]; zero when either is shut.

    Parameters
    ----------
    first, second : float
        (c_d A)² of each [m⁴], ≥ 0, not both zero.
    """
    return first * second / (first + second)
