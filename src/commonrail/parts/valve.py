"""Electro-hydraulic valve: armature and shutter as one mass between seat and stop, and its flow section."""

from __future__ import annotations

import math
from math import pi
from typing import NamedTuple

from commonrail.compile import physics
from commonrail.flow.contact import contact, contact_over_step, next_velocity
from commonrail.flow.wave import pipe_area
from commonrail.parts.furniture import Annotated, Domain, Q


class Parameters(NamedTuple):
    """Moving mass, springs and seat of the valve."""

    mass: Annotated[float, Q("kg", "mass of armature and shutter", usual=(0.1e-3, 0.1))]
    lift: Annotated[float, Q("m", "lift from seat to stop", usual=(5e-6, 1e-3))]
    spring_preload: Annotated[float, Q("N", "force of the valve spring, valve closed", usual=(1.0, 1e3))]
    spring_stiffness: Annotated[
        float, Q("N/m", "stiffness of the valve spring", Domain.NON_NEGATIVE, usual=(500.0, 2e6))
    ]
    damping: Annotated[float, Q("N s/m", "viscous damping of the armature", Domain.NON_NEGATIVE, 0.0)]
    seat_diameter: Annotated[float, Q("m", "diameter of the valve seat", usual=(0.1e-3, 10e-3))]
    seat_angle: Annotated[
        float, Q("rad", "angle between seat wall and axis", Domain.POSITIVE, pi / 4, usual=(0.17, 1.57))
    ]
    seat_discharge: Annotated[float, Q("1", "discharge coefficient of the valve seat", Domain.COEFFICIENT, 0.8)]
    contact_stiffness: Annotated[float, Q("N/m", "stiffness of seat and stop", Domain.POSITIVE, 4e7, usual=(1e6, 1e10))]
    contact_damping: Annotated[float, Q("s/m", "Hunt–Crossley factor of seat and stop", Domain.NON_NEGATIVE, 1.0)]
    seat_land: Annotated[
        float,
        Q(
            "m",
            "length of the seat's thin gap along the flow, in which friction acts (0: none)",
            Domain.NON_NEGATIVE,
            0.0,
            usual=(1e-6, 1e-3),
        ),
    ]


class Coefficients(NamedTuple):
    """Inverse mass [1/kg], lift [m], spring and damper, seat area [m²], c_d times gap area per lift [m], contact, film.

    `gap_per_lift` is the height of the gap over the lift [1], and `film` the resistance of the seat's land times the
    cube of that height, 12 η l/(π d) [Pa s].
    """

    per_mass: float
    lift: float
    spring_preload: float
    spring_stiffness: float
    damping: float
    seat_area: float
    gap_slope: float
    contact_stiffness: float
    contact_damping: float
    gap_per_lift: float
    film: float


class State(NamedTuple):
    """Lift [m] and velocity half a step before [m/s], both positive when opening."""

    lift: float
    velocity: float


# Height of a gap [m] and ρ Δp [Pa kg/m³] below which both count as these values, rather than 0/0: chosen, far below all
# that flows.
TINY_GAP, TINY_DROP = 1e-9, 1.0
TYPICAL = State(1e-5, 1e-1)  # sizes for a solver's absolute tolerances


@physics
def coefficients(p: Parameters, viscosity: float) -> Coefficients:
    """Coefficients of the valve.

    Parameters
    ----------
    p : Parameters
    viscosity : float
        η in the seat's gap [Pa s].
    """
    height = math.sin(p.seat_angle)
    return Coefficients(
        per_mass=1.0 / p.mass,
        lift=p.lift,
        spring_preload=p.spring_preload,
        spring_stiffness=p.spring_stiffness,
        damping=p.damping,
        seat_area=pipe_area(p.seat_diameter),
        gap_slope=p.seat_discharge * pi * p.seat_diameter * height,
        contact_stiffness=p.contact_stiffness,
        contact_damping=p.contact_damping,
        gap_per_lift=height,
        film=12.0 * viscosity * p.seat_land / (pi * p.seat_diameter),
    )


@physics
def at_rest(c: Coefficients, seat_pressure: float) -> State:
    """Closed valve at rest, its lift below zero by what spring and pressure press into the seat.

    Parameters
    ----------
    c : Coefficients
        Of this valve.
    seat_pressure : float
        Excess over the return pressure on the seat area [Pa].
    """
    held = c.spring_preload - c.seat_area * seat_pressure
    return State(-held / (c.contact_stiffness + c.spring_stiffness), 0.0)


@physics
def air_gap(c: Coefficients, s: State) -> float:
    """Air gap that the armature leaves above the residual one [m].

    Parameters
    ----------
    c : Coefficients
        Of this valve.
    s : State
        Lift and velocity.
    """
    return c.lift - s.lift


@physics
def advance(c: Coefficients, s: State, pull: float, seat_pressure: float, dt: float) -> State:
    """State after one leapfrog step.

    Parameters
    ----------
    c : Coefficients
        Of this valve.
    s : State
        Lift at t_n, velocity half a step before.
    pull : float
        Magnetic force F_ev at t_n [N].
    seat_pressure : float
        Excess over the return pressure on the seat area [Pa].
    dt : float
        Step [s].
    """
    force, damping = forces_over_step(c, s, pull, seat_pressure, dt)
    per_mass = dt * c.per_mass
    half = 0.5 * per_mass * damping
    velocity = next_velocity(s.velocity, per_mass * force, half, 1.0 / (1.0 + half))
    return State(s.lift + dt * velocity, velocity)


@physics
def rates(c: Coefficients, s: State, pull: float, seat_pressure: float) -> State:
    """Rates of lift and velocity [m/s], [m/s²], for a solver that has both at one time.

    Parameters
    ----------
    c, pull, seat_pressure
        As in `forces`.
    s : State
        Lift and velocity at one time.
    """
    force, damping = forces(c, s.lift, pull, seat_pressure)
    return State(s.velocity, c.per_mass * (force - damping * s.velocity))


@physics
def forces(c: Coefficients, lift: float, pull: float, seat_pressure: float) -> tuple[float, float]:
    """Force [N], positive when opening, without the damping, and damping coefficient [N s/m].

    Parameters
    ----------
    c : Coefficients
        Of this valve.
    lift : float
        Lift [m], negative where it is pressed into its seat.
    pull : float
        Magnetic force F_ev [N].
    seat_pressure : float
        Excess over the return pressure on the seat area [Pa].
    """
    seat = contact(-lift, c.contact_stiffness, c.contact_damping)
    stop = contact(lift - c.lift, c.contact_stiffness, c.contact_damping)
    force = free_force(c, lift, pull, seat_pressure) + seat.force - stop.force
    return force, c.damping + seat.damping + stop.damping


@physics
def forces_over_step(c: Coefficients, s: State, pull: float, seat_pressure: float, dt: float) -> tuple[float, float]:
    """Force [N] and damping coefficient [N s/m] over a leapfrog step: `forces` with the nearer contact averaged.

    Parameters
    ----------
    c, pull, seat_pressure
        As in `forces`.
    s : State
        Lift at the start of the step, velocity half a step before.
    dt : float
        Step [s].
    """
    middle = 0.5 * c.lift
    side = s.lift - middle
    sign = 1.0 if side > 0.0 else -1.0  # to the stop, or to the seat
    free = free_force(c, s.lift, pull, seat_pressure)
    near = contact_over_step(
        abs(side) - middle, sign * s.velocity, sign * free, c.per_mass, (c.contact_stiffness, c.contact_damping), dt
    )
    return free - sign * near.force, c.damping + near.damping


@physics
def free_force(c: Coefficients, lift: float, pull: float, seat_pressure: float) -> float:
    """Force of magnet, spring and pressure [N], positive when opening.

    Parameters
    ----------
    c, lift, pull, seat_pressure
        As in `forces`.
    """
    return pull - (c.spring_preload + c.spring_stiffness * lift) + c.seat_area * seat_pressure


@physics
def gap_drive(c: Coefficients, lift: float, hole: float, head: float) -> float:
    """(c_d A)² of the seat gap, for Eq. (4) [m⁴].

    Parameters
    ----------
    c : Coefficients
        Of this valve.
    lift : float
        Lift [m], small against the seat's diameter; shut at zero and below.
    hole, head : float
        As in `land_gap_drive`; without friction in the gap they do not matter.
    """
    effective = c.gap_slope * max(lift, 0.0)
    return effective * effective


@physics
def land_gap_drive(c: Coefficients, lift: float, hole: float, head: float) -> float:
    """(c_d A)² of the seat gap [m⁴], with the friction of the film on its land.

    The film takes R q/ρ, R = 12 η l/(π d h³) (flow between parallel plates), in series with the orifices, q²/(2 ρ g).
    Their sum is the whole drop Δp, so that q = 2 ρ Δp/(R + sqrt(R² + 2 ρ Δp/g)) with 1/g = 1/g_A + 1/g_s, and the
    gap acts like an orifice of 1/(1/g_s + 2 R/q). All is multiplied by powers of h, which may be zero.

    Parameters
    ----------
    c : Coefficients
        Of this valve.
    lift : float
        Lift [m], small against the seat's diameter; shut at zero and below.
    hole : float
        (c_d A)² of the A-hole in front of it [m⁴].
    head : float
        ρ Δp over A-hole and seat [Pa kg/m³].
    """
    gap = gap_drive(c, lift, hole, head)
    height = max(c.gap_per_lift * lift, TINY_GAP)
    square, drop = height * height, max(abs(head), TINY_DROP)
    section = (c.gap_slope / c.gap_per_lift) ** 2  # (c_d A)² of the gap over h² [m²]
    root = math.sqrt(c.film * c.film + 2.0 * drop * square * square * (1.0 / section + square / hole))
    return gap / (1.0 + section * c.film * (c.film + root) / (drop * square * square))
