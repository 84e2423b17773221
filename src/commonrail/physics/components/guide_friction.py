"""Friction of plunger and needle in their guides: F = −v (c_v + F_c/(|v| + v_0)), on mass 1 and on mass 7.

The viscous part models the oil film, the dry part lateral forces; v_0 rounds the dry part at standstill, so
that a needle at rest is not held. The rigid body carries both. The paper neglects it.

The virtual test bench rounds otherwise (`bench_friction`), and on any mass: on purpose. Its truth must be none that a
fitted model can reach, or the bench would not show how a calibration copes with a wrong model.
"""

from __future__ import annotations

import math

from commonrail.physics.components import plunger_needle, rigid_body
from commonrail.physics.components.plunger_needle import Coefficients, Guides, Loads, Nine, SeatContact
from commonrail.physics.law import physics

ROUNDED = 0.01  # v_0 [m/s]: half of the dry friction acts at this speed; 76 % of the bench's value


@physics
def bench_friction(dry: float, viscous: float, v: float) -> float:
    """Friction of the virtual test bench on one mass, against the motion [N]: F_c tanh(v/v_0) + c_v v.

    `dry`: F_c [N]; `viscous`: c_v [N s/m]; `v`: velocity [m/s].
    """
    return dry * math.tanh(v / ROUNDED) + viscous * v


@physics
def guide_damping(g: Guides, per_speed: float) -> float:
    """Damping coefficient of one guide c_v + F_c/(|v| + v_0) [N s/m]; `per_speed`: 1/(|v| + v_0) [s/m]."""
    return g.viscous + g.friction * per_speed


@physics
def speed_at_step(v: float, gain: float) -> float:
    """|v| + v_0 at t_n [m/s], extrapolated; `v`, `gain`: velocity at t_n − dt/2, and its gain in a step [m/s]."""
    return abs(v + 0.5 * gain) + ROUNDED


@physics
def advance_chain(
    c: Coefficients, seat: SeatContact, s: plunger_needle.State, load: Loads, dt: float
) -> plunger_needle.State:
    """State of the chain after one leapfrog step [m], [m/s], [m/s].

    Friction is implicit and never makes the step unstable: the damping coefficient of the speed at t_n times the mean
    of the velocities half a step before and after.
    """
    after, m = plunger_needle.advance(c, seat, s, load, dt), c.impulse
    half1 = 0.5 * m.i1 * guide_damping(c.guides, 1.0 / speed_at_step(s.v.i1, s.gain.i1))
    half7 = 0.5 * m.i7 * guide_damping(c.guides, 1.0 / speed_at_step(s.v.i7, s.gain.i7))
    stopped = 1.0 + 0.5 * m.i1 * plunger_needle.at_stop(c.guides, s.z.i1).damping
    gain1 = (stopped * after.gain.i1 - 2.0 * half1 * s.v.i1) / (stopped + half1)
    gain7 = (after.gain.i7 - 2.0 * half7 * s.v.i7) / (1.0 + half7)
    v1, v7 = s.v.i1 + gain1, s.v.i7 + gain7
    return plunger_needle.State(
        with_guided(after.z, s.z.i1 + dt * v1, s.z.i7 + dt * v7),
        with_guided(after.v, v1, v7),
        with_guided(after.gain, gain1, gain7),
    )


@physics
def with_guided(x: Nine, top: float, head: float) -> Nine:
    """Velocities of the chain [m/s] with the guided masses 1 and 7 replaced; used for positions too.

    `x`: velocities [m/s]; `top`, `head`: of mass 1 and of mass 7 [m/s].
    """
    return Nine(i1=top, i2=x.i2, i3=x.i3, i4=x.i4, i5=x.i5, i6=x.i6, i7=head, i8=x.i8, i9=x.i9)


@physics
def accelerate_chain(c: Coefficients, seat: SeatContact, z: Nine, v: Nine, load: Loads) -> Nine:
    """Right-hand side of Eq. (10) [m/s²] with seat, stop and friction, for a solver that has z and v at one time.

    `z`: positions [m]; `v`: velocities [m/s].
    """
    a = plunger_needle.accelerations(c, seat, z, v, load)
    top = guide_damping(c.guides, 1.0 / (abs(v.i1) + ROUNDED)) * v.i1
    head = guide_damping(c.guides, 1.0 / (abs(v.i7) + ROUNDED)) * v.i7
    return with_guided(a, a.i1 - c.per_mass.i1 * top, a.i7 - c.per_mass.i7 * head)


@physics
def advance_body(c: Coefficients, seat: SeatContact, s: rigid_body.State, load: Loads, dt: float) -> rigid_body.State:
    """State of the rigid body after one leapfrog step [m], [m/s], friction of both guides implicit.

    The body keeps no older velocity: the speed at t_n is the mean of those before the step and after a first one.
    """
    free = rigid_body.advance(c, seat, s, load, dt).v
    per_mass = dt / c.total_mass
    rest = plunger_needle.on_seat(seat, s.z, dt * s.v)
    contact_damping = plunger_needle.at_stop(c.guides, s.z).damping + rest.damping
    touching = 1.0 + 0.5 * per_mass * contact_damping
    first = _slow_down(c.guides, s.v, touching * free, touching, (per_mass, s.v))
    v = _slow_down(c.guides, s.v, touching * free, touching, (per_mass, 0.5 * (s.v + first)))
    return rigid_body.State(s.z + dt * v, v)


@physics
def _slow_down(g: Guides, v: float, free: float, touching: float, friction: tuple[float, float]) -> float:
    """Velocity after a step [m/s] in which both guides rub.

    `v`, `free`: velocity before the step, and after one without friction times `touching` [m/s]; `touching`: one plus
    what the contacts' damping takes in half a step [1]; `friction` (float, float): step over mass [s/kg], and velocity
    at which friction is taken [m/s].
    """
    per_mass, at = friction
    both = per_mass * guide_damping(g, 1.0 / (abs(at) + ROUNDED))
    return (free - both * v) / (touching + both)


@physics
def accelerate_body(c: Coefficients, seat: SeatContact, z: float, v: float, load: Loads) -> float:
    """Acceleration of the rigid body with seat, stop and friction of both guides [m/s²].

    `z`: lift [m]; `v`: velocity [m/s].
    """
    both = 2.0 * guide_damping(c.guides, 1.0 / (abs(v) + ROUNDED)) * v
    return rigid_body.accelerations(c, seat, z, v, load) - both / c.total_mass
