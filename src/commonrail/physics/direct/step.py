"""One time step of the direct-acting injector: the balances and laws are those of `step`.

As there, positions, pressures and flux stand at t_n, velocities at t_n − dt/2. Armature and needle move first under
the forces of t_n; then the flux follows with the gap of mid-step; then the SAC, the stiffest volume, is filled, and
what flows through the seat is drawn from the accumulation volume, which the feed pipe replenishes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from commonrail.physics.components import (
    accumulation,
    direct_needle,
    drive,
    feed_pipe,
    flux_decay,
    nozzle,
    sac,
    solenoid,
)
from commonrail.physics.components.plunger_needle import Motion
from commonrail.physics.connections import Volumes, middle, remembered_lift
from commonrail.physics.direct.model import Coefficients, State, accumulation_volume, moving_masses
from commonrail.physics.flow.orifice import Flow
from commonrail.physics.flow.volume import contents
from commonrail.physics.law import physics, reciprocals
from commonrail.physics.model import CumulativeFlows, Inputs, Waves
from commonrail.physics.protocols import Discharge, DriveLaw, Inlet
from commonrail.physics.setup import seat_contact
from commonrail.physics.step import AirGap, StepGeometry, advance_flux, fill_accumulation, fill_sac


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
    """Volumes that the needle leaves to the fuel; there is no control chamber."""
    return Volumes(0.0, accumulation_volume(c, lifts.tip), sac.volume(c.sac, c.needle_seat.area, lifts.tip))


@physics
def magnetise(
    c: Coefficients, s: State, u: Inputs, position: float, drive_law: DriveLaw, dt: float
) -> tuple[solenoid.State, float]:
    """Fluxes after the step, Eq. (11) and dφ_f/dt = (φ − φ_f)/τ, and the PWM's transistor.

    `position`: armature's at mid-step [m]; `dt`: step [s].
    """
    gap = AirGap(c.armature.travel - position, position - s.body.z.armature)
    flux, conducting = advance_flux(c, s, u, gap, drive_law, dt)
    mean = middle(s.solenoid.flux, flux)
    pulling = flux_decay.lagged(mean, s.solenoid.pulling_flux, c.delays.rising, c.delays.falling)
    return solenoid.State(flux, pulling), conducting


class DirectLaws(NamedTuple):
    """Laws in which variants differ: flux rate of the drive, boundary at the rail, discharge of the nozzle."""

    drive: DriveLaw
    inlet: Inlet
    discharge: Discharge


def make_step(laws: DirectLaws) -> Callable[..., tuple[State, Waves]]:
    """Step of one variant: function (coefficients, state, inputs, arriving waves, dt) → (state, waves)."""
    drive_law, inlet_law, discharge = laws

    @physics
    def step(c: Coefficients, s: State, u: Inputs, arriving: Waves, dt: float) -> tuple[State, Waves]:
        """State at t_n + dt, and the waves that leave."""
        # armature and needle (Newton's second law), and the solenoid, Eq. (11), (12)
        body = direct_needle.advance(moving_masses(c), seat_contact(c), s.body, loads(c, s), dt)
        old, new = direct_needle.lifts(s.body.z), direct_needle.lifts(body.z)
        magnet, conducting = magnetise(c, s, u, middle(old.top, new.top), drive_law, dt)
        geometry = StepGeometry(old, new, volumes_of(c, old), volumes_of(c, new), 0.0, dt)

        # SAC: Eq. (3), (4), c_d by Eq. (9)
        store = s.accumulation.fuel
        upstream = store.pressure + 0.5 * (store.pressure - s.accumulation.pressure_before)
        reached = remembered_lift(c, s, middle(old.tip, new.tip), u.cylinder)
        passing = discharge(c.nozzle, max(reached, middle(old.tip, new.tip)))
        sac_flows = fill_sac(c, s, u, upstream, passing, geometry)

        # feed pipe, Eq. (6), and accumulation volume, Eq. (3)
        arrived = feed_pipe.arrive(c.feed_pipe, s.feed_pipe, arriving.down, arriving.up)
        inlet = inlet_law(c, s, u, arrived.up)
        filled = fill_accumulation(c, s, arrived.down, sac_flows.seat, Flow(0.0, 0.0), geometry)

        ends = feed_pipe.State(inlet.flow, filled.pipe)
        away = feed_pipe.leave(c.feed_pipe, ends, inlet.pressure, filled.pressure)
        per_store, per_sac = reciprocals(geometry.after.accumulation, geometry.after.sac)
        after = State(
            feed_pipe=ends,
            solenoid=magnet,
            drive=drive.State(conducting),
            accumulation=accumulation.State(contents(c.fuel, filled.mass, per_store), store.pressure),
            body=body,
            sac=contents(c.fuel, sac_flows.mass, per_sac),
            nozzle=nozzle.State(max(reached, new.tip), s.nozzle.injected + dt * sac_flows.nozzle),
            cumulative_flows=CumulativeFlows(
                s.cumulative_flows.returned, s.cumulative_flows.supplied + dt * inlet.flow
            ),
        )
        return after, Waves(away.down, away.up, arriving.back)

    return step
