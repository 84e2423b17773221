"""From the parameters of a direct-acting injector to its coefficients and to its state at rest."""

from __future__ import annotations

from typing import NamedTuple

from commonrail.physics import fuel_kernel as fuel
from commonrail.physics.components import (
    accumulation,
    armature,
    direct_needle,
    drive,
    feed_pipe,
    flux_decay,
    needle_seat,
    nozzle,
    sac,
    solenoid,
)
from commonrail.physics.flow.volume import Contents, filled
from commonrail.physics.fuel_kernel import FuelCoefficients
from commonrail.physics.law import physics
from commonrail.physics.model import Ambient, CumulativeFlows, Setting
from commonrail.physics.setup import GIVE, ambient, contact_period, lag_fraction, seat_contact

# Direct-acting injector as data: parameters, coefficients and state of the components that it has.
#
# No control chamber, no A- and Z-hole, no control valve and no return: the armature moves the needle. Components that
# both injectors have bear the same names in both, so that the laws between them (`joints`, `step.fill_sac`) serve
# both.


class Parameters(NamedTuple):
    """Every parameter of the direct-acting injector (SI), component by component."""

    feed_pipe: feed_pipe.Parameters
    solenoid: solenoid.Parameters
    flux_decay: flux_decay.Parameters
    drive: drive.Parameters
    armature: armature.Parameters
    needle: direct_needle.Parameters
    accumulation: accumulation.Parameters
    needle_seat: needle_seat.Parameters
    sac: sac.Parameters
    nozzle: nozzle.Parameters


class Delays(NamedTuple):
    """Travel time in steps; shares of the flux's lag that a step makes up, and of c_d's memory that it takes [1]."""

    feed: float
    rising: float
    falling: float
    memory_lag_fraction: float


class Coefficients(NamedTuple):
    """Numbers that the step needs, computed once per candidate and operating point."""

    fuel: FuelCoefficients
    feed_pipe: feed_pipe.Coefficients
    solenoid: solenoid.Coefficients
    flux_decay: flux_decay.Parameters
    drive: drive.Parameters
    armature: armature.Coefficients
    needle: direct_needle.Coefficients
    needle_seat: needle_seat.Coefficients
    accumulation: accumulation.Parameters
    sac: sac.Parameters
    nozzle: nozzle.Coefficients
    cylinder: Ambient
    delays: Delays


class State(NamedTuple):
    """State at t_n."""

    feed_pipe: feed_pipe.State
    solenoid: solenoid.State
    drive: drive.State
    accumulation: accumulation.State
    body: direct_needle.State
    sac: Contents
    nozzle: nozzle.State
    cumulative_flows: CumulativeFlows


@physics
def coefficients(p: Parameters, f: fuel.FuelCoefficients, at: Setting) -> Coefficients:
    """Coefficients of every part; wave speed and laminar offsets at the rail pressure of time zero."""
    density = fuel.density(f, at.rail)
    viscosity = density * fuel.kinematic_viscosity(f, at.rail)
    feed = feed_pipe.coefficients(p.feed_pipe, density, fuel.sound_speed(f, density))
    return Coefficients(
        fuel=f,
        feed_pipe=feed,
        solenoid=solenoid.coefficients(p.solenoid),
        flux_decay=p.flux_decay,
        drive=p.drive,
        armature=armature.coefficients(p.armature),
        needle=direct_needle.coefficients(p.needle),
        needle_seat=needle_seat.coefficients(p.needle_seat, viscosity),
        accumulation=p.accumulation,
        sac=p.sac,
        nozzle=nozzle.coefficients(p.nozzle, at.rail, viscosity),
        cylinder=ambient(f, at.cylinder),
        delays=Delays(
            feed.travel_time / at.dt,
            lag_fraction(p.solenoid.eddy_lag, at.dt),
            lag_fraction(p.flux_decay.lag, at.dt),
            lag_fraction(p.nozzle.discharge_memory, at.dt),
        ),
    )


@physics
def moving_masses(c: Coefficients) -> direct_needle.Masses:
    """Armature and needle."""
    return direct_needle.Masses(c.armature, c.needle)


@physics
def accumulation_volume(c: Coefficients, tip: float) -> float:
    """Accumulation volume [m³]: the needle that rises out of the seat takes as much of it as it leaves to the SAC.

    `tip`: lift of the needle [m].
    """
    return c.accumulation.volume - c.needle_seat.area * max(tip, 0.0)


@physics
def rest(c: Coefficients, at: Setting) -> State:
    """Accumulation at rail pressure, SAC at cylinder pressure, armature and needle on their seats."""
    load = direct_needle.Loads(0.0, -c.needle_seat.area * (at.rail - at.cylinder))
    body = direct_needle.at_rest(moving_masses(c), seat_contact(c), load)
    return State(
        feed_pipe=feed_pipe.State(0.0, 0.0),
        solenoid=solenoid.State(0.0, 0.0),
        drive=drive.State(2.0),
        accumulation=accumulation.State(filled(c.fuel, at.rail, c.accumulation.volume), at.rail),
        body=body,
        sac=filled(c.fuel, at.cylinder, sac.volume(c.sac, c.needle_seat.area, body.z.needle)),
        nozzle=nozzle.State(0.0, 0.0),
        cumulative_flows=CumulativeFlows(returned=0.0, supplied=0.0),
    )


@physics
def longest_contact(c: Coefficients) -> float:
    """Longest time [s] for which needle or armature may touch and yet leave again: a period on its contact."""
    needle = 1.0 / (c.needle.per_mass * c.needle_seat.contact_stiffness)
    return contact_period(needle, 1.0 / (c.armature.per_mass * c.armature.contact_stiffness))


@physics
def farthest_lift(c: Coefficients) -> float:
    """Lift [m] beyond which armature or needle have passed their stop, and below which, negative, their seat."""
    return c.armature.travel + GIVE
