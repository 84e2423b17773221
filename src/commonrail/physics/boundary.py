"""Sources of the feed pipe: an ideal rail that holds the measured pressure, or a rail volume behind a throttle."""

from __future__ import annotations

from typing import Any, NamedTuple

from commonrail.physics.flow.orifice import Restriction, orifice
from commonrail.physics.flow.volume import Contents, contents
from commonrail.physics.law import physics
from commonrail.physics.model import Coefficients, Inputs, State


class Inlet(NamedTuple):
    """Mean over the step at the pipe's inlet: pressure [Pa], flow into the pipe [kg/s]."""

    pressure: float
    flow: float


@physics
def ideal_rail(c: Any, s: Any, u: Inputs, wave: float) -> Inlet:
    """The inlet holds the measured rail pressure whatever flows."""
    return Inlet(u.rail, (u.rail - wave) * c.feed_pipe.admittance)


@physics
def rail_volume(c: Coefficients, s: State, u: Inputs, wave: float) -> Inlet:
    """Rail volume behind a throttle, then the pipe: throttle loss and pipe impedance solved together.

    p_rail − p_inlet = q²/(2 ρ (c_d A)²) with p_inlet = wave + Z (q − q_Z) is a quadratic in q: the law
    of `orifice` with an offset of ρ (c_d A)² Z.

    `wave`: arriving at the inlet [Pa].
    """
    z = c.feed_pipe.impedance
    z_flow = c.control_chamber.z_inlet_fraction * s.control_chamber.z_flow
    cda2 = c.rail.throttle_cda2
    through = Restriction(cda2 * (s.rail.pressure - wave + z * z_flow), cda2)
    total = orifice(through, s.rail.density, s.rail.density * cda2 * z)
    flow = total.mass_flow - z_flow
    return Inlet(wave + z * flow, flow)


@physics
def draw_nothing(c: Coefficients, s: State, drawn: float) -> Contents:
    """An ideal rail is inexhaustible."""
    return s.rail


@physics
def draw_from_rail(c: Coefficients, s: State, drawn: float) -> Contents:
    """Rail after `drawn` [kg] have left it; the pump delivers nothing during an injection."""
    return contents(c.fuel, s.rail.mass - drawn, 1.0 / c.rail.volume)
