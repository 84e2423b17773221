"""Return line: the control chamber's link to the low-pressure circuit, by characteristics, Eq. (6).

The valve's outflow raises the pressure at its outlet by Z q; the wave runs to the tank, which holds
the return pressure, and comes back inverted after 2 L/a. A line of length zero is the tank itself.

Where the outlet would fall below the vapour pressure, a cavity opens there (discrete vapour cavity model; Bergant,
Simpson and Tijsseling 2006, doi:10.1016/j.jfluidstructs.2005.08.008). It stays at p_v, the line's flow follows from
p_v and the arriving wave alone, and the cavity takes up the difference to the valve's flow, dm/dt = q_line − q, with
m the mass of liquid that is missing. Over one step, with mean flows,

    p = max(p_v, back + Z (q − m/dt)),   q_line = (p − back)/Z,   m' = m + dt (q_line − q) ≥ 0

which needs no switch: m' is zero where the flow of the step fills the cavity.
"""

from __future__ import annotations

from typing import NamedTuple

from commonrail.compile import physics
from commonrail.flow.orifice import Flow
from commonrail.flow.wave import impedance, pipe_area
from commonrail.parts.furniture import Annotated, Domain, Q


class Parameters(NamedTuple):
    """Drawing of the return line."""

    length: Annotated[
        float, Q("m", "length of the return line (0: none)", Domain.NON_NEGATIVE, 0.0, usual=(0.01, 20.0))
    ]
    diameter: Annotated[float, Q("m", "bore of the return line", Domain.POSITIVE, 4e-3, usual=(0.5e-3, 30e-3))]


class Coefficients(NamedTuple):
    """Impedance [Pa s/kg], its inverse [kg/(Pa s)] (both 0 without a line), a wave's time to the tank and back [s]."""

    impedance: float
    admittance: float
    round_trip: float


class State(NamedTuple):
    """Pressure behind the valve over the last step [Pa], and the liquid that its vapour cavity displaces [kg]."""

    pressure: float
    cavity: float


class Outlet(NamedTuple):
    """Mean pressure behind the valve [Pa] and flow into the line [kg/s] over a step, and the cavity after it [kg]."""

    pressure: float
    flow: float
    cavity: float


class Answer(NamedTuple):
    """Pressure behind the valve, linear in its flow: at no flow [Pa], and its slope [Pa s/kg]."""

    pressure: float
    impedance: float


@physics
def coefficients(p: Parameters, sound_speed: float) -> Coefficients:
    """Coefficients of the line, Eq. (6) without friction.

    Parameters
    ----------
    p : Parameters
        Drawing.
    sound_speed : float
        a at the return pressure [m/s].
    """
    z = impedance(sound_speed, pipe_area(p.diameter)) if p.length > 0.0 else 0.0
    return Coefficients(z, 1.0 / z if p.length > 0.0 else 0.0, 2.0 * p.length / sound_speed)


@physics
def answer(c: Coefficients, s: State, back: float, vapour: float, flow: Flow, dt: float) -> Answer:
    """Answer of the line to the valve's mean flow over a step, itself linear in the pressure behind the valve.

    Parameters
    ----------
    c, s
        Coefficients and state.
    back : float
        Wave that arrives [Pa].
    vapour : float
        p_v [Pa].
    flow : Flow
        At the state's pressure, and how it falls with that pressure.
    dt : float
        Step [s].
    """
    filling = back - c.impedance * (s.cavity / dt)
    at_vapour = flow.mass_flow + flow.slope * (s.pressure - vapour)  # the flow if the outlet is at p_v
    is_open = filling + c.impedance * at_vapour < vapour
    return Answer(vapour if is_open else filling, 0.0 if is_open else c.impedance)


@physics
def advance(c: Coefficients, s: State, back: float, vapour: float, flow: float, dt: float) -> Outlet:
    """Outlet of the valve over a step.

    Parameters
    ----------
    c, s
        Coefficients and state.
    back : float
        Wave that arrives [Pa].
    vapour : float
        p_v [Pa].
    flow : float
        Mean flow through the valve [kg/s].
    dt : float
        Step [s].
    """
    cavity = max(s.cavity + dt * c.admittance * (vapour - back - c.impedance * flow), 0.0)
    line_flow = flow + (cavity - s.cavity) / dt
    return Outlet(max(back + c.impedance * line_flow, vapour), line_flow, cavity)
