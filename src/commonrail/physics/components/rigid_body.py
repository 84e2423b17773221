"""Plunger and needle as one rigid mass: the variant that the paper compares with (its Ref. [8]).

Same drawing, same guides, spring, seat and stop as the chain of nine masses; no deformation.
"""

from __future__ import annotations

from typing import NamedTuple

from commonrail.physics.components.contact import velocity_gain
from commonrail.physics.components.plunger_needle import Coefficients, Loads, Motion, SeatContact, at_stop, on_seat
from commonrail.physics.law import physics


class State(NamedTuple):
    """Position at t_n [m] and velocity at t_n − dt/2 [m/s]."""

    z: float
    v: float


@physics
def force(c: Coefficients, z: float, load: Loads) -> float:
    """Sum of pressure and spring forces [N], positive when opening, without seat and stop; `z`: lift [m]."""
    return load.top + load.foot + load.head + load.shoulder + load.tip - c.guides.spring_stiffness * z


@physics
def advance(c: Coefficients, seat: SeatContact, s: State, load: Loads, dt: float) -> State:
    """State after one leapfrog step; `load`: pressure forces at t_n."""
    stop, rest = at_stop(c.guides, s.z), on_seat(seat, s.z, dt * s.v)
    per_mass = dt / c.total_mass
    impulse = per_mass * (force(c, s.z, load) + rest.force - stop.force)
    half = 0.5 * per_mass * (rest.damping + stop.damping)
    v = s.v + velocity_gain(s.v, impulse, half)
    return State(s.z + dt * v, v)


@physics
def accelerations(c: Coefficients, seat: SeatContact, z: float, v: float, load: Loads) -> float:
    """Acceleration with seat and stop [m/s²], for a solver that has z and v at one time.

    `z`: lift [m], positive when opening; `v`: velocity [m/s].
    """
    stop, rest = at_stop(c.guides, z), on_seat(seat, z, 0.0)
    resting = rest.force - stop.force - (rest.damping + stop.damping) * v
    return (force(c, z, load) + resting) / c.total_mass


TOP = TIP = "z"  # in `State`
Positions = float


@physics
def lifts(z: float) -> Motion:
    """Lifts at top, shoulder and tip: all equal. Also velocities [m/s], from the body's velocity; `z`: lift [m]."""
    return Motion(z, z, z)


@physics
def at_rest(c: Coefficients, seat: SeatContact, load: Loads) -> State:
    """Body at rest on its seat under static loads, in closed form.

    `c`, `seat`, `load`: as in `advance`; the loads press the needle into its seat.
    """
    return State(force(c, 0.0, load) / (seat.stiffness + c.guides.spring_stiffness), 0.0)
