"""Laws of flow: orifice, Eq. (4); guide, Eq. (5); pipe, Eq. (6); and the lumped volume between them, Eq. (3)."""

from __future__ import annotations

import math
from math import pi
from typing import NamedTuple

from commonrail.physics import fuel_kernel as fuel
from commonrail.physics.law import physics

# Flow through an orifice, Eq. (4), with a laminar limit and cavitation.
#
# Eq. (4) has an infinite slope at Δp = 0. A viscous term, linear in the flow, is added to its
# quadratic loss, Δp = ρ Q²/(2 c_d² A²) · (1 + Q_t/|Q|), which a short orifice really has: the two are
# equal at the transition flow Q_t = Re_t ν A/D_h. Solved for the mass flow q = ρ Q:
#
#     q = sgn(Δp) · ( sqrt(q_h² + 2 ρ (c_d A)² |Δp|) − q_h ),    q_h = ρ Q_t/2 = η Re_t (A/D_h)/2
#
# At Re ≫ Re_t it is Eq. (4) less q_h. What drives the flow is a `Restriction`: `cda2_dp` = (c_d A)² Δp and
# `cda2` = (c_d A)², its derivative with respect to a pressure, so that a cavitating orifice needs no law of its own.


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
    """Mass flow through an orifice, as `jet`, with its slope.

    `through`: (c_d A)² Δp and its derivative; `density`: ρ of the upstream fluid [kg/m³], > 0; `offset`: q_h of
    `laminar_offset` [kg/s], > 0.
    """
    flow = jet(through.cda2_dp, density, offset)
    return Flow(flow.mass_flow, density * through.cda2 / flow.root)


@physics
def limit_by_cavitation(free: Restriction, cavitating: Restriction) -> Restriction:
    """Restriction of an orifice, limited by cavitation in its contraction.

    A cavitating orifice passes q = C_c A sqrt(2 ρ (p₁ − p_v)) whatever its downstream pressure
    (Nurick 1976, doi:10.1115/1.3448452). Reverse flow is not limited.

    `free`: (c_d A)² Δp without cavitation, and its derivative in the pressure of interest; `cavitating`: (C_c A)² (p₁ −
    p_v), and its derivative in the same pressure.
    """
    limited = free.cda2_dp > cavitating.cda2_dp
    return Restriction(cavitating.cda2_dp if limited else free.cda2_dp, cavitating.cda2 if limited else free.cda2)


@physics
def series(first: float, second: float) -> float:
    """(c_d A)² of two orifices in series [m⁴]; zero when either is shut.

    `first`, `second`: (c_d A)² of each [m⁴], ≥ 0, not both zero.
    """
    return first * second / (first + second)


# Leakage through the ring gap of a guide, Eq. (5).
#
# Body and rod of a guide give way to the pressure in their gap, in proportion to it: g(p) = g₀ + C p. By Lamé's
# equations of a thick-walled cylinder (Timoshenko and Goodier, Theory of Elasticity, section 28) and of a rod pressed
# from its sides, both of one material and without an axial load,
#
#     C = d/(E (1 − d²/D²))
#
# with d of the guide, D of the body's outside and Young's modulus E. The flow along the gap (Reynolds' equation),
# q = −ρ π d g(p)³/(12 η(p)) dp/dx, integrates over the length to q l = π d/12 ∫ g(p)³/ν(p) dp between the pressures at
# its ends. Eq. (5) is its midpoint rule, gap and viscosity at the mean pressure. g³/ν is nearly linear in p.


class Guide(NamedTuple):
    """Conductance of Eq. (5) without pressure [m³], and growth of the gap by the pressure in it, C/g₀ [1/Pa]."""

    conductance: float
    growth: float


@physics
def gap_conductance(diameter: float, gap: float, length: float, eccentricity: float) -> float:
    """π d g³ (1 + 3/2 ε²)/(12 l), the geometry of Eq. (5) [m³]: thin ring gap, laminar, fully developed flow.

    The paper's is concentric, ε = 0; a rod that lies at the wall of its guide leaks 2.5 times as much
    (Piercy, Hooper and Winny 1933, Philosophical Magazine 15, 647, in the limit of a thin gap).

    `diameter`: diameter d of the guide [m]; `gap`: mean radial gap g [m], ≥ 0, small against d; `length`: length l of
    the guide [m], > 0; `eccentricity`: distance of the axes over the gap, ε [1], 0 to 1, the same at all pressures.
    """
    off_centre = 1.0 + 1.5 * eccentricity * eccentricity
    return pi * diameter * gap * gap * gap * off_centre / (12.0 * length)


@physics
def guide_of(diameter: float, gap: float, length: float, eccentricity: float, widening: float) -> Guide:
    """Guide from its drawing, as conductance [m³] and growth [1/Pa]; one without a gap stays tight.

    `diameter`, `gap`, `length`: d, g₀ without pressure and l [m]; `eccentricity`: ε [1]; `widening`: C [m/Pa], ≥ 0.
    """
    growth = widening / gap if gap > 0.0 else 0.0
    return Guide(gap_conductance(diameter, gap, length, eccentricity), growth)


@physics
def conductance_growth(growth: float, pressure: float) -> float:
    """(g/g₀)³ of a gap that the pressure in it has widened, g = g₀ (1 + p C/g₀) [1].

    `growth`: C/g₀ [1/Pa]; `pressure`: mean pressure in the gap [Pa].
    """
    ratio = 1.0 + growth * pressure
    return ratio * ratio * ratio


@physics
def leakage_slope(conductance: float, fluidity: float) -> float:
    """Mass flow per pressure difference [kg/(s Pa)].

    Eq. (5) times the density: ρ π d g³/(12 η l) = conductance/ν, since η = ρ ν.

    `conductance`: π d g³/(12 l) [m³]; `fluidity`: 1/ν at the gap's mean pressure [s/m²].
    """
    return conductance * fluidity


# Pressure waves in a pipe, Eq. (6), by characteristics.
#
# With a and ρ constant along the pipe, p ± (a/A) q is carried unchanged along dx = ±a dt but for
# friction. A pipe is then two delay lines of L/a: what leaves one end arrives at the other. Friction,
# ∫ ρ f u|u|/(2D) dx, is integrated by Simpson's rule in `feed_pipe`: 1/6 where a wave leaves, 4/6 in mid-pipe, 1/6
# where it arrives.


@physics
def pipe_area(diameter: float) -> float:
    """Cross-section A of a round bore [m²]; `diameter`: D [m]."""
    return 0.25 * pi * diameter * diameter


@physics
def impedance(sound_speed: float, area: float) -> float:
    """Z = a/A, pressure per mass flow of a travelling wave [Pa s/kg] (Joukowsky: Δp = ρ a Δu).

    `sound_speed`: a [m/s]; `area`: A [m²], > 0.
    """
    return sound_speed / area


@physics
def friction_resistance(friction_factor: float, length: float, diameter: float, density: float) -> float:
    """f L/(2 D ρ A²), pressure loss of the whole pipe per q|q| in Eq. (6) [Pa s²/kg²].

    `friction_factor`: Darcy's f [1], ≥ 0, constant; `length`, `diameter`: L and D of the pipe [m]; `density`: ρ
    [kg/m³], constant along the pipe.
    """
    area = pipe_area(diameter)
    return friction_factor * length / (2.0 * diameter * density * area * area)


# A lumped volume, Eq. (3), kept in mass.
#
# The state is the mass m; density is m/V and pressure follows from it, so dm/dt = Σ q conserves mass to
# rounding and (K_f/V)(−dV/dt + Σ Q) of Eq. (3) is its consequence. Over one step the flows are taken
# linear in the pressure, q(p) = q_n + Σ s (p − p_n) with Σ s = −S, with the geometry of mid-step. The
# pressure then relaxes as exp(−y), y = dt · S · (dp/dρ)/V; its mean departure from p_n over the step is
#
#     δ = dt · dp/dt · φ2(y),   φ2(y) = (3 + y)/(6 + 4y + y²)
#
# a rational form of (1 − (1 − e^(−y))/y)/y: second order for y → 0, exact equilibrium for y → ∞ (L-stable).
# Every flow's mean over the step is q_n ± s δ, and the mass changes by exactly their sum.


@physics
def mean_departure(net_flow: float, slope: float, stiffness: float, volume: float, growth: float, dt: float) -> float:
    """Mean over the step of p − p_n [Pa].

    `net_flow`: Σ q at the start of the step [kg/s], positive into the volume; `slope`: S = −∂(Σ q)/∂p ≥ 0 [kg/(s Pa)];
    `stiffness`: dp/dρ = K/ρ [Pa m³/kg]; `volume`: V in mid-step [m³], > 0; `growth`: ρ ΔV of the step [kg], which the
    growing volume takes.
    """
    yv = dt * stiffness * slope  # y V
    gain = stiffness * (dt * net_flow - growth)  # dt · dp/dt V
    return gain * (3.0 * volume + yv) / (6.0 * volume * volume + yv * (4.0 * volume + yv))  # V² φ2: one division


# Fuel held by a lumped volume, Eq. (3): the mass is the state, pressure follows from mass/volume.


class Contents(NamedTuple):
    """Mass [kg], density [kg/m³], pressure [Pa] and dp/dρ [Pa m³/kg] of the fuel in a volume."""

    mass: float
    density: float
    pressure: float
    stiffness: float


@physics
def contents(f: fuel.FuelCoefficients, mass: float, volume: float) -> Contents:
    """Contents of a volume that holds a given mass.

    Below the vapour pressure the volume holds vapour: the pressure stays there, dp/dρ is zero, and the
    missing mass is kept in the state until fuel has filled the cavity.

    `mass`: m [kg]; `volume`: V [m³], > 0.
    """
    density = mass / volume
    liquid = fuel.pressure_and_stiffness(f, density)
    cavity = liquid[0] < f.vapour_pressure
    return Contents(
        mass,
        density,
        f.vapour_pressure if cavity else liquid[0],
        0.0 if cavity else liquid[1],
    )


@physics
def contents_at(f: fuel.FuelCoefficients, pressure: float, volume: float) -> Contents:
    """Contents of a volume at a given pressure; `pressure`: p [Pa], above the vapour pressure; `volume`: V [m³]."""
    return contents(f, fuel.density(f, pressure) * volume, volume)
