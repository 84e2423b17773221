"""Rail, a volume behind a throttle or an ideal source, and the feed pipe to the accumulation volume, Eq. (6)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.flow import friction_resistance, impedance, pipe_area
from commonrail.physics.law import Domain, Q, physics


class RailParameters(NamedTuple):
    """Drawing of the rail; used only where the injector's `rail_boundary` is "volume"."""

    volume: Annotated[float, Q("m3", "volume of the rail", Domain.POSITIVE, 22e-6, usual=(2e-6, 2e-3))]
    throttle_diameter: Annotated[
        float, Q("m", "throttle at the rail's outlet", Domain.POSITIVE, 0.85e-3, usual=(0.2e-3, 10e-3))
    ]
    throttle_discharge: Annotated[float, Q("1", "discharge coefficient of the throttle", Domain.COEFFICIENT, 0.8)]


class RailCoefficients(NamedTuple):
    """Volume [m³] and (c_d A)² of the throttle [m⁴]."""

    volume: float
    throttle_cda2: float


@physics
def rail_coefficients(p: RailParameters) -> RailCoefficients:
    """Coefficients of the rail, Eq. (3) and (4)."""
    effective = p.throttle_discharge * pipe_area(p.throttle_diameter)
    return RailCoefficients(p.volume, effective * effective)


SIXTH = 1.0 / 6.0  # weight of each end in Simpson's rule; the middle has four


class Parameters(NamedTuple):
    """Drawing of the pipe."""

    length: Annotated[float, Q("m", "length of the feed pipe", usual=(0.01, 10.0))]
    diameter: Annotated[float, Q("m", "bore of the feed pipe", usual=(0.5e-3, 15e-3))]
    friction_factor: Annotated[float, Q("1", "Darcy friction factor f of Eq. (6)", Domain.NON_NEGATIVE)]


class Coefficients(NamedTuple):
    """Impedance a/A [Pa s/kg] and its inverse, friction R of the pipe [Pa s²/kg²], travel time L/a [s]."""

    impedance: float
    admittance: float
    resistance: float
    travel_time: float


class State(NamedTuple):
    """Mass flow at the two ends [kg/s], positive towards the accumulation volume."""

    inlet_flow: float
    end_flow: float


class Travelling(NamedTuple):
    """Waves p + Z q down the pipe, towards the accumulation volume, and p − Z q up it [Pa]."""

    down: float
    up: float


@physics
def coefficients(p: Parameters, density: float, sound_speed: float) -> Coefficients:
    """Coefficients of the pipe, Eq. (6), constant during a simulation.

    `density`: ρ at the rail pressure of time zero [kg/m³]; `sound_speed`: a at that pressure [m/s].
    """
    z = impedance(sound_speed, pipe_area(p.diameter))
    return Coefficients(
        z,
        1.0 / z,
        friction_resistance(p.friction_factor, p.length, p.diameter, density),
        p.length / sound_speed,
    )


@physics
def loss(c: Coefficients, flow: float) -> float:
    """Friction of the whole pipe under a steady flow, R q|q| [Pa]; `flow`: q [kg/s]; the loss has its sign."""
    return c.resistance * flow * abs(flow)


@physics
def end_loss(c: Coefficients, flow: float) -> float:
    """Share of the friction ∫ R q|q| dx/L that Simpson's rule gives to the flow at one end [Pa].

    `flow`: q at that end [kg/s]; the loss has its sign.
    """
    return SIXTH * loss(c, flow)


@physics
def middle_loss(c: Coefficients, ends: State, down: float, up: float) -> float:
    """Share of the friction that Simpson's rule gives to the flow in mid-pipe [Pa], the same for both waves.

    The wave that reaches one end now has met in mid-pipe the one that reaches the other end now: the two give the
    flow there, (down − up)/(2 Z), corrected for the friction up to the middle. That friction is computed
    from the flows at the ends: exact for a steady flow.

    `ends`: flows at both ends [kg/s]; `down`, `up`: waves p + Z q and p − Z q [Pa] that arrive, as they left.
    """
    near = end_loss(c, ends.inlet_flow) + end_loss(c, ends.end_flow)
    flow = 0.5 * c.admittance * (down - up - 2.0 * near)
    return 4.0 * end_loss(c, flow)


@physics
def arrive(c: Coefficients, ends: State, down: float, up: float) -> Travelling:
    """Waves that arrive at the ends, minus the friction of Eq. (6) except that of the present flow there.

    `ends`: flows at both ends [kg/s]; `down`, `up`: waves p + Z q and p − Z q [Pa] that arrive, as they left.
    """
    mid_pipe_loss = middle_loss(c, ends, down, up)
    return Travelling(
        down - mid_pipe_loss - end_loss(c, ends.end_flow), up + mid_pipe_loss + end_loss(c, ends.inlet_flow)
    )


@physics
def leave(c: Coefficients, ends: State, inlet: float, end: float) -> Travelling:
    """Waves that leave both ends, the friction of the flow there taken off.

    `ends`: mean flows at both ends over the step [kg/s]; `inlet`, `end`: mean pressures at both ends over the step
    [Pa].
    """
    z = c.impedance
    return Travelling(
        inlet + z * ends.inlet_flow - end_loss(c, ends.inlet_flow),
        end - z * ends.end_flow + end_loss(c, ends.end_flow),
    )


@physics
def steady(c: Coefficients, flow: float, end: float) -> Travelling:
    """Waves that leave both ends of a pipe with a steady flow.

    `flow`: q [kg/s]; `end`: pressure at its end [Pa].
    """
    return leave(c, State(flow, flow), end + loss(c, flow), end)
