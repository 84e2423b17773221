"""Injector whose solenoid acts on the needle itself: parameters, coefficients, state at rest, and one time step.

No control chamber, no A- and Z-hole, no control valve and no return: the armature moves the needle. Components that
both types of injector contain have the same names in both. The laws of `connections` and the shared laws of `step`
therefore serve both.

As in `step`, positions, pressures and flux are those of t_n, velocities a little older. Armature and needle move first;
then the flux follows with the gap of mid-step; then the SAC, the stiffest volume, is filled, and what flows through the
seat is drawn from the accumulation volume, which the feed pipe replenishes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from commonrail.physics import fuel_kernel as fuel
from commonrail.physics.components import direct_needle, drive, feed_pipe, needle_seat, nozzle, solenoid
from commonrail.physics.components.plunger_needle import Motion
from commonrail.physics.connections import Volumes, middle, nozzle_cda2, remembered_lift, seat_cda2
from commonrail.physics.flow import Contents, Flow, contents, contents_at, jet, orifice
from commonrail.physics.fuel_kernel import FuelCoefficients
from commonrail.physics.law import physics
from commonrail.physics.model import (
    GIVE,
    Ambient,
    CumulativeFlows,
    DischargeLaw,
    DriveLaw,
    InletLaw,
    Inputs,
    Setting,
    Waves,
    ambient,
    ambient_density,
    contact_period,
    lag_fraction,
    seat_contact,
)
from commonrail.physics.step import AirGap, SacFlows, StepGeometry, fill_accumulation, limit_sac, magnetise


class Parameters(NamedTuple):
    """Every parameter of the direct-acting injector (SI), component by component."""

    feed_pipe: feed_pipe.Parameters
    solenoid: solenoid.Parameters
    flux_decay: solenoid.DecayParameters
    drive: drive.Parameters
    armature: direct_needle.ArmatureParameters
    needle: direct_needle.Parameters
    accumulation: needle_seat.AccumulationParameters
    needle_seat: needle_seat.Parameters
    sac: needle_seat.SacParameters
    nozzle: nozzle.Parameters


class Delays(NamedTuple):
    """Travel time in steps; shares of the flux's lag that a step makes up, and of c_d's memory that it takes [1]."""

    feed: float
    rising_lag_fraction: float
    falling_lag_fraction: float
    memory_lag_fraction: float


class Coefficients(NamedTuple):
    """Numbers that the step needs, computed once per candidate and operating point."""

    fuel: FuelCoefficients
    feed_pipe: feed_pipe.Coefficients
    solenoid: solenoid.Coefficients
    flux_decay: solenoid.DecayParameters
    drive: drive.Parameters
    armature: direct_needle.ArmatureCoefficients
    needle: direct_needle.Coefficients
    needle_seat: needle_seat.Coefficients
    accumulation: needle_seat.AccumulationParameters
    sac: needle_seat.SacCoefficients
    nozzle: nozzle.Coefficients
    cylinder: Ambient
    delays: Delays


class State(NamedTuple):
    """State at t_n."""

    feed_pipe: feed_pipe.State
    solenoid: solenoid.State
    drive: drive.State
    accumulation: needle_seat.AccumulationState
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
        armature=direct_needle.armature_coefficients(p.armature),
        needle=direct_needle.coefficients(p.needle),
        needle_seat=needle_seat.coefficients(p.needle_seat, viscosity),
        accumulation=p.accumulation,
        sac=needle_seat.sac_coefficients(p.sac),
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
        accumulation=needle_seat.AccumulationState(contents_at(c.fuel, at.rail, c.accumulation.volume), at.rail),
        body=body,
        sac=contents_at(c.fuel, at.cylinder, needle_seat.sac_volume(c.sac, c.needle_seat.area, body.z.needle)),
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


@physics
def needle_pressure(c: Coefficients, accumulation_pressure: float, sac_pressure: float) -> float:
    """Force of the pressures [Pa] on the needle [N], positive when opening: they press it on its seat."""
    return -c.needle_seat.area * (accumulation_pressure - sac_pressure)


@physics
def loads(c: Coefficients, s: State) -> direct_needle.Loads:
    """Magnetic force on the armature, and force of the pressures on the needle, at t_n."""
    magnetic = solenoid.magnetic_force(c.solenoid, s.solenoid.pulling_flux)
    return direct_needle.Loads(magnetic, needle_pressure(c, s.accumulation.fuel.pressure, s.sac.pressure))


@physics
def volumes_of(c: Coefficients, lifts: Motion) -> Volumes:
    """Fuel volumes at the given lifts of the needle; there is no control chamber."""
    return Volumes(0.0, accumulation_volume(c, lifts.tip), needle_seat.sac_volume(c.sac, c.needle_seat.area, lifts.tip))


@physics
def fill_sac(c: Coefficients, s: State, u: Inputs, upstream: float, discharge: float, at: StepGeometry) -> SacFlows:
    """SAC, Eq. (3) in mass: dm/dt = q_seat − q_nozzle, by Eq. (4), the nozzle's late flow not linearised.

    A needle that leaves its seat empties the SAC, and fuel fills the cavity within a few steps: linearised there, the
    nozzle's flow alternates between far too little and far too much. The end of the step has the pressure at which the
    flow is q, q |q| + 2 q_h q = 2 ρ (c_d A)² (p − p_cylinder), so that the balance is a quadratic in q.

    `upstream`: pressure in the accumulation volume [Pa]; `discharge`: discharge coefficient of the nozzle [1].
    """
    here, before, tip = s.sac, s.accumulation.fuel.density, middle(at.old.tip, at.new.tip)
    seat = orifice(seat_cda2(c, upstream, here.pressure, tip), before, c.needle_seat.offset)
    through = nozzle_cda2(c, here.pressure, u.cylinder, discharge)
    spray = jet(through.cda2_dp, here.density, c.nozzle.offset)
    # dp/dρ times the step; a cavity fills as fuel in tension would, from a pressure that much lower
    tension = c.fuel.p1 * c.fuel.inverse_reference_density
    cavity = here.stiffness == 0.0
    gain = at.dt * (tension if cavity else here.stiffness)
    volume, growing = middle(at.before.sac, at.after.sac), 2.0 * here.density * through.cda2
    lacking = volume * (tension * here.density - c.fuel.p1 - here.pressure) if cavity else 0.0
    # weight of the step's end in its mean: the more, the stiffer the SAC
    soft, stiff = volume * spray.root, gain * (seat.slope * spray.root + 0.5 * growing)
    weight = (3.0 * soft + stiff) / (6.0 * soft + stiff)
    late_gap = seat_cda2(c, upstream, here.pressure, at.old.tip + weight * (at.new.tip - at.old.tip))
    late = orifice(late_gap, before, c.needle_seat.offset)
    room = volume + gain * weight * late.slope
    supply = late.mass_flow - here.density * (at.after.sac - at.before.sac) / at.dt
    early = (1.0 - weight) * spray.mass_flow
    balance = 2.0 * here.density * room * through.cda2_dp + growing * (lacking + gain * (supply - early))
    half = room * c.nozzle.offset + 0.5 * gain * weight * growing
    size = abs(balance) / (half + math.sqrt(half * half + room * abs(balance)))
    outflow = early + weight * (size if balance >= 0.0 else max(-size, spray.mass_flow if cavity else -size))
    rise = (lacking + gain * (supply - outflow)) / room
    rise = max(rise, 0.0) if cavity else rise
    mass = here.mass + at.dt * (late.mass_flow - weight * late.slope * rise - outflow)
    inflow = seat.mass_flow - 0.5 * seat.slope * rise  # of mid-step, whatever the weight
    limited = limit_sac(c, s, u, upstream, SacFlows(inflow, inflow, mass), at)
    mass = not_past_cylinder(c, here, u.cylinder, limited.mass, at)
    return SacFlows(limited.seat, limited.seat - (mass - here.mass) * (1.0 / at.dt), mass)


@physics
def not_past_cylinder(c: Coefficients, here: Contents, cylinder: float, mass: float, geometry: StepGeometry) -> float:
    """A SAC that empties stops at cylinder pressure: its volume counts late, and the flow would pass it.

    `cylinder`: pressure [Pa]; `mass`: not yet limited [kg].
    """
    rest = ambient_density(c.cylinder, cylinder) * geometry.after.sac
    emptying = here.pressure >= cylinder and geometry.after.sac <= geometry.before.sac
    return max(mass, min(rest, here.mass)) if emptying else mass


class DirectLaws(NamedTuple):
    """Laws in which variants differ: flux rate of the drive, boundary at the rail, discharge of the nozzle."""

    drive: DriveLaw
    inlet: InletLaw
    discharge: DischargeLaw


def make_step(laws: DirectLaws) -> Callable[..., tuple[State, Waves]]:
    """Step of one variant: function (coefficients, state, inputs, arriving waves, dt) → (state, waves)."""
    drive_law, inlet_law, discharge = laws

    @physics
    def step(c: Coefficients, s: State, u: Inputs, arriving: Waves, dt: float) -> tuple[State, Waves]:
        """State at t_n + dt, and the waves that leave."""
        # armature and needle (Newton's second law), and the solenoid, Eq. (11), (12)
        body = direct_needle.advance(moving_masses(c), seat_contact(c), s.body, loads(c, s), dt)
        old, new = direct_needle.lifts(s.body.z), direct_needle.lifts(body.z)
        position = middle(old.top, new.top)
        gap = AirGap(c.armature.travel - position, position - s.body.z.armature)
        magnet, conducting = magnetise(c, s, u, gap, drive_law, dt)
        geometry = StepGeometry(old, new, volumes_of(c, old), volumes_of(c, new), dt)

        # SAC: Eq. (3), (4), c_d by Eq. (9)
        store = s.accumulation.fuel
        upstream = store.pressure + 0.5 * (store.pressure - s.accumulation.pressure_before)
        reached = remembered_lift(c, s, middle(old.tip, new.tip), u.cylinder)
        passing = discharge(c.nozzle, max(reached, middle(old.tip, new.tip)), s.sac.pressure, u.cylinder)
        sac_flows = fill_sac(c, s, u, upstream, passing, geometry)

        # feed pipe, Eq. (6), and accumulation volume, Eq. (3)
        arrived = feed_pipe.arrive(c.feed_pipe, s.feed_pipe, arriving.down, arriving.up)
        inlet = inlet_law(c, s, u, arrived.up)
        filled = fill_accumulation(c, s, arrived.down, sac_flows.seat, Flow(0.0, 0.0), geometry)

        ends = feed_pipe.State(inlet.flow, filled.pipe)
        away = feed_pipe.leave(c.feed_pipe, ends, inlet.pressure, filled.pressure)
        after = State(
            feed_pipe=ends,
            solenoid=magnet,
            drive=drive.State(conducting),
            accumulation=needle_seat.AccumulationState(
                contents(c.fuel, filled.mass, geometry.after.accumulation), store.pressure
            ),
            body=body,
            sac=contents(c.fuel, sac_flows.mass, geometry.after.sac),
            nozzle=nozzle.State(max(reached, new.tip), s.nozzle.injected + dt * sac_flows.nozzle),
            cumulative_flows=CumulativeFlows(
                s.cumulative_flows.returned, s.cumulative_flows.supplied + dt * inlet.flow
            ),
        )
        return after, Waves(away.down, away.up, arriving.back)

    return step
