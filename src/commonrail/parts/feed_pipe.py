"""Feed pipe: from the injector's inlet (or the rail) to the accumulation volume, Eq. (6)."""

from __future__ import annotations

from typing import NamedTuple

from commonrail.compile import physics
from commonrail.flow.wave import friction_resistance, impedance, pipe_area
from commonrail.parts.furniture import Annotated, Domain, Q


class Parameters(NamedTuple):
    """Drawing of the pipe."""

    length: Annotated[float, Q("m", "length of the feed pipe", usual=(0.01, 10.0))]
    diameter: Annotated[float, Q("m", "bore of the feed pipe", usual=(0.5e-3, 15e-3))]
    friction_factor: Annotated[float, Q("1", "Darcy friction factor f of Eq. (6)", Domain.NON_NEGATIVE)]


class Coefficients(NamedTuple):
    """What the step needs: a/A [Pa s/kg] and its inverse, half the friction [Pa s²/kg²], travel time L/a [s]."""

    impedance: float
    admittance: float
    half_resistance: float
    travel_time: float


class State(NamedTuple):
    """Mass flow at the two ends [kg/s], positive towards the accumulation volume."""

    inlet_flow: float
    end_flow: float


@physics
def coefficients(p: Parameters, density: float, sound_speed: float) -> Coefficients:
    """Coefficients at the density [kg/m³] and sound speed [m/s] of the rail pressure at time zero."""
    z = impedance(sound_speed, pipe_area(p.diameter))
    return Coefficients(
        z,
        1.0 / z,
        0.5 * friction_resistance(p.friction_factor, p.length, p.diameter, density),
        p.length / sound_speed,
    )


@physics
def arriving(c: Coefficients, wave: float, flow: float) -> float:
    """Wave p + Z q that reaches the far end [Pa], the second half of the friction taken off."""
    return wave - c.half_resistance * flow * abs(flow)


@physics
def returning(c: Coefficients, wave: float, flow: float) -> float:
    """Wave p − Z q that reaches the inlet [Pa]; friction raises it."""
    return wave + c.half_resistance * flow * abs(flow)
