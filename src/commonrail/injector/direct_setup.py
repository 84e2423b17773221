"""From the parameters of a direct-acting injector to its coefficients and to its state at rest."""

from __future__ import annotations

from commonrail.compile import physics
from commonrail.fuel import kernel as fuel
from commonrail.injector.direct_model import Coefficients, Delays, Parameters, State
from commonrail.injector.model import CumulativeFlows, Setting
from commonrail.injector.setup import GIVE, ambient, contact_period, lag_fraction, seat_contact
from commonrail.parts import (
    accumulation,
    armature,
    direct_needle,
    drive,
    feed_pipe,
    needle_seat,
    nozzle,
    sac,
    solenoid,
)
from commonrail.parts.contents import filled


@physics
def coefficients(p: Parameters, f: fuel.FuelCoefficients, at: Setting) -> Coefficients:
    """Coefficients of every part; wave speed and laminar offsets at the rail pressure of time zero.

    Parameters
    ----------
    p : Parameters
    f : FuelCoefficients
    at : Setting
    """
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

    Parameters
    ----------
    c : Coefficients
    tip : float
        Lift of the needle [m].
    """
    return c.accumulation.volume - c.needle_seat.area * max(tip, 0.0)


@physics
def rest(c: Coefficients, at: Setting) -> State:
    """Accumulation at rail pressure, SAC at cylinder pressure, armature and needle on their seats.

    Parameters
    ----------
    c : Coefficients
    at : Setting
    """
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
