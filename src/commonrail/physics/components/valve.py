"""Electro-hydraulic valve: armature and shutter as one mass between seat and stop, and its flow section."""

from __future__ import annotations

from math import pi
from typing import Annotated, NamedTuple

from commonrail.physics.components.contact import contact, contact_over_step, velocity_gain
from commonrail.physics.elementary import sine
from commonrail.physics.flow import pipe_area
from commonrail.physics.law import Domain, Q, physics

_USUAL_DISC, _USUAL_FILM = (0.2e-3, 30e-3), (1e-6, 300e-6)  # of a seat to an armature; a step to air gap [m]


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
            "length of the seat's land, along which friction acts (0: none)",
            Domain.NON_NEGATIVE,
            0.0,
            usual=(1e-6, 1e-3),
        ),
    ]
    stop_disc: Annotated[
        float,
        Q("m", "diameter of the disc that squeezes fuel at the stop (0: none)", Domain.NON_NEGATIVE, 0.0, _USUAL_DISC),
    ]
    stop_film: Annotated[
        float, Q("m", "film under that disc with the valve at its stop", Domain.POSITIVE, 10e-6, usual=_USUAL_FILM)
    ]
    seat_disc: Annotated[
        float,
        Q("m", "diameter of the disc that squeezes fuel at the seat (0: none)", Domain.NON_NEGATIVE, 0.0, _USUAL_DISC),
    ]
    seat_film: Annotated[
        float, Q("m", "film under that disc with the valve on its seat", Domain.POSITIVE, 10e-6, usual=_USUAL_FILM)
    ]


class Film(NamedTuple):
    """Squeeze film: damping times its thickness cubed, 3π η d⁴/32 [N s m²], and its thickness at the end [m]."""

    cubed: float
    thickness: float


class Coefficients(NamedTuple):
    """Inverse mass [1/kg], lift [m], spring, damper, seat area [m²], c_d times gap area per lift [m], contact, films.

    `land` is 12 l/(π d sin³ θ) of the seat's land [1].
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
    land: float
    stop: Film
    seat: Film


class State(NamedTuple):
    """Lift [m] and velocity half a step before [m/s], both positive when opening."""

    lift: float
    velocity: float


TINY_GAP = 1e-9  # below this lift the resistance of the land stays finite; what flows there is nothing [m]
TYPICAL = State(1e-5, 1e-1)  # sizes for a solver's absolute tolerances


@physics
def film_of(disc: float, thickness: float, viscosity: float) -> Film:
    """Film [N s m²], [m] between a disc and a plane, Reynolds' equation: it resists by 3π η d⁴/(32 h³) per speed.

    (Hamrock, Schmid and Jacobson, Fundamentals of Fluid Film Lubrication, chapter 12.) A ring of mean diameter D and
    width w is a disc of d⁴ = 32/3 D w³.

    `disc`: d [m]; `thickness`: h at the end of the travel [m], > 0; `viscosity`: η of the fuel in it [Pa s].
    """
    return Film(3.0 * pi * viscosity * disc * disc * disc * disc / 32.0, thickness)


@physics
def no_film(c: Coefficients, s: State) -> float:
    """Damping coefficient of a valve that squeezes no fuel [N s/m]; same signature as `film_damping`."""
    return 0.0


@physics
def film_damping(c: Coefficients, s: State) -> float:
    """Damping coefficient of the film that is squeezed [N s/m]: at the stop while the valve opens, else at the seat.

    A film that is drawn apart breaks, and resists no longer.
    """
    film, distance = (c.stop, c.lift - s.lift) if s.velocity > 0.0 else (c.seat, s.lift)
    h = film.thickness + max(distance, 0.0)
    return film.cubed / (h * h * h)


@physics
def coefficients(p: Parameters, low_viscosity: float, seat_viscosity: float) -> Coefficients:
    """Coefficients of the valve.

    `low_viscosity`, `seat_viscosity`: η of the fuel about the armature and in the seat [Pa s].
    """
    return Coefficients(
        per_mass=1.0 / p.mass,
        lift=p.lift,
        spring_preload=p.spring_preload,
        spring_stiffness=p.spring_stiffness,
        damping=p.damping,
        seat_area=pipe_area(p.seat_diameter),
        gap_slope=p.seat_discharge * pi * p.seat_diameter * sine(p.seat_angle),
        contact_stiffness=p.contact_stiffness,
        contact_damping=p.contact_damping,
        land=12.0 * p.seat_land / (pi * p.seat_diameter * sine(p.seat_angle) ** 3),
        stop=film_of(p.stop_disc, p.stop_film, low_viscosity),
        seat=film_of(p.seat_disc, p.seat_film, seat_viscosity),
    )


@physics
def at_rest(c: Coefficients, seat_pressure: float) -> State:
    """Closed valve at rest, its lift below zero by what spring and pressure press into the seat.

    `seat_pressure`: excess over the return pressure on the seat area [Pa].
    """
    seat_force = c.spring_preload - c.seat_area * seat_pressure
    return State(-seat_force / (c.contact_stiffness + c.spring_stiffness), 0.0)


@physics
def air_gap(c: Coefficients, s: State) -> float:
    """Air gap that the armature leaves above the residual one [m]."""
    return c.lift - s.lift


@physics
def advance(c: Coefficients, s: State, magnetic_force: float, seat_pressure: float, film: float, dt: float) -> State:
    """State after one leapfrog step.

    `s`: lift at t_n, velocity half a step before; `magnetic_force`: magnetic force F_ev at t_n [N]; `seat_pressure`:
    excess over the return pressure on the seat area [Pa]; `film`: damping coefficient of `film_damping` [N s/m].
    """
    force, damping = forces_over_step(c, s, magnetic_force, seat_pressure, dt)
    per_mass = dt * c.per_mass
    velocity = s.velocity + velocity_gain(s.velocity, per_mass * force, 0.5 * per_mass * (damping + film))
    return State(s.lift + dt * velocity, velocity)


@physics
def rates(c: Coefficients, s: State, magnetic_force: float, seat_pressure: float, film: float) -> State:
    """Rates of lift and velocity [m/s], [m/s²], for a solver that has both at one time.

    `s`: lift and velocity at one time; `c`, `magnetic_force`, `seat_pressure`: as in `forces`; `film`: damping
    coefficient of `film_damping` [N s/m].
    """
    force, damping = forces(c, s.lift, magnetic_force, seat_pressure)
    return State(s.velocity, c.per_mass * (force - (damping + film) * s.velocity))


@physics
def forces(c: Coefficients, lift: float, magnetic_force: float, seat_pressure: float) -> tuple[float, float]:
    """Force [N], positive when opening, without the damping, and damping coefficient [N s/m].

    `lift`: lift [m], negative where it is pressed into its seat; `magnetic_force`: magnetic force F_ev [N];
    `seat_pressure`: excess over the return pressure on the seat area [Pa].
    """
    seat = contact(-lift, c.contact_stiffness, c.contact_damping)
    stop = contact(lift - c.lift, c.contact_stiffness, c.contact_damping)
    force = free_force(c, lift, magnetic_force, seat_pressure) + seat.force - stop.force
    return force, c.damping + seat.damping + stop.damping


@physics
def forces_over_step(
    c: Coefficients, s: State, magnetic_force: float, seat_pressure: float, dt: float
) -> tuple[float, float]:
    """Force [N] and damping coefficient [N s/m] over a leapfrog step: `forces` with the nearer contact averaged.

    `s`: lift at the start of the step, velocity half a step before; `c`, `magnetic_force`, `seat_pressure`: as in
    `forces`.
    """
    middle = 0.5 * c.lift
    side = s.lift - middle
    sign = 1.0 if side > 0.0 else -1.0  # to the stop, or to the seat
    free = free_force(c, s.lift, magnetic_force, seat_pressure)
    near = contact_over_step(
        abs(side) - middle, sign * s.velocity, sign * free, c.per_mass, (c.contact_stiffness, c.contact_damping), dt
    )
    return free - sign * near.force, c.damping + near.damping


@physics
def free_force(c: Coefficients, lift: float, magnetic_force: float, seat_pressure: float) -> float:
    """Force of magnet, spring and pressure [N], positive when opening.

    Arguments as in `forces`.
    """
    return magnetic_force - (c.spring_preload + c.spring_stiffness * lift) + c.seat_area * seat_pressure


@physics
def gap_cda2(c: Coefficients, lift: float) -> float:
    """(c_d A)² of the seat gap, for Eq. (4) [m⁴].

    `lift`: lift [m], small against the seat's diameter; shut at zero and below.
    """
    effective = c.gap_slope * max(lift, 0.0)
    return effective * effective


@physics
def land_resistance(c: Coefficients, lift: float, fluidity: float) -> float:
    """Pressure per mass flow through the laminar film on the seat's land, 12 ν l/(π d h³) [Pa s/kg].

    Reynolds' equation for a film whose thickness h = lift · sin θ is small against the seat's diameter d.

    `lift`: lift [m]; `fluidity`: 1/ν of the fuel in the film [s/m²].
    """
    z = max(lift, TINY_GAP)  # sin³ θ of h = z sin θ is in c.land
    return c.land / (fluidity * z * z * z)
