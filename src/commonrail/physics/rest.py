"""State of a servo injector before its first energising: nothing moves, while the guides leak.

What leaks through the plunger's guide, Eq. (5), passes the Z-hole, Eq. (4), and all leakage passes the rail's throttle
and the feed pipe, Eq. (6). So control chamber and accumulation volume are a little below rail pressure:

    p_inlet = p_rail − (q_Z + q_needle)²/(2 ρ (c_d A)²)
    p_a = p_inlet − R q_pipe²,      q_pipe = q_needle + (1 − x) q_Z
    p_c = x p_inlet + (1 − x) p_a − (q_Z² + 2 q_h q_Z)/(2 ρ (c_d A)²)

with the flows of Eq. (5) at p_a and p_c, and x the share of the Z-hole that is fed from the pipe's inlet. A closed
valve lets nothing pass. Only the contents of a rail volume, which no pump fills, decrease.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from commonrail.base.choices import Boundary
from commonrail.physics.components import (
    control_chamber,
    drive,
    feed_pipe,
    needle_seat,
    nozzle,
    return_line,
    solenoid,
    valve,
)
from commonrail.physics.components.plunger_needle import loads
from commonrail.physics.connections import volumes_of
from commonrail.physics.flow import contents_at
from commonrail.physics.law import physics
from commonrail.physics.model import (
    Body,
    Coefficients,
    CumulativeFlows,
    LeakLaw,
    Setting,
    State,
    ambient_density,
    seat_contact,
)


class Leaking(NamedTuple):
    """Pressures of accumulation volume and control chamber [Pa], flows of feed pipe and Z-hole [kg/s]."""

    accumulation: float
    control: float
    pipe: float
    z_hole: float


@physics
def flow_into_guide(drop: float, guide: float, linear: float, quadratic: float) -> float:
    """Flow q [kg/s] through a hole and a guide in series, drop = quadratic q |q| + linear q + q/guide.

    `drop`: pressure difference over both [Pa]; `guide`: flow per pressure difference of the guide, zero if it is tight
    [kg/(s Pa)]; `linear` [Pa s/kg], `quadratic` [Pa s²/kg²]: of the hole.
    """
    half = 1.0 + linear * guide
    return 2.0 * drop * guide / (half + math.sqrt(half * half + 4.0 * quadratic * abs(drop) * guide * guide))


def make_leaking(leak: LeakLaw, boundary: Boundary) -> Callable[[Coefficients, Setting], Leaking]:
    """Function (coefficients, setting) → `Leaking`; `leak`: leakage through a guide."""
    throttled = 1.0 if boundary is Boundary.VOLUME else 0.0

    @physics
    def closer(c: Coefficients, at: Setting, s: Leaking) -> Leaking:
        """Pressures and flows by the leakage at the pressures `s`; one pass reduces the error to about 1 %."""
        guides, hole, x = c.plunger_needle.guides, c.control_chamber, c.control_chamber.z_inlet_fraction
        needle = leak(c, guides.needle_gap, s.accumulation, at.low).mass_flow
        total = s.z_hole + needle
        # a loss above the full pressure means a guide far too wide, whose needle does not stay closed
        loss = throttled * total * abs(total) / (2.0 * c.source.density * c.rail.throttle_cda2)
        inlet = max(at.rail - loss, at.low)
        pipe = needle + (1.0 - x) * s.z_hole
        accumulation = max(inlet - feed_pipe.loss(c.feed_pipe, pipe), at.low)
        feed = x * inlet + (1.0 - x) * accumulation
        cda2 = ambient_density(c.source, feed) * hole.z_cda2
        linear, quadratic = hole.z_offset / cda2, 0.5 / cda2
        plunger = leak(c, guides.plunger_gap, s.control, at.low).slope
        z_hole = flow_into_guide(feed - at.low, plunger, linear, quadratic)
        return Leaking(accumulation, feed - (linear + quadratic * abs(z_hole)) * z_hole, pipe, z_hole)

    @physics
    def leaking(c: Coefficients, at: Setting) -> Leaking:
        # three rounds leave less than 0.01 Pa of a sound injector's drops
        second = closer(c, at, closer(c, at, Leaking(at.rail, at.rail, 0.0, 0.0)))
        return closer(c, at, closer(c, at, second))

    return leaking


def make_rest(body: Body, leak: LeakLaw, boundary: Boundary) -> Callable[[Coefficients, Setting], State]:
    """Function (coefficients, setting) → state before energising.

    `body`: `plunger_needle` or `rigid_body`; `leak`: leakage through a guide.
    """
    at_rest, lifts_of, leaking = body.at_rest, body.lifts, make_leaking(leak, boundary)

    @physics
    def rest(c: Coefficients, at: Setting) -> State:
        """Control chamber and accumulation at the pressures of steady leakage, SAC at cylinder pressure."""
        s = leaking(c, at)
        load = loads(c.plunger_needle.guides, c.needle_seat.area, s.control, s.accumulation, at.cylinder, at.low)
        body = at_rest(c.plunger_needle, seat_contact(c), load)
        volumes = volumes_of(c, lifts_of(body.z))
        store = contents_at(c.fuel, s.accumulation, volumes.accumulation)
        return State(
            rail=contents_at(c.fuel, at.rail, c.rail.volume),
            feed_pipe=feed_pipe.State(s.pipe, s.pipe),
            control_chamber=control_chamber.State(contents_at(c.fuel, s.control, volumes.control), s.z_hole),
            valve=valve.at_rest(c.valve, s.control - at.low),
            solenoid=solenoid.State(0.0, 0.0),
            drive=drive.State(2.0),
            return_line=return_line.State(at.low, 0.0),
            accumulation=needle_seat.AccumulationState(store, s.accumulation),
            body=body,
            sac=contents_at(c.fuel, at.cylinder, volumes.sac),
            nozzle=nozzle.State(0.0, 0.0),
            cumulative_flows=CumulativeFlows(returned=0.0, supplied=0.0),
        )

    return rest
