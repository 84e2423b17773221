"""Return line: the control chamber's link to the low-pressure circuit, by characteristics, Eq. (6).

The valve's outflow raises the pressure at its outlet by Z q; the wave runs to the tank, which holds
the return pressure, and comes back inverted after 2 L/a. A line of length zero is the tank itself.

Where the outlet would fall below the vapour pressure, a cavity opens there (discrete vapour cavity model; Bergant,
Simpson and Tijsseling 2006, doi:10.1016/j.jfluidstructs.2005.08.008). It stays at p_v, the line's flow follows from
p_v and the arriving wave alone, and the cavity takes up the difference to the valve's flow, dm/dt = q_line − q, with
m the mass of liquid that is missing. Over one step, with mean flows,

    p' = back + Z (q − m/dt),   p = max(p', p_v),   q_line = (p − back)/Z,   m = (p − p') dt/Z

which needs no switch: p' is the pressure that fills the cavity within the step, and what it lacks to p_v is left open.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.flow import impedance, pipe_area
from commonrail.physics.law import Domain, Q, physics


class Parameters(NamedTuple):
    """Drawing of the return line."""

    length: Annotated[
        float, Q("m", "length of the return line (0: none)", Domain.NON_NEGATIVE, 0.0, usual=(0.01, 20.0))
    ]
    diameter: Annotated[float, Q("m", "bore of the return line", Domain.POSITIVE, 4e-3, usual=(0.5e-3, 30e-3))]


class Coefficients(NamedTuple):
    """Coefficients of the line; all are zero without one."""

    impedance: float  # Z [Pa s/kg]
    per_cavity: float  # Z/dt, pressure that fills a cavity within a step, per missing mass [Pa/kg]
    per_pressure: float  # its inverse [kg/Pa]
    round_trip: float  # travel time of a wave to the tank and back [s]


class State(NamedTuple):
    """Pressure downstream of the valve over the last step [Pa], and liquid missing in a cavity there [kg]."""

    pressure: float
    cavity: float


@physics
def coefficients(p: Parameters, sound_speed: float, dt: float) -> Coefficients:
    """Coefficients of the line, Eq. (6) without friction; `sound_speed`: a at the return pressure [m/s]."""
    z = impedance(sound_speed, pipe_area(p.diameter)) if p.length > 0.0 else 0.0
    return Coefficients(z, z / dt, dt / z if p.length > 0.0 else 0.0, 2.0 * p.length / sound_speed)


@physics
def without_flow(c: Coefficients, s: State, back: float) -> float:
    """Pressure p' downstream of a valve without flow [Pa]; `back`: wave that arrives [Pa]."""
    return back - c.per_cavity * s.cavity


@physics
def advance(c: Coefficients, without: float, vapour: float, flow: float) -> State:
    """State after a step.

    `without`: p' of `without_flow` [Pa]; `vapour`: p_v [Pa]; `flow`: mean flow through the valve [kg/s].
    """
    filling = without + c.impedance * flow
    pressure = max(filling, vapour)
    return State(pressure, c.per_pressure * (pressure - filling))
