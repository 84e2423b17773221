"""One time step of the direct-acting injector: the one place that sees all its rooms, and fixes their order.

As in `step`: positions, pressures and flux stand at t_n, velocities at t_n − dt/2. Armature and needle move first under
the forces of t_n; then the flux follows with the gap of mid-step; then the SAC, the stiffest volume, is filled, and
what flows through the seat is drawn from the accumulation volume, which the feed pipe replenishes. A flow is computed
once and booked on both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.compile import physics, reciprocals
from commonrail.flow.volume import mean_departure
from commonrail.injector.direct_model import Coefficients, State
from commonrail.injector.direct_setup import accumulation_volume, moved
from commonrail.injector.joints import Room, middle, remembered_lift
from commonrail.injector.model import Books, Inputs, Waves
from commonrail.injector.step import Moves, StoreFlows, fill_sac
from commonrail.parts import accumulation, direct_needle, drive, feed_pipe, flux_decay, nozzle, sac, solenoid
from commonrail.parts.contents import contents

Law = Callable[..., Any]


@physics
def loads(c: Coefficients, s: State) -> direct_needle.Loads:
    """Magnetic force on the armature, and force of the pressures on the needle, at t_n."""
    pressure = s.accumulation.fuel.pressure - s.sac.pressure
    return direct_needle.Loads(solenoid.pull(c.solenoid, s.solenoid.pulling_flux), -c.needle_seat.area * pressure)


@physics
def make_room(c: Coefficients, tip: float) -> Room:
    """Volumes that the needle leaves to the fuel; there is no control chamber.

    Parameters
    ----------
    c : Coefficients
    tip : float
        Lift of the needle [m].
    """
    return Room(0.0, accumulation_volume(c, tip), sac.volume(c.sac, c.needle_seat.area, tip))


@physics
def magnetise(
    c: Coefficients, s: State, u: Inputs, position: float, drive_law: Law, dt: float
) -> tuple[solenoid.State, float]:
    """Flux after the step, and the PWM's transistor.

    Parameters
    ----------
    c, s, u
        Coefficients, state and inputs.
    position : float
        Armature's at mid-step [m].
    drive_law : law
        Of the variant.
    dt : float
        Step [s].
    """
    closing = position - s.body.z.armature
    now = solenoid.circuit(c.solenoid, s.solenoid.flux, c.armature.travel - position, closing)
    supply = drive.Supply(drive.schedule(c.drive, u.since_start, u.since_end, dt), u.trace)
    change = drive_law(c.drive, c.solenoid, s.drive, supply, now, dt)
    flux = s.solenoid.flux + dt * change.flux_rate
    mean = middle(s.solenoid.flux, flux)
    pulling = flux_decay.lagged(mean, s.solenoid.pulling_flux, c.delays.rising, c.delays.falling)
    return solenoid.State(flux, pulling), change.conducting


@physics
def fill_accumulation(c: Coefficients, s: State, wave: float, outflow: float, moves: Moves) -> StoreFlows:
    """Mean pressure and mean flow of the pipe over the step, and the accumulation volume's mass after it.

    Parameters
    ----------
    c, s
        Coefficients and state.
    wave : float
        Arriving in the feed pipe, its friction taken off [Pa].
    outflow : float
        Mean flow into the SAC [kg/s].
    moves : Moves
    """
    here, admittance, dt = s.accumulation.fuel, c.feed_pipe.admittance, moves.dt
    pipe = (wave - here.pressure) * admittance
    departure = mean_departure(
        pipe - outflow,
        admittance,
        here.stiffness,
        middle(moves.before.store, moves.after.store),
        here.density * (moves.after.store - moves.before.store) / dt,
        dt,
    )
    pipe_flow = pipe - admittance * departure
    return StoreFlows(here.pressure + departure, pipe_flow, 0.0, here.mass + dt * (pipe_flow - outflow))


class DirectLaws(NamedTuple):
    """Laws in which variants differ: flux rate of the drive, boundary at the rail, discharge of the nozzle."""

    drive: Law
    inlet: Law
    discharge: Law


def make_step(laws: DirectLaws) -> Law:
    """Step of one variant: function (coefficients, state, inputs, arriving waves, dt) → (state, waves)."""
    drive_law, inlet_law, discharge = laws

    @physics
    def step(c: Coefficients, s: State, u: Inputs, arriving: Waves, dt: float) -> tuple[State, Waves]:
        """State at t_n + dt, and the waves that leave."""
        body = direct_needle.advance(moved(c), s.body, loads(c, s), dt)
        old, new = direct_needle.lifts(s.body.z), direct_needle.lifts(body.z)
        magnet, conducting = magnetise(c, s, u, middle(old.top, new.top), drive_law, dt)

        store = s.accumulation.fuel
        upstream = store.pressure + 0.5 * (store.pressure - s.accumulation.pressure_before)
        reached = remembered_lift(c, s, middle(old.tip, new.tip), u.cylinder)
        moves = Moves(old, new, make_room(c, old.tip), make_room(c, new.tip), 0.0, dt)
        out = fill_sac(c, s, u, upstream, discharge(c.nozzle, max(reached, middle(old.tip, new.tip))), moves)

        rubbed = feed_pipe.middle_loss(c.feed_pipe, s.feed_pipe, arriving.down, arriving.up)
        wave = arriving.up + rubbed + feed_pipe.end_loss(c.feed_pipe, s.feed_pipe.inlet_flow)
        inlet = inlet_law(c, s, u, wave)
        wave = arriving.down - rubbed - feed_pipe.end_loss(c.feed_pipe, s.feed_pipe.end_flow)
        filled = fill_accumulation(c, s, wave, out.seat, moves)

        z = c.feed_pipe.impedance
        leaving = Waves(
            inlet.pressure + z * inlet.flow - feed_pipe.end_loss(c.feed_pipe, inlet.flow),
            filled.pressure - z * filled.pipe + feed_pipe.end_loss(c.feed_pipe, filled.pipe),
            arriving.back,
        )
        per_store, per_sac = reciprocals(moves.after.store, moves.after.sac)
        after = State(
            feed_pipe=feed_pipe.State(inlet.flow, filled.pipe),
            solenoid=magnet,
            drive=drive.State(conducting),
            accumulation=accumulation.State(contents(c.fuel, filled.mass, per_store), store.pressure),
            body=body,
            sac=contents(c.fuel, out.mass, per_sac),
            nozzle=nozzle.State(max(reached, new.tip), s.nozzle.injected + dt * out.nozzle),
            books=Books(s.books.returned, s.books.supplied + dt * inlet.flow),
        )
        return after, leaving

    return step
