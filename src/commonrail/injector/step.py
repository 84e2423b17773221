"""One time step of the whole injector: the one place that sees every room, and fixes their order.

Positions, pressures and flux stand at t_n, velocities at t_n − dt/2. First everything that moves is
carried to t_n + dt under the forces of t_n (leapfrog); then each volume is filled with the geometry of
mid-step, the SAC first, because it is the stiff one: what flows through the seat is its budget, and
goes on to the accumulation volume. A flow is computed once and booked on both sides, so mass is
conserved to rounding. Waves are means over a step. The variants (chain or rigid body, ideal rail or rail
volume, kind of drive) are handed in as functions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.compile import physics, reciprocals, three_reciprocals
from commonrail.flow.orifice import jet
from commonrail.flow.volume import mean_departure
from commonrail.injector.joints import (
    Room,
    drain_drive,
    guide_leak,
    make_room,
    middle,
    nozzle_drive,
    remembered_lift,
    seat_pressure,
    z_hole_drive,
)
from commonrail.injector.model import Books, Coefficients, Inputs, State, Waves
from commonrail.injector.setup import ambient_density, seat_contact
from commonrail.parts import (
    accumulation,
    control_chamber,
    drive,
    feed_pipe,
    needle_seat,
    nozzle,
    return_line,
    solenoid,
    valve,
)
from commonrail.parts.contents import Contents, contents
from commonrail.parts.plunger_needle import Loads, Motion, loads

Law = Callable[..., Any]


class Moves(NamedTuple):
    """Lifts and volumes at both ends of the step, the valve's gap (c_d A)² at mid-step [m⁴], and the step [s]."""

    old: Motion
    new: Motion
    before: Room
    after: Room
    gap: float
    dt: float


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


class StoreFlows(NamedTuple):
    """Mean pressure [Pa], mean flows of pipe and guide [kg/s] and the volume's mass after the step [kg]."""

    pressure: float
    pipe: float
    leak: float
    mass: float


@physics
def body_loads(c: Coefficients, s: State, low: float) -> Loads:
    """Pressure forces on plunger and needle at t_n."""
    return loads(
        c.plunger_needle.guides,
        c.needle_seat.area,
        s.control_chamber.fuel.pressure,
        s.accumulation.fuel.pressure,
        s.sac.pressure,
        low,
    )


@physics
def move_valve(c: Coefficients, s: State, gap: float, dt: float) -> valve.State:
    """Armature and shutter after the step.

    Parameters
    ----------
    c, s
        Coefficients and state.
    gap : float
        (c_d A)² of the seat's gap at its start [m⁴].
    dt : float
        Step [s].
    """
    pressure = seat_pressure(c, gap, s.control_chamber.fuel.pressure, s.return_line.pressure)
    return valve.advance(c.valve, s.valve, solenoid.pull(c.solenoid, s.solenoid.pulling_flux), pressure, dt)


@physics
def magnetise(
    c: Coefficients, s: State, u: Inputs, lift: float, drive_law: Law, dt: float
) -> tuple[solenoid.State, float]:
    """Flux after the step, and the PWM's transistor.

    Parameters
    ----------
    c, s, u
        Coefficients, state and inputs.
    lift : float
        Armature's at mid-step [m].
    drive_law : law
        Of the variant.
    dt : float
        Step [s].
    """
    now = solenoid.circuit(c.solenoid, s.solenoid.flux, c.valve.lift - lift, lift - s.valve.lift)
    supply = drive.Supply(drive.schedule(c.drive, u.since_start, u.since_end, dt), u.trace)
    rate = drive_law(c.drive, c.solenoid, s.drive, supply, now, dt)
    flux = s.solenoid.flux + dt * rate.flux_rate
    share = c.delays.eddy_share
    lagged = s.solenoid.pulling_flux + share * (middle(s.solenoid.flux, flux) - s.solenoid.pulling_flux)
    return solenoid.State(flux, lagged if share < 1.0 else flux), rate.conducting


@physics
def fill_sac(c: Any, s: Any, u: Inputs, upstream: float, discharge: float, moves: Moves) -> SacFlows:
    """Mean flows through seat and nozzle over the step, and the SAC's mass after it.

    Parameters
    ----------
    c, s, u
        Coefficients and state, of either actuation, and inputs.
    upstream : float
        Pressure in the accumulation volume [Pa].
    discharge : float
        Discharge coefficient of the nozzle [1].
    moves : Moves
    """
    dt = moves.dt
    tip = middle(moves.old.tip, moves.new.tip)
    gain = needle_seat.gap_drive(c.needle_seat, tip)
    before, here = s.accumulation.fuel.density, s.sac
    seat = jet(gain * (upstream - here.pressure), before, c.needle_seat.offset)
    out_drive, out_gain = nozzle_drive(c, here.pressure, u.cylinder, discharge)
    out = jet(out_drive, here.density, c.nozzle.offset)
    per_seat, per_out = reciprocals(seat.root, out.root)
    seat_slope, out_slope = before * gain * per_seat, here.density * out_gain * per_out
    growth = here.density * (moves.after.sac - moves.before.sac) / dt
    net = seat.mass_flow - out.mass_flow
    volume = middle(moves.before.sac, moves.after.sac)
    departure = mean_departure(net, seat_slope + out_slope, here.stiffness, volume, growth, dt)
    inflow = seat.mass_flow - seat_slope * departure
    outflow = out.mass_flow + out_slope * departure
    filled = here.mass + dt * (inflow - outflow)
    held = _not_past_accumulation(here, upstream, before, filled, moves.after.sac)
    inflow = inflow - (filled - held) / dt
    mass = _not_past_cylinder(c, here, u.cylinder, held, growth, moves.after.sac)
    return SacFlows(inflow, inflow - (mass - here.mass) / dt, mass)


@physics
def _not_past_accumulation(here: Contents, upstream: float, density: float, mass: float, volume: float) -> float:
    """A SAC that draws near to the pressure of the accumulation volume stops at it, from either side.

    The linearised root of Eq. (4) carries a drop of pressure that is four times its balance to the other side of the
    seat, and from there back again: through a wide seat the two would swing about one another, more and more.
    """
    alike = density * volume
    below, above = min(mass, max(alike, here.mass)), max(mass, min(alike, here.mass))
    return below if here.pressure <= upstream else above


@physics
def _not_past_cylinder(c: Any, here: Contents, cylinder: float, mass: float, growth: float, volume: float) -> float:
    """A SAC that empties stops at cylinder pressure; the linearised root of Eq. (4) would pass it."""
    rest = ambient_density(c.cylinder, cylinder) * volume
    emptying = here.pressure >= cylinder and growth <= 0.0
    return max(mass, min(rest, here.mass)) if emptying else mass


@physics
def fill_control_chamber(
    c: Coefficients, s: State, u: Inputs, feed: float, filling: float, moves: Moves
) -> ChamberFlows:
    """Mean flows of Z-hole, A-hole and guide over the step, and the chamber's mass after it.

    The return line answers the A-hole's flow q with the pressure `filling` + Z q, or with the vapour pressure where
    that is higher; q is taken linear in it.

    Parameters
    ----------
    c, s, u
        Coefficients, state and inputs.
    feed : float
        Pressure in front of the Z-hole [Pa].
    filling : float
        Pressure behind the valve without flow [Pa].
    moves : Moves
    """
    here, hole, dt = s.control_chamber.fuel, c.control_chamber, moves.dt
    density = ambient_density(c.source, feed)
    in_drive, in_gain = z_hole_drive(c, feed, here.pressure)
    inlet = jet(in_drive, density, hole.z_offset)
    behind = s.return_line.pressure
    drain = drain_drive(c, here.pressure, behind, moves.gap)
    out = jet(drain.drive, here.density, hole.a_offset)
    line = here.density * drain.line_gain
    # the line's answer divides the outflow by 1 + Z ρ gain/root; a cavity lets through no more than flows into vapour
    per_in, per_full, per_open = three_reciprocals(inlet.root, out.root + c.return_line.impedance * line, out.root)
    full = (out.mass_flow * out.root + line * (behind - filling)) * per_full
    a_flow = min(full, out.mass_flow + line * (behind - c.fuel.vapour_pressure) * per_open)
    in_slope = density * in_gain * per_in
    out_slope = here.density * drain.gain * (per_open if a_flow < full else per_full)
    leak = guide_leak(c, c.plunger_needle.guides.plunger_leak, here.pressure, u.low)
    departure = mean_departure(
        inlet.mass_flow - a_flow - leak.mass_flow,
        in_slope + out_slope + leak.slope,
        here.stiffness,
        middle(moves.before.control, moves.after.control),
        here.density * (moves.after.control - moves.before.control) / dt,
        dt,
    )
    z_flow = inlet.mass_flow - in_slope * departure
    a_flow = a_flow + out_slope * departure
    l_flow = leak.mass_flow + leak.slope * departure
    return ChamberFlows(z_flow, a_flow, l_flow, here.mass + dt * (z_flow - a_flow - l_flow))


@physics
def fill_accumulation(c: Coefficients, s: State, u: Inputs, wave: float, outflow: float, moves: Moves) -> StoreFlows:
    """Mean pressure and mean flows of pipe and guide over the step, and the accumulation volume's mass after it.

    Parameters
    ----------
    c, s, u
        Coefficients, state and inputs.
    wave : float
        Arriving in the feed pipe, its friction taken off [Pa].
    outflow : float
        Mean flow into SAC and Z-hole [kg/s].
    moves : Moves
    """
    here, admittance, dt = s.accumulation.fuel, c.feed_pipe.admittance, moves.dt
    leak = guide_leak(c, c.plunger_needle.guides.needle_leak, here.pressure, u.low)
    pipe = (wave - here.pressure) * admittance
    departure = mean_departure(
        pipe - outflow - leak.mass_flow,
        admittance + leak.slope,
        here.stiffness,
        middle(moves.before.store, moves.after.store),
        here.density * (moves.after.store - moves.before.store) / dt,
        dt,
    )
    pipe_flow = pipe - admittance * departure
    l_flow = leak.mass_flow + leak.slope * departure
    return StoreFlows(here.pressure + departure, pipe_flow, l_flow, here.mass + dt * (pipe_flow - outflow - l_flow))


class StepLaws(NamedTuple):
    """Laws in which variants differ.

    Attributes
    ----------
    advance, lifts : law
        Motion of plunger and needle, and its lifts.
    drive : law
        Flux rate of the solenoid's drive.
    inlet, draw : law
        Boundary at the rail, and what it takes from the rail.
    discharge : law
        Discharge coefficient of the nozzle.
    gap : law
        (c_d A)² of the valve's seat.
    """

    advance: Law
    lifts: Law
    drive: Law
    inlet: Law
    draw: Law
    discharge: Law
    gap: Law


def make_step(laws: StepLaws) -> Law:
    """Step of one variant: function (coefficients, state, inputs, arriving waves, dt) → (state, waves)."""
    advance, lifts, drive_law, inlet_law, draw, discharge, gap_law = laws

    @physics
    def step(c: Coefficients, s: State, u: Inputs, arriving: Waves, dt: float) -> tuple[State, Waves]:
        """State at t_n + dt, and the waves that leave."""
        here, behind = s.control_chamber.fuel, s.return_line.pressure
        moved_valve = move_valve(c, s, gap_law(c, here, behind, s.valve.lift), dt)
        lift = middle(s.valve.lift, moved_valve.lift)
        magnet, conducting = magnetise(c, s, u, lift, drive_law, dt)

        moved = advance(c.plunger_needle, seat_contact(c), s.body, body_loads(c, s, u.low), dt)
        old, new = lifts(s.body.z), lifts(moved.z)

        store, tap = s.accumulation.fuel, c.control_chamber.z_from_inlet
        upstream = store.pressure + 0.5 * (store.pressure - s.accumulation.pressure_before)
        reached = remembered_lift(c, s, middle(old.tip, new.tip), u.cylinder)
        moves = Moves(old, new, make_room(c, old), make_room(c, new), gap_law(c, here, behind, lift), dt)
        passing = discharge(c.nozzle, max(reached, middle(old.tip, new.tip)))
        out = fill_sac(c, s, u, upstream, passing, moves)

        rubbed = feed_pipe.middle_loss(c.feed_pipe, s.feed_pipe, arriving.down, arriving.up)
        wave = arriving.up + rubbed + feed_pipe.end_loss(c.feed_pipe, s.feed_pipe.inlet_flow)
        inlet = inlet_law(c, s, u, wave)
        feed = tap * inlet.pressure + (1.0 - tap) * upstream
        # a line of length zero is the tank itself
        back = 2.0 * u.low - arriving.back if c.return_line.impedance > 0.0 else u.low
        filling = return_line.without_flow(c.return_line, s.return_line, back)
        chamber = fill_control_chamber(c, s, u, feed, filling, moves)
        outlet = return_line.advance(c.return_line, filling, c.fuel.vapour_pressure, chamber.a_hole)

        wave = arriving.down - rubbed - feed_pipe.end_loss(c.feed_pipe, s.feed_pipe.end_flow)
        filled = fill_accumulation(c, s, u, wave, out.seat + (1.0 - tap) * chamber.z_hole, moves)

        drawn = dt * (inlet.flow + tap * chamber.z_hole)
        z = c.feed_pipe.impedance
        leaving = Waves(
            inlet.pressure + z * inlet.flow - feed_pipe.end_loss(c.feed_pipe, inlet.flow),
            filled.pressure - z * filled.pipe + feed_pipe.end_loss(c.feed_pipe, filled.pipe),
            2.0 * outlet.pressure - back,
        )
        per_control, per_store, per_sac = three_reciprocals(moves.after.control, moves.after.store, moves.after.sac)
        after = State(
            rail=draw(c, s, drawn),
            feed_pipe=feed_pipe.State(inlet.flow, filled.pipe),
            control_chamber=control_chamber.State(contents(c.fuel, chamber.mass, per_control), chamber.z_hole),
            valve=moved_valve,
            solenoid=magnet,
            drive=drive.State(conducting),
            return_line=outlet,
            accumulation=accumulation.State(contents(c.fuel, filled.mass, per_store), store.pressure),
            body=moved,
            sac=contents(c.fuel, out.mass, per_sac),
            nozzle=nozzle.State(max(reached, new.tip), s.nozzle.injected + dt * out.nozzle),
            books=Books(
                returned=s.books.returned + dt * (chamber.a_hole + chamber.leak + filled.leak),
                supplied=s.books.supplied + drawn,
            ),
        )
        return after, leaving

    return step
