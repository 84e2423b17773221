"""One time step of the whole injector: discretises the equations of `physics.equations`, and fixes their order.

Positions, pressures and flux stand at t_n, velocities at t_n − dt/2. First everything that moves is
carried to t_n + dt under the forces of t_n (leapfrog); then each volume is filled with the geometry of
mid-step, the SAC first, because it is the stiff one: what flows through the seat is its balance, and
goes on to the accumulation volume. A flow is computed once and counted on both sides, so mass is
conserved to rounding. Waves are means over a step. The variants (chain or rigid body, ideal rail or rail
volume, kind of drive) are handed in as functions.

Each volume is filled in three parts: the balance dm/dt = Σ q at t_n, its linearisation in the volume's own
pressure, q = q_n + s (p − p_n), and the implicit mean over the step, p − p_n = δ of `mean_departure_of`. The nozzle's
flow out of the SAC is not linearised (`fill_sac`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

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
from commonrail.physics.components.plunger_needle import Loads, Motion, loads
from commonrail.physics.connections import (
    Hole,
    Volumes,
    drain_cda2,
    middle,
    nozzle_cda2,
    remembered_lift,
    seat_cda2,
    seat_pressure,
    volumes_of,
    z_hole_cda2,
)
from commonrail.physics.flow import Contents, Flow, Restriction, contents, jet, mean_departure, orifice
from commonrail.physics.law import physics
from commonrail.physics.model import (
    Advance,
    Coefficients,
    CumulativeFlows,
    DischargeLaw,
    DrawLaw,
    DriveLaw,
    FilmLaw,
    GapLaw,
    HoleLaw,
    InletLaw,
    Inputs,
    LeakLaw,
    SharedCoefficients,
    SharedState,
    State,
    Waves,
    ambient_density,
    seat_contact,
)

# Sources of the feed pipe: an ideal rail that holds the measured pressure, or a rail volume with a throttle.


class Inlet(NamedTuple):
    """Mean over the step at the pipe's inlet: pressure [Pa], flow into the pipe [kg/s]."""

    pressure: float
    flow: float


@physics
def ideal_rail(c: SharedCoefficients, s: SharedState, u: Inputs, wave: float) -> Inlet:
    """The inlet holds the measured rail pressure whatever flows."""
    return Inlet(u.rail, (u.rail - wave) * c.feed_pipe.admittance)


@physics
def rail_volume(c: Coefficients, s: State, u: Inputs, wave: float) -> Inlet:
    """Rail volume, throttle and pipe: throttle loss and pipe impedance solved together.

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
    return contents(c.fuel, s.rail.mass - drawn, c.rail.volume)


# Unit of volume of `fill_sac`, in parts of a cubic metre: its products stay normal numbers in single precision.
PARTS = 1e9


class StepGeometry(NamedTuple):
    """Lifts and volumes at both ends of the step, and the step [s]."""

    old: Motion
    new: Motion
    before: Volumes
    after: Volumes
    dt: float


class AirGap(NamedTuple):
    """Air gap that the armature leaves at mid-step, and its decrease over half a step [m]."""

    middle: float
    closing: float


class SacFlows(NamedTuple):
    """Mean flows through seat and nozzle [kg/s] and the SAC's mass after the step [kg]."""

    seat: float
    nozzle: float
    mass: float


class ChamberFlows(NamedTuple):
    """Mean flows of Z-hole, A-hole and guide [kg/s] and the chamber's mass after the step [kg]."""

    z_hole: float
    a_hole: float
    leak: float
    mass: float


class AccumulationFlows(NamedTuple):
    """Mean pressure [Pa], mean flows of pipe and guide [kg/s] and the volume's mass after the step [kg]."""

    pressure: float
    pipe: float
    leak: float
    mass: float


@physics
def mean_departure_of(here: Contents, balance: Flow, before: float, after: float, dt: float) -> float:
    """Implicit mean over the step of p − p_n [Pa] in a volume; each flow's mean is q_n + s (p − p_n).

    `here`: at t_n; `balance`: Σ q at t_n, positive into the volume [kg/s], and S = −∂(Σ q)/∂p ≥ 0 [kg/(s Pa)];
    `before`, `after`: volume at both ends of the step [m³].
    """
    growth = here.density * (after - before)
    return mean_departure(balance.mass_flow, balance.slope, here.stiffness, middle(before, after), growth, dt)


@physics
def body_loads(c: Coefficients, s: State, low: float) -> Loads:
    """Forces F1…F9 of Eq. (10) at t_n."""
    return loads(
        c.plunger_needle.guides,
        c.needle_seat.area,
        s.control_chamber.fuel.pressure,
        s.accumulation.fuel.pressure,
        s.sac.pressure,
        low,
    )


@physics
def move_valve(c: Coefficients, s: State, hole: Hole, gap_cda2: float, film: float, dt: float) -> valve.State:
    """Armature and shutter after the step: Newton's second law, with F_ev of Eq. (12).

    `hole`: the A-hole; `gap_cda2`: (c_d A)² of the seat's gap at its start [m⁴]; `film`: damping coefficient of the
    squeeze film [N s/m].
    """
    pressure = seat_pressure(c, hole, gap_cda2, s.control_chamber.fuel.pressure, s.return_line.pressure)
    magnetic_force = solenoid.magnetic_force(c.solenoid, s.solenoid.pulling_flux)
    return valve.advance(c.valve, s.valve, magnetic_force, pressure, film, dt)


@physics
def magnetise(
    c: SharedCoefficients, s: SharedState, u: Inputs, gap: AirGap, drive_law: DriveLaw, dt: float
) -> tuple[solenoid.State, float]:
    """Fluxes after the step and the PWM's transistor. For both actuations.

    Eq. (11), N dφ/dt = v − R i, by the mean of dφ/dt over the step, implicit in φ; dφ_f/dt = (φ − φ_f)/τ exactly.
    """
    now = solenoid.circuit(c.solenoid, s.solenoid.flux, gap.middle, gap.closing)
    supply = drive.Supply(drive.schedule(c.drive, u.since_start, u.since_end, dt), u.trace)
    change = drive_law(c.drive, c.solenoid, s.drive, supply, now, dt)
    flux = s.solenoid.flux + dt * change.flux_rate
    rising, falling = c.delays.rising_lag_fraction, c.delays.falling_lag_fraction
    pulling = solenoid.follow_flux(s.solenoid.flux, flux, s.solenoid.pulling_flux, rising, falling)
    return solenoid.State(flux, pulling), change.conducting


@physics
def fill_sac(
    c: Coefficients, s: State, u: Inputs, upstream: float, discharge: float, geometry: StepGeometry
) -> SacFlows:
    """SAC, Eq. (3) in mass: dm/dt = q_seat − q_nozzle, by Eq. (4), the nozzle's late flow not linearised.

    The end of the step has the pressure at which the nozzle passes q, q |q| + 2 q_h q = 2 ρ (c_d A)² (p − p_cylinder),
    so that the balance is a quadratic in q. Its solution is smooth where a needle lands and the SAC empties, and where
    a needle rises and fuel fills the cavity in it.

    `upstream`: pressure in the accumulation volume [Pa]; `discharge`: discharge coefficient of the nozzle [1].
    """
    here, store, area, dt = s.sac, s.accumulation.fuel.density, c.needle_seat.area, geometry.dt
    opened = needle_seat.opening_between(geometry.old.tip, geometry.new.tip)
    volume = PARTS * (c.sac.volume + area * opened.mean)
    # what a needle displaces before it lands acts longer than half of the step, all of it if it lands at the start;
    # what it draws once it rises acts less long
    landing, shut = geometry.new.tip < geometry.old.tip, 1.0 - opened.share
    at_start = shut * shut if landing else 0.0
    acting = 1.0 + shut - at_start if landing else opened.share
    displaced = here.density * (geometry.before.sac - geometry.after.sac)
    early_rise = here.stiffness * displaced * at_start * c.sac.per_volume
    pressure = here.pressure + early_rise
    gap = seat_cda2(c, upstream, pressure, opened.mean)
    seat = jet(gap.cda2_dp, store, c.needle_seat.offset)
    through = nozzle_cda2(c, pressure, u.cylinder, discharge)
    spray = jet(through.cda2_dp, here.density, c.nozzle.offset)
    # a cavity fills as fuel in tension would, from a pressure that much lower
    tension = c.fuel.p1 * c.fuel.inverse_reference_density
    cavity = here.stiffness == 0.0
    stiffness = PARTS * (tension if cavity else here.stiffness)
    lacking = volume * (tension * here.density - c.fuel.p1 - here.pressure) if cavity else 0.0
    # weight of the step's end in its mean: the more, the stiffer the SAC
    gain, slope, growing = dt * stiffness, store * gap.cda2, here.density * through.cda2
    soft, stiff = volume * spray.root * seat.root, gain * (slope * spray.root + growing * seat.root)
    weight = (3.0 * soft + stiff) / (6.0 * soft + stiff)
    room = volume * seat.root + gain * weight * slope
    early = spray.mass_flow - weight * spray.mass_flow
    supply = lacking + stiffness * displaced * acting - volume * early_rise + gain * (seat.mass_flow - early)
    balance = 2.0 * (room * here.density * through.cda2_dp + growing * seat.root * supply)
    half = room * c.nozzle.offset + gain * weight * growing * seat.root
    size = half + math.sqrt(half * half + room * abs(balance))
    per_both = 1.0 / (room * size)  # one division for two quotients
    late = balance * room * per_both
    late = max(late, spray.mass_flow) if cavity else late
    rise = (supply - gain * weight * late) * size * per_both
    inflow = seat.mass_flow - weight * slope * (max(rise, 0.0) if cavity else rise)
    outflow = early + weight * late
    return limit_sac(c, s, u, upstream, SacFlows(inflow, outflow, here.mass + dt * (inflow - outflow)), geometry)


@physics
def limit_sac(
    c: SharedCoefficients, s: SharedState, u: Inputs, upstream: float, flows: SacFlows, geometry: StepGeometry
) -> SacFlows:
    """SAC within the limit of the linearisation; the excess is taken from the flow through the seat.

    `upstream`: pressure in the accumulation volume [Pa]; `flows`: not yet limited; the nozzle's is what remains.
    """
    here, before = s.sac, s.accumulation.fuel.density
    limited = _not_past_accumulation(here, upstream, before, flows.mass, geometry.after.sac)
    per_step = 1.0 / geometry.dt  # the same for all lanes: divided once
    inflow = flows.seat - (flows.mass - limited) * per_step
    return SacFlows(inflow, inflow - (limited - here.mass) * per_step, limited)


@physics
def _not_past_accumulation(here: Contents, upstream: float, density: float, mass: float, volume: float) -> float:
    """A SAC that draws near to the pressure of the accumulation volume stops at it, from either side.

    Linearised, Eq. (4) carries a drop of pressure over the seat that is more than four times the one at which seat and
    nozzle pass equal flows to the other side of the seat, and back again: through a wide seat the two would swing about
    one another, more and more.

    `upstream`: pressure in the accumulation volume [Pa]; `density`: there [kg/m³]; `mass`: of the SAC, not yet limited
    [kg]; `volume`: of the SAC after the step [m³].
    """
    alike = density * volume
    below, above = min(mass, max(alike, here.mass)), max(mass, min(alike, here.mass))
    return below if here.pressure <= upstream else above


@physics
def hole_flows(
    c: Coefficients, s: State, a_hole: Hole, feed: float, filling: float, gap_cda2: float
) -> tuple[Flow, Flow]:
    """Flows of Z-hole and A-hole at t_n, Eq. (4), and minus and plus their slopes in the chamber's pressure.

    The return line answers the A-hole's flow q with the pressure `filling` + Z q, or with the vapour pressure where
    that is higher; q is taken linear in it.

    `feed`: pressure in front of the Z-hole [Pa]; `filling`: pressure downstream of the valve without flow [Pa];
    `gap_cda2`: (c_d A)² of the valve's gap [m⁴].
    """
    here, hole, behind = s.control_chamber.fuel, c.control_chamber, s.return_line.pressure
    density = ambient_density(c.source, feed)
    drain = drain_cda2(c, a_hole, here.pressure, behind, gap_cda2)
    a = jet(drain.cda2_dp, here.density, hole.a_offset)
    line = here.density * drain.line_cda2
    # q = q_n + ρ (c_d A)²/root (behind − p) with p = filling + Z q, or p_v where that flow does not fill the line
    vapour = c.fuel.vapour_pressure
    at_vapour = a.mass_flow * a.root + line * (behind - vapour)
    cavity = c.return_line.impedance * at_vapour < (vapour - filling) * a.root
    per_answered = 1.0 / (a.root if cavity else a.root + c.return_line.impedance * line)
    a_flow = (at_vapour if cavity else at_vapour + line * (vapour - filling)) * per_answered
    z = orifice(z_hole_cda2(c, feed, here.pressure), density, hole.z_offset)
    return z, Flow(a_flow, here.density * drain.cda2 * per_answered)


@physics
def fill_control_chamber(s: State, holes: tuple[Flow, Flow], leak: Flow, geometry: StepGeometry) -> ChamberFlows:
    """Control chamber, Eq. (3) in mass: dm/dt = q_Z − q_A − q_leak, by Eq. (4), (4) and (5).

    `holes`: flows of `hole_flows`; `leak`: of the plunger's guide, both at t_n.
    """
    here, dt = s.control_chamber.fuel, geometry.dt
    # balance at t_n, and its slopes in the chamber's pressure
    z, a = holes
    balance = Flow(z.mass_flow - a.mass_flow - leak.mass_flow, z.slope + a.slope + leak.slope)
    # implicit mean over the step
    departure = mean_departure_of(here, balance, geometry.before.control, geometry.after.control, dt)
    z_flow = z.mass_flow - z.slope * departure
    a_flow = a.mass_flow + a.slope * departure
    leak_flow = leak.mass_flow + leak.slope * departure
    return ChamberFlows(z_flow, a_flow, leak_flow, here.mass + dt * (z_flow - a_flow - leak_flow))


@physics
def fill_accumulation(
    c: SharedCoefficients, s: SharedState, wave: float, outflow: float, leak: Flow, geometry: StepGeometry
) -> AccumulationFlows:
    """Accumulation volume, Eq. (3) in mass: dm/dt = q_pipe − q_out − q_leak. For both actuations.

    The pipe's end follows Eq. (6) by characteristics: q_pipe = (wave − p)/Z.

    `wave`: arriving in the feed pipe, its friction taken off [Pa]; `outflow`: mean flow into SAC and Z-hole, known
    before [kg/s]; `leak`: of the needle's guide at t_n, Eq. (5); none in a direct-acting injector.
    """
    here, admittance, dt = s.accumulation.fuel, c.feed_pipe.admittance, geometry.dt
    # balance at t_n, and its slopes in the volume's pressure
    pipe = (wave - here.pressure) * admittance
    balance = Flow(pipe - outflow - leak.mass_flow, admittance + leak.slope)
    # implicit mean over the step
    departure = mean_departure_of(here, balance, geometry.before.accumulation, geometry.after.accumulation, dt)
    pipe_flow = pipe - admittance * departure
    leak_flow = leak.mass_flow + leak.slope * departure
    mass = here.mass + dt * (pipe_flow - outflow - leak_flow)
    return AccumulationFlows(here.pressure + departure, pipe_flow, leak_flow, mass)


class StepLaws(NamedTuple):
    """Laws in which variants differ."""

    # motion of plunger and needle, and its lifts
    advance: Advance
    lifts: Callable[[Any], Motion]
    drive: DriveLaw  # flux rate of the solenoid's drive
    # boundary at the rail, and what it takes from the rail
    inlet: InletLaw
    draw: DrawLaw
    discharge: DischargeLaw  # discharge coefficient of the nozzle
    gap_cda2: GapLaw  # (c_d A)² of the valve's seat
    leak: LeakLaw  # leakage through a guide
    film: FilmLaw  # what the valve squeezes
    a_hole: HoleLaw  # A-hole of the control chamber


def make_step(laws: StepLaws) -> Callable[..., tuple[State, Waves]]:
    """Step of one variant: function (coefficients, state, inputs, arriving waves, dt) → (state, waves)."""
    advance, lifts, drive_law, inlet_law, draw, discharge, gap_law, leak_law, film_law, hole_law = laws

    @physics
    def step(c: Coefficients, s: State, u: Inputs, arriving: Waves, dt: float) -> tuple[State, Waves]:
        """State at t_n + dt, and the waves that leave."""
        here, behind = s.control_chamber.fuel, s.return_line.pressure
        # valve (Newton's second law) and solenoid, Eq. (11), (12)
        hole = hole_law(c.control_chamber, here.pressure, behind)
        gap_before = gap_law(c, hole, here, behind, s.valve.lift)
        moved_valve = move_valve(c, s, hole, gap_before, film_law(c.valve, s.valve), dt)
        lift = middle(s.valve.lift, moved_valve.lift)
        gap = AirGap(c.valve.lift - lift, lift - s.valve.lift)
        magnet, conducting = magnetise(c, s, u, gap, drive_law, dt)

        # plunger and needle, Eq. (10)
        body = advance(c.plunger_needle, seat_contact(c), s.body, body_loads(c, s, u.low), dt)
        old, new = lifts(s.body.z), lifts(body.z)

        # SAC: Eq. (3), (4), c_d by Eq. (9); the accumulation's pressure is extrapolated to mid-step
        store, from_inlet = s.accumulation.fuel, c.control_chamber.z_inlet_fraction
        upstream = store.pressure + 0.5 * (store.pressure - s.accumulation.pressure_before)
        reached = remembered_lift(c, s, middle(old.tip, new.tip), u.cylinder)
        # here, not above: the compiler orders as it reads, and f32 took 11 % longer with the geometry first
        gap_cda2 = gap_law(c, hole, here, behind, lift)
        geometry = StepGeometry(old, new, volumes_of(c, old), volumes_of(c, new), dt)
        passing = discharge(c.nozzle, max(reached, middle(old.tip, new.tip)), s.sac.pressure, u.cylinder)
        sac = fill_sac(c, s, u, upstream, passing, geometry)

        # feed pipe, Eq. (6), at its inlet
        arrived = feed_pipe.arrive(c.feed_pipe, s.feed_pipe, arriving.down, arriving.up)
        inlet = inlet_law(c, s, u, arrived.up)

        # control chamber: Eq. (3), (4), (5), and the return line, Eq. (6); a line of length zero is the tank itself
        feed = from_inlet * inlet.pressure + (1.0 - from_inlet) * upstream
        back = 2.0 * u.low - arriving.back if c.return_line.impedance > 0.0 else u.low
        filling = return_line.without_flow(c.return_line, s.return_line, back)
        plunger_leak = leak_law(c, c.plunger_needle.guides.plunger_gap, here.pressure, u.low)
        holes = hole_flows(c, s, hole, feed, filling, gap_cda2)
        chamber = fill_control_chamber(s, holes, plunger_leak, geometry)
        outlet = return_line.advance(c.return_line, filling, c.fuel.vapour_pressure, chamber.a_hole)

        # accumulation volume: Eq. (3), (5), and the feed pipe's end, Eq. (6)
        needle_leak = leak_law(c, c.plunger_needle.guides.needle_gap, store.pressure, u.low)
        outflow = sac.seat + (1.0 - from_inlet) * chamber.z_hole
        filled = fill_accumulation(c, s, arrived.down, outflow, needle_leak, geometry)

        drawn = dt * (inlet.flow + from_inlet * chamber.z_hole)
        ends = feed_pipe.State(inlet.flow, filled.pipe)
        away = feed_pipe.leave(c.feed_pipe, ends, inlet.pressure, filled.pressure)
        volumes = geometry.after
        after = State(
            rail=draw(c, s, drawn),
            feed_pipe=ends,
            control_chamber=control_chamber.State(contents(c.fuel, chamber.mass, volumes.control), chamber.z_hole),
            valve=moved_valve,
            solenoid=magnet,
            drive=drive.State(conducting),
            return_line=outlet,
            accumulation=needle_seat.AccumulationState(
                contents(c.fuel, filled.mass, volumes.accumulation), store.pressure
            ),
            body=body,
            sac=contents(c.fuel, sac.mass, volumes.sac),
            nozzle=nozzle.State(max(reached, new.tip), s.nozzle.injected + dt * sac.nozzle),
            cumulative_flows=CumulativeFlows(
                returned=s.cumulative_flows.returned + dt * (chamber.a_hole + chamber.leak + filled.leak),
                supplied=s.cumulative_flows.supplied + drawn,
            ),
        )
        return after, Waves(away.down, away.up, 2.0 * outlet.pressure - back)

    return step
