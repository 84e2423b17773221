"""Flow through an orifice, Eq. (4), with a laminar limit and cavitation.

Eq. (4) has an infinite slope at Δp = 0. A viscous term, linear in the flow, is added to its
quadratic loss, Δp = ρ Q²/(2 c_d² A²) · (1 + Q_t/|Q|), which a short orifice really has: the two are
equal at the transition flow Q_t = Re_t ν A/D_h. Solved for the mass flow q = ρ Q:

    q = sgn(Δp) · ( sqrt(q_h² + 2 ρ (c_d A)² |Δp|) − q_h ),    q_h = ρ Q_t/2 = η Re_t (A/D_h)/2

At Re ≫ Re_t it is Eq. (4) less q_h. What drives the flow is a `Restriction`: `cda2_dp` = (c_d A)² Δp and
`cda2` = (c_d A)², its derivative with respect to a pressure, so that a cavitating orifice needs no law of its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from commonrail.physics.law import physics, reciprocals


class Restriction(NamedTuple):
    """(c_d A)² Δp [m⁴ Pa], whose sign is that of the flow, and its derivative in a pressure, (c_d A)² or zero [m⁴]."""

    cda2_dp: float
    cda2: float


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

    `dynamic_viscosity`: η = ρ ν at a reference pressure [Pa s]; `transition_reynolds`: Reynolds number Re_t at which
    the two losses are equal [1]; `area_per_diameter`: A/D_h summed over the holes [m]: N π d/4 for round holes, π d/2
    for a ring gap of diameter d.
    """
    return 0.5 * dynamic_viscosity * transition_reynolds * area_per_diameter


class Jet(NamedTuple):
    """Mass flow [kg/s], and the root [kg/s] whose inverse makes its slope: ρ · (c_d A)²/root."""

    mass_flow: float
    root: float


@physics
def jet(cda2_dp: float, density: float, offset: float) -> Jet:
    """Mass flow through an orifice, Eq. (4) with a laminar limit.

    `cda2_dp`: (c_d A)² Δp [m⁴ Pa]; its sign is that of the flow; `density`: ρ of the upstream fluid [kg/m³], > 0;
    `offset`: q_h of `laminar_offset` [kg/s], > 0.
    """
    root = math.sqrt(offset * offset + 2.0 * density * abs(cda2_dp))
    magnitude = root - offset
    return Jet(magnitude if cda2_dp >= 0.0 else -magnitude, root)


@physics
def orifice(through: Restriction, density: float, offset: float) -> Flow:
    """Mass flow through an orifice as of `jet`, with its slope.

    `through`: (c_d A)² Δp and its derivative; `density`: ρ of the upstream fluid [kg/m³], > 0; `offset`: q_h of
    `laminar_offset` [kg/s], > 0.
    """
    flow = jet(through.cda2_dp, density, offset)
    return Flow(flow.mass_flow, density * through.cda2 / flow.root)


@physics
def orifice_pair(
    first: Restriction,
    second: Restriction,
    density: tuple[float, float],
    offset: tuple[float, float],
) -> tuple[Flow, Flow]:
    """Mass flows [kg/s] and slopes [kg/(s Pa)] of two orifices as of `orifice`, with one division.

    `first`, `second`: (c_d A)² Δp of each and its derivative; `density` (float, float): ρ of the fluid upstream of the
    first [kg/m³] and of the second [kg/m³], > 0; `offset` (float, float): q_h of the first [kg/s] and of the second
    [kg/s], > 0.
    """
    one, two = jet(first.cda2_dp, density[0], offset[0]), jet(second.cda2_dp, density[1], offset[1])
    per_one, per_two = reciprocals(one.root, two.root)
    return (
        Flow(one.mass_flow, density[0] * first.cda2 * per_one),
        Flow(two.mass_flow, density[1] * second.cda2 * per_two),
    )


@physics
def choked(free: Restriction, cavitating: Restriction) -> Restriction:
    """Restriction of an orifice, limited by cavitation in its contraction.

    A cavitating orifice passes q = C_c A sqrt(2 ρ (p₁ − p_v)) whatever the pressure behind it
    (Nurick 1976, doi:10.1115/1.3448452). Reverse flow is not limited.

    `free`: (c_d A)² Δp without cavitation, and its derivative in the pressure of interest; `cavitating`: (C_c A)² (p₁ −
    p_v), and its derivative in the same pressure.
    """
    limited = free.cda2_dp > cavitating.cda2_dp
    return Restriction(cavitating.cda2_dp if limited else free.cda2_dp, cavitating.cda2 if limited else free.cda2)


@physics
def series(first: float, second: float) -> float:
    """(c_d A)² of two orifices one behind the other [m⁴]; zero when either is shut.

    `first`, `second`: (c_d A)² of each [m⁴], ≥ 0, not both zero.
    """
    return first * second / (first + second)
