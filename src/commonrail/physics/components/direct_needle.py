"""Needle of a direct-acting injector, and its motion together with the armature that pushes it open.

The armature travels its idle stroke alone, meets the needle, and lifts it until the armature is at its stop. The needle
is not tied to the armature: it may fly on, and the armature may leave it when both return. Four one-sided contacts act
between them and their seats: armature on its rest, on its stop and on the needle, needle on its seat.

The rail pressure presses the needle on its seat with p − p_SAC on the seat's area; both masses are rigid.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.components.contact import Contact, contact, mean_overlap
from commonrail.physics.components.plunger_needle import Motion, SeatContact
from commonrail.physics.law import Domain, Q, physics


class ArmatureParameters(NamedTuple):
    """Mass, travel, spring and contacts of the armature."""

    mass: Annotated[float, Q("kg", "mass of the armature", usual=(0.1e-3, 0.1))]
    idle_stroke: Annotated[
        float, Q("m", "travel of the armature until it meets the needle", Domain.NON_NEGATIVE, usual=(2e-6, 1e-3))
    ]
    lift: Annotated[float, Q("m", "travel from the needle to the stop", usual=(5e-6, 1e-3))]
    spring_preload: Annotated[
        float, Q("N", "force of the armature's spring at rest", Domain.NON_NEGATIVE, usual=(0.1, 300.0))
    ]
    spring_stiffness: Annotated[
        float, Q("N/m", "stiffness of the armature's spring", Domain.NON_NEGATIVE, 0.0, usual=(100.0, 5e5))
    ]
    damping: Annotated[float, Q("N s/m", "viscous damping of the armature", Domain.NON_NEGATIVE, 0.0)]
    contact_stiffness: Annotated[
        float, Q("N/m", "stiffness of rest, stop and needle contact", Domain.POSITIVE, 3e7, usual=(1e6, 1e10))
    ]
    contact_damping: Annotated[
        float, Q("s/m", "Hunt–Crossley factor of rest, stop and needle contact", Domain.NON_NEGATIVE, 0.5)
    ]


class ArmatureCoefficients(NamedTuple):
    """Inverse mass [1/kg], idle stroke and travel to the stop [m], spring, damper, contacts."""

    per_mass: float
    idle_stroke: float
    travel: float
    spring_preload: float
    spring_stiffness: float
    damping: float
    contact_stiffness: float
    contact_damping: float


@physics
def armature_coefficients(p: ArmatureParameters) -> ArmatureCoefficients:
    """Coefficients of the armature."""
    return ArmatureCoefficients(
        per_mass=1.0 / p.mass,
        idle_stroke=p.idle_stroke,
        travel=p.idle_stroke + p.lift,
        spring_preload=p.spring_preload,
        spring_stiffness=p.spring_stiffness,
        damping=p.damping,
        contact_stiffness=p.contact_stiffness,
        contact_damping=p.contact_damping,
    )


@physics
def armature_force(c: ArmatureCoefficients, position: float, magnetic_force: float) -> float:
    """Force of magnet and spring [N], positive when opening.

    `position`: travel from the rest [m]; `magnetic_force`: magnetic force [N], ≥ 0.
    """
    return magnetic_force - c.spring_preload - c.spring_stiffness * position


class Parameters(NamedTuple):
    """Mass, spring and damping of the needle."""

    mass: Annotated[float, Q("kg", "mass of the needle", usual=(0.05e-3, 0.05))]
    spring_preload: Annotated[float, Q("N", "force of the needle spring, needle closed", usual=(0.5, 500.0))]
    spring_stiffness: Annotated[
        float, Q("N/m", "stiffness of the needle spring", Domain.NON_NEGATIVE, 0.0, usual=(100.0, 1e6))
    ]
    damping: Annotated[float, Q("N s/m", "viscous damping of the needle", Domain.NON_NEGATIVE, 0.0)]


class Coefficients(NamedTuple):
    """Inverse mass [1/kg], spring and damper."""

    per_mass: float
    spring_preload: float
    spring_stiffness: float
    damping: float


class Pair(NamedTuple):
    """One number of the armature and one of the needle, positive when opening."""

    armature: float
    needle: float


class Masses(NamedTuple):
    """Coefficients of the two masses."""

    armature: ArmatureCoefficients
    needle: Coefficients


class Loads(NamedTuple):
    """Magnetic force on the armature and force of the pressures on the needle, both positive when opening [N]."""

    magnetic: float
    pressure: float


class State(NamedTuple):
    """Positions at t_n [m], velocities an eighth of a step before [m/s], and the loads one step before [N]."""

    z: Pair
    v: Pair
    load: Pair


class Contacts(NamedTuple):
    """Contacts of the armature with rest, stop and needle, and of the needle with its seat."""

    rest: Contact
    stop: Contact
    push: Contact
    seat: Contact


TOP, TIP = "z.armature", "z.needle"  # in `State`
Positions = Pair


@physics
def coefficients(p: Parameters) -> Coefficients:
    """Coefficients of the needle."""
    return Coefficients(1.0 / p.mass, p.spring_preload, p.spring_stiffness, p.damping)


@physics
def lifts(z: Pair) -> Motion:
    """Lifts of the armature, as the top, and of the needle, as shoulder and tip; also their velocities [m/s].

    `z`: positions [m].
    """
    return Motion(z.armature, z.needle, z.needle)


@physics
def contacts(m: Masses, seat: SeatContact, z: Pair, path: Pair) -> Contacts:
    """All four contacts; `z`: positions [m]; `path`: half the paths of the step [m], zero at an instant."""
    a = m.armature
    k, factor = a.contact_stiffness, a.contact_damping
    return Contacts(
        contact(mean_overlap(-z.armature, path.armature), k, factor),
        contact(mean_overlap(z.armature - a.travel, path.armature), k, factor),
        contact(mean_overlap(z.armature - a.idle_stroke - z.needle, path.armature - path.needle), k, factor),
        contact(mean_overlap(-z.needle, path.needle), seat.stiffness, seat.damping),
    )


@physics
def forces(m: Masses, z: Pair, load: Loads, at: Contacts) -> Pair:
    """Forces on both masses without damping [N], positive when opening; `z`: positions [m]."""
    spring = m.needle.spring_preload + m.needle.spring_stiffness * z.needle
    return Pair(
        armature_force(m.armature, z.armature, load.magnetic) + at.rest.force - at.stop.force - at.push.force,
        load.pressure - spring + at.push.force + at.seat.force,
    )


@physics
def advance(m: Masses, seat: SeatContact, s: State, load: Loads, dt: float) -> State:
    """State after four leapfrog steps, which resolve the contacts; the loads go on as they did over the step before."""
    now, quarter = Pair(load.magnetic, load.pressure), 0.25 * dt
    rise = Pair(0.25 * (now.armature - s.load.armature), 0.25 * (now.needle - s.load.needle))
    half = leap(m, seat, leap(m, seat, State(s.z, s.v, now), rise, quarter), rise, quarter)
    last = leap(m, seat, leap(m, seat, half, rise, quarter), rise, quarter)
    return State(last.z, last.v, now)


@physics
def leap(m: Masses, seat: SeatContact, s: State, rise: Pair, dt: float) -> State:
    """State after one leapfrog step, all dampers implicit at mid-step; `rise`: growth of the loads over it [N]."""
    at = contacts(m, seat, s.z, Pair(dt * s.v.armature, dt * s.v.needle))
    force = forces(m, s.z, Loads(s.load.armature, s.load.needle), at)
    a, n = dt * m.armature.per_mass, dt * m.needle.per_mass
    own_a = 0.5 * a * (m.armature.damping + at.rest.damping + at.stop.damping + at.push.damping)
    own_n = 0.5 * n * (m.needle.damping + at.seat.damping + at.push.damping)
    by_needle, by_armature = 0.5 * a * at.push.damping, 0.5 * n * at.push.damping
    gain_a = (1.0 - own_a) * s.v.armature + by_needle * s.v.needle + a * force.armature
    gain_n = (1.0 - own_n) * s.v.needle + by_armature * s.v.armature + n * force.needle
    per_determinant = 1.0 / ((1.0 + own_a) * (1.0 + own_n) - by_needle * by_armature)
    v = Pair(
        ((1.0 + own_n) * gain_a + by_needle * gain_n) * per_determinant,
        ((1.0 + own_a) * gain_n + by_armature * gain_a) * per_determinant,
    )
    load = Pair(s.load.armature + rise.armature, s.load.needle + rise.needle)
    return State(Pair(s.z.armature + dt * v.armature, s.z.needle + dt * v.needle), v, load)


@physics
def accelerations(m: Masses, seat: SeatContact, z: Pair, v: Pair, load: Loads) -> Pair:
    """Accelerations [m/s²], for a solver that has positions and velocities at one time.

    `z`: positions [m]; `v`: velocities [m/s].
    """
    at = contacts(m, seat, z, Pair(0.0, 0.0))
    force = forces(m, z, load, at)
    approach = at.push.damping * (v.armature - v.needle)
    held_a = (m.armature.damping + at.rest.damping + at.stop.damping) * v.armature + approach
    held_n = (m.needle.damping + at.seat.damping) * v.needle - approach
    return Pair(m.armature.per_mass * (force.armature - held_a), m.needle.per_mass * (force.needle - held_n))


@physics
def at_rest(m: Masses, seat: SeatContact, load: Loads) -> State:
    """Both masses at rest, armature on its rest and needle on its seat, in closed form.

    `m`: the two masses; the idle stroke keeps them apart; `load`: of the pressures; no magnetic force.
    """
    a, n = m.armature, m.needle
    held_a = a.spring_preload / (a.contact_stiffness + a.spring_stiffness)
    held_n = (n.spring_preload - load.pressure) / (seat.stiffness + n.spring_stiffness)
    return State(Pair(-held_a, -held_n), Pair(0.0, 0.0), Pair(load.magnetic, load.pressure))
