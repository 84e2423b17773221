"""From parameters to coefficients and to the state at rest, for one candidate at one operating point."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from commonrail.physics import fuel_kernel as fuel
from commonrail.physics.components import (
    accumulation,
    control_chamber,
    drive,
    feed_pipe,
    needle_seat,
    nozzle,
    plunger_needle,
    rail,
    return_line,
    sac,
    solenoid,
    valve,
)
from commonrail.physics.flow.volume import filled
from commonrail.physics.law import physics
from commonrail.physics.model import Ambient, Coefficients, CumulativeFlows, Delays, Parameters, Setting, State
from commonrail.physics.protocols import Body

# What seat, stop and needle give way by, at most [m]: chosen, far above the some 0.1 mm of the catalogue's injectors.
GIVE = 2e-3


@physics
def coefficients(p: Parameters, f: fuel.FuelCoefficients, at: Setting) -> Coefficients:
    """Coefficients of every part; wave speeds and laminar offsets at the rail pressure of time zero."""
    density = fuel.density(f, at.rail)
    speed = fuel.sound_speed(f, density)
    viscosity = density * fuel.kinematic_viscosity(f, at.rail)
    low_density = fuel.density(f, at.low)
    feed = feed_pipe.coefficients(p.feed_pipe, density, speed)
    back = return_line.coefficients(p.return_line, fuel.sound_speed(f, low_density), at.dt)
    return Coefficients(
        fuel=f,
        rail=rail.coefficients(p.rail),
        feed_pipe=feed,
        control_chamber=control_chamber.coefficients(p.control_chamber, viscosity),
        valve=valve.coefficients(p.valve),
        solenoid=solenoid.coefficients(p.solenoid),
        drive=p.drive,
        return_line=back,
        plunger_needle=plunger_needle.coefficients(p.plunger_needle, at.dt),
        needle_seat=needle_seat.coefficients(p.needle_seat, viscosity),
        accumulation=p.accumulation,
        sac=p.sac,
        nozzle=nozzle.coefficients(p.nozzle, at.rail, viscosity),
        source=ambient(f, at.rail),
        cylinder=ambient(f, at.cylinder),
        delays=Delays(
            feed.travel_time / at.dt,
            back.round_trip / at.dt,
            lag_fraction(p.solenoid.eddy_lag, at.dt),
            lag_fraction(p.nozzle.discharge_memory, at.dt),
        ),
    )


@physics
def lag_fraction(lag: float, dt: float) -> float:
    """Share of a first-order lag that a step makes up [1]; `lag`: τ [s], ≥ 0; zero for no lag; `dt`: step [s]."""
    return 1.0 - math.exp(-dt / lag) if lag > 0.0 else 1.0


@physics
def ambient(f: fuel.FuelCoefficients, pressure: float) -> Ambient:
    """Fuel at a boundary pressure [Pa]."""
    density = fuel.density(f, pressure)
    return Ambient(pressure, density, 1.0 / fuel.stiffness(f, density))


@physics
def ambient_density(around: Ambient, pressure: float) -> float:
    """Density [kg/m³] near the boundary pressure of time zero."""
    return around.density + (pressure - around.pressure) * around.compressibility


@physics
def static_loads(c: Coefficients, at: Setting) -> plunger_needle.Loads:
    """Pressure forces with the needle closed and all flows at rest."""
    guides, area = c.plunger_needle.guides, c.needle_seat.area
    return plunger_needle.loads(guides, area, at.rail, at.rail, at.cylinder, at.low)


@physics
def seat_contact(c: Any) -> plunger_needle.SeatContact:
    """The needle seat as a contact of the needle; of either actuation."""
    return plunger_needle.SeatContact(c.needle_seat.contact_stiffness, c.needle_seat.contact_damping)


def make_rest(body: Body) -> Callable[[Coefficients, Setting], State]:
    """Function (coefficients, setting) → state before energising, `body` being `plunger_needle` or `rigid_body`."""
    at_rest, lifts_of = body.at_rest, body.lifts

    @physics
    def rest(c: Coefficients, at: Setting) -> State:
        """Control chamber and accumulation at rail pressure, SAC at cylinder pressure."""
        body = at_rest(c.plunger_needle, seat_contact(c), static_loads(c, at))
        lifts = lifts_of(body.z)
        return State(
            rail=filled(c.fuel, at.rail, c.rail.volume),
            feed_pipe=feed_pipe.State(0.0, 0.0),
            control_chamber=control_chamber.State(filled(c.fuel, at.rail, control_volume(c, lifts)), 0.0),
            valve=valve.at_rest(c.valve, at.rail - at.low),
            solenoid=solenoid.State(0.0, 0.0),
            drive=drive.State(2.0),
            return_line=return_line.State(at.low, 0.0),
            accumulation=accumulation.State(filled(c.fuel, at.rail, accumulation_volume(c, lifts)), at.rail),
            body=body,
            sac=filled(c.fuel, at.cylinder, sac.volume(c.sac, c.needle_seat.area, lifts.tip)),
            nozzle=nozzle.State(0.0, 0.0),
            cumulative_flows=CumulativeFlows(returned=0.0, supplied=0.0),
        )

    return rest


@physics
def control_volume(c: Coefficients, lifts: plunger_needle.Motion) -> float:
    """Control chamber's volume [m³]: the plunger that rises takes it."""
    return c.control_chamber.volume - c.plunger_needle.guides.plunger_area * lifts.top


@physics
def accumulation_volume(c: Coefficients, lifts: plunger_needle.Motion) -> float:
    """Accumulation volume [m³]: a rising shoulder and tip of the needle enlarge it."""
    guides = c.plunger_needle.guides
    shoulder = (guides.guide_area - guides.stem_area) * lifts.shoulder
    return c.accumulation.volume + shoulder + (guides.stem_area - c.needle_seat.area) * lifts.tip


@physics
def longest_contact(c: Coefficients) -> float:
    """Longest time [s] for which needle or valve may touch its seat and yet leave it again: a period on its contact."""
    needle = c.plunger_needle.total_mass / c.needle_seat.contact_stiffness
    return contact_period(needle, 1.0 / (c.valve.per_mass * c.valve.contact_stiffness))


@physics
def contact_period(first: float, second: float) -> float:
    """Period of the slower of two masses on their contacts, 2π sqrt(m/k) [s], from m/k of each [s²]."""
    return 2.0 * math.pi * math.sqrt(max(first, second))


@physics
def farthest_lift(c: Coefficients) -> float:
    """Lift [m] beyond which plunger or needle have passed their stop, and below which, negative, their seat."""
    return c.plunger_needle.guides.stop_lift + GIVE
