"""Right-hand side of the whole injector for the reference engine: method of lines, no splitting, no lag.

The same laws as the lanes', put together without their scheme: pipes are staggered finite volumes, all
pressures are taken at one time. The vector is ordered so that its Jacobian is banded:
feed pipe, injector, return line.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from commonrail.choices import Body, Boundary, Drive
from commonrail.compile import kernel, physics
from commonrail.flow.orifice import jet, orifice
from commonrail.injector import joints
from commonrail.injector.model import Coefficients
from commonrail.injector.setup import ambient_density, seat_contact
from commonrail.injector.variants import Variant, wiring
from commonrail.parts import drive, needle_seat, plunger_needle, rigid_body, solenoid, valve
from commonrail.parts.contents import contents
from commonrail.parts.plunger_needle import Motion, Nine

CORE = (
    "flux",
    "pulling_flux",
    "valve_lift",
    "valve_velocity",
    "control_mass",
    "store_mass",
    "sac_mass",
    "lift_reached",
    "injected",
    "returned",
    "supplied",
    "rail_mass",
)
RESET_TIME = 1e-7  # the memory of the greatest lift fades this fast on a seated, relaxed needle [s]
FRICTION_SPEED = 1e-2  # Coulomb friction is full above this speed [m/s]


class Outside(NamedTuple):
    """Boundary pressures [Pa], and what drives the coil: schedule, PWM's transistor, trace."""

    rail: float
    cylinder: float
    low: float
    on: float
    peak: float
    conducting: float
    trace: float


class Drain(NamedTuple):
    """Flow out of the control chamber [kg/s] and the pressure behind the valve [Pa]."""

    flow: float
    behind: float


class Feed(NamedTuple):
    """Pressure at the feed pipe's inlet [Pa] and flow through the Z-hole [kg/s]."""

    inlet: float
    z_flow: float


class Coil(NamedTuple):
    """dφ/dt [V] and dφ_f/dt [V]."""

    flux: float
    pulling: float


@physics
def drain_flow(c: Coefficients, pressure: float, density: float, lift: float, wave: float) -> Drain:
    """Flow through A-hole and valve into a return line whose arriving wave is known, by Newton's iteration."""
    behind = wave
    flow = 0.0
    for _ in range(4):
        d = joints.drain_drive(c, pressure, behind, lift)
        out = jet(d.drive, density, c.control_chamber.a_offset)
        line = density * d.line_gain
        flow = (out.mass_flow * out.root + line * (behind - wave)) / (out.root + c.return_line.impedance * line)
        behind = max(wave + c.return_line.impedance * flow, c.fuel.vapour_pressure)
    return Drain(flow, behind)


@physics
def coil_rates(c: Coefficients, outside: Outside, law: Any, flux: float, pulling: float, lift: float) -> Coil:
    """Rates of both fluxes."""
    now = solenoid.circuit(c.solenoid, flux, c.valve.lift - lift)
    supply = drive.Supply(drive.Schedule(outside.on, outside.peak), outside.trace)
    rate = law(c, outside, supply, now)
    lag = c.solenoid.eddy_lag
    return Coil(rate, (flux - pulling) / lag if lag > 0.0 else rate)


@physics
def inlet_ideal(c: Coefficients, outside: Outside, rail_mass: float, flow: float, z_flow: float) -> float:
    """Pressure at the pipe's inlet: the rail's."""
    return outside.rail


@physics
def inlet_throttled(c: Coefficients, outside: Outside, rail_mass: float, flow: float, z_flow: float) -> float:
    """Pressure at the pipe's inlet behind the rail's throttle, Eq. (4) solved for the pressure."""
    rail = contents(c.fuel, rail_mass, 1.0 / c.rail.volume)
    total = flow + c.control_chamber.z_from_inlet * z_flow
    return rail.pressure - total * abs(total) / (2.0 * rail.density * c.rail.throttle)


@physics
def feed(c: Coefficients, outside: Outside, law: Any, rail_mass: float, flow: float, store: float, low: float) -> Feed:
    """Inlet and Z-hole of a chamber at pressure `low`, fed from the inlet or from the accumulation at `store` [Pa].

    The Z-hole's flow needs the inlet's pressure, which (rail volume) needs that flow: six rounds converge.
    """
    z_flow = 0.0
    inlet = outside.rail
    tap = c.control_chamber.z_from_inlet
    for _ in range(6):
        inlet = law(c, outside, rail_mass, flow, z_flow)
        source = tap * inlet + (1.0 - tap) * store
        z_drive, _ = joints.z_hole_drive(c, source, low)
        z_flow = jet(z_drive, ambient_density(c.source, source), c.control_chamber.z_offset).mass_flow
        if tap == 0.0:
            break
    return Feed(inlet, z_flow)


@physics
def past_limit(c: Coefficients, peak: float, conducting: float, flux: float, lift: float) -> float:
    """Positive once the PWM's current has passed the limit at which it switches; relative to its band."""
    in_peak = peak > 0.5
    mean = c.drive.peak_current if in_peak else c.drive.hold_current
    band = c.drive.peak_band if in_peak else c.drive.hold_band
    over = (solenoid.circuit(c.solenoid, flux, c.valve.lift - lift).current - mean) / band
    return (over if conducting > 0.5 else -over) - 0.5


@physics
def regulated(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """Ideal regulator."""
    return drive.regulated(c.drive, c.solenoid, drive.State(1.0), supply, now, 0.0).flux_rate


@physics
def switched(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """PWM whose transistor is set by the solver's events; after the end −boost until the current is gone."""
    live = drive.applied(c.solenoid, drive.pwm_voltage(c.drive, outside.conducting), now).flux_rate
    off = drive.switched_off(c.drive, c.solenoid, now).flux_rate
    return live if outside.on > 0.5 else off


@physics
def by_voltage(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """Measured voltage."""
    return drive.applied(c.solenoid, supply.trace, now).flux_rate


@physics
def by_current(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """Measured current."""
    return drive.current_trace(c.drive, c.solenoid, drive.State(1.0), supply, now, 0.0).flux_rate


@physics
def pipe_rates(y: Any, dy: Any, first: int, cells: int, c: Coefficients, inlet: float, end: float) -> None:
    """Feed pipe, Eq. (6), as flow–pressure pairs: face 0, cell 0, face 1, …, cell n−1, face n."""
    z = c.feed_pipe.impedance
    per_cell = cells / c.feed_pipe.travel_time
    friction = c.feed_pipe.resistance / (z * c.feed_pipe.travel_time)
    for j in range(cells + 1):
        i = first + 2 * j
        q = y[i]
        left = y[i - 1] if j > 0 else inlet
        right = y[i + 1] if j < cells else end
        width = 1.0 if 0 < j < cells else 0.5
        dy[i] = -(right - left) * per_cell / (z * width) - friction * q * abs(q)
        if j < cells:
            dy[i + 1] = -(y[i + 2] - q) * per_cell * z


@physics
def return_rates(y: Any, dy: Any, first: int, cells: int, c: Coefficients, inflow: float, low: float) -> None:
    """Return line as pressure–flow pairs: cell 0, face 1, …, cell n−1, face n at the tank."""
    z = c.return_line.impedance
    per_cell = 2.0 * cells / c.return_line.round_trip
    for j in range(cells):
        i = first + 2 * j
        before = y[i - 1] if j > 0 else inflow
        dy[i] = -(y[i + 1] - before) * per_cell * z
        last = j == cells - 1
        behind = low if last else y[i + 2]
        dy[i + 1] = -(behind - y[i]) * per_cell / (z * (0.5 if last else 1.0))


@physics
def friction_force(coulomb: float, viscous: float, speed: float) -> float:
    """Guide friction against the motion [N]: Coulomb, rounded at standstill, and viscous. Not in the paper's model."""
    return coulomb * math.tanh(speed / FRICTION_SPEED) + viscous * speed


@functools.cache
def compiled_rates(variant: Variant) -> Callable[..., None]:
    """Function (y, outside, constants, cells, friction, dy) of a variant, compiled."""
    return kernel(make_rates(variant), f"rates: {variant.label}")  # type: ignore[no-any-return]


def inlet_law(variant: Variant) -> Callable[..., float]:
    """Law of the pressure at the feed pipe's inlet."""
    return inlet_ideal if variant.boundary is Boundary.IDEAL else inlet_throttled


def tip_index(variant: Variant) -> int:
    """Where the needle's tip stands after the first entry of the core."""
    return len(CORE) + (16 if variant.body is Body.FLEXIBLE else 0)


def make_rates(variant: Variant) -> Callable[..., None]:
    """Function (y, outside, constants, cells, friction, dy) of a variant."""
    load = wiring(variant).coefficients.load
    flexible = variant.body is Body.FLEXIBLE
    inlet = inlet_law(variant)
    coil_law = {
        Drive.REGULATED: regulated,
        Drive.PWM: switched,
        Drive.VOLTAGE: by_voltage,
        Drive.CURRENT: by_current,
    }[variant.drive]
    body_rates = _flexible_rates if flexible else _rigid_rates
    lifts = _flexible_lifts if flexible else _rigid_lifts
    masses = 9 if flexible else 1

    def rates(y, outside_, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        c = load(constants, 0, 1, 0)
        outside = Outside(outside_[0], outside_[1], outside_[2], outside_[3], outside_[4], outside_[5], outside_[6])
        core = 2 * cells[0] + 1
        body = core + 12
        line = body + 2 * masses
        tops = lifts(y, body)
        room = joints.make_room(c, tops)
        chamber = contents(c.fuel, y[core + 4], 1.0 / room.control)
        store = contents(c.fuel, y[core + 5], 1.0 / room.store)
        sac = contents(c.fuel, y[core + 6], 1.0 / room.sac)

        gain = needle_seat.gap_drive(c.needle_seat, tops.tip)
        seat = jet(gain * (store.pressure - sac.pressure), store.density, c.needle_seat.offset)
        reached = max(y[core + 7], tops.tip)
        spray_drive, _ = joints.nozzle_drive(c, sac.pressure, outside.cylinder, reached)
        spray = jet(spray_drive, sac.density, c.nozzle.offset)

        wave = y[line] - c.return_line.impedance * y[line + 1] if cells[1] > 0 else outside.low
        drain = drain_flow(c, chamber.pressure, chamber.density, y[core + 2], wave)

        entry = feed(c, outside, inlet, y[core + 11], y[0], store.pressure, chamber.pressure)
        guides = c.plunger_needle.guides
        plunger_leak = joints.guide_leak(c, guides.plunger_leak, chamber.pressure, outside.low).mass_flow
        needle_leak = joints.guide_leak(c, guides.needle_leak, store.pressure, outside.low).mass_flow

        coil = coil_rates(c, outside, coil_law, y[core], y[core + 1], y[core + 2])
        valve_gap = valve.gap_drive(c.valve, y[core + 2])
        pressing = joints.seat_pressure(c, valve_gap, chamber.pressure, drain.behind)
        pull = solenoid.pull(c.solenoid, y[core + 1])
        force, damping = valve.forces(c.valve, y[core + 2], pull, pressing)

        relaxed = tops.tip <= 0.0 and sac.pressure - outside.cylinder < joints.RELAXED
        rising = tops.tip >= y[core + 7]
        dy[core] = coil.flux
        dy[core + 1] = coil.pulling
        dy[core + 2] = y[core + 3]
        dy[core + 3] = c.valve.per_mass * (force - damping * y[core + 3])
        dy[core + 4] = entry.z_flow - drain.flow - plunger_leak
        tap = c.control_chamber.z_from_inlet
        dy[core + 5] = y[2 * cells[0]] - seat.mass_flow - (1.0 - tap) * entry.z_flow - needle_leak
        dy[core + 6] = seat.mass_flow - spray.mass_flow
        dy[core + 8] = spray.mass_flow
        dy[core + 9] = drain.flow + plunger_leak + needle_leak
        dy[core + 10] = y[0] + tap * entry.z_flow
        dy[core + 11] = -dy[core + 10]
        load_ = plunger_needle.loads(
            guides, c.needle_seat.area, chamber.pressure, store.pressure, sac.pressure, outside.low
        )
        body_rates(c, y, dy, body, load_, friction)
        speed = dy[line - 2]
        dy[core + 7] = -y[core + 7] / RESET_TIME if relaxed else (max(speed, 0.0) if rising else 0.0)
        pipe_rates(y, dy, 0, cells[0], c, entry.inlet, store.pressure)
        return_rates(y, dy, line, cells[1], c, drain.flow, outside.low)

    return rates


def make_sac_rate(variant: Variant) -> Callable[..., float]:
    """Function (coefficients, y, cells, cylinder) → rate at which the SAC's pressure settles [1/s].

    It is the slope of seat and nozzle flow in the SAC's pressure times dp/dρ over its volume: large where the seat's
    or the holes' pressure drop is small, and the fastest rate of the hydraulics.
    """
    flexible = variant.body is Body.FLEXIBLE
    lifts = _flexible_lifts if flexible else _rigid_lifts

    @physics
    def sac_rate(c: Coefficients, y: Any, cells: Any, cylinder: float) -> float:
        core = 2 * cells[0] + 1
        tops = lifts(y, core + len(CORE))
        room = joints.make_room(c, tops)
        store = contents(c.fuel, y[core + 5], 1.0 / room.store)
        sac = contents(c.fuel, y[core + 6], 1.0 / room.sac)
        gain = needle_seat.gap_drive(c.needle_seat, tops.tip)
        seat = orifice(gain * (store.pressure - sac.pressure), gain, store.density, c.needle_seat.offset)
        drive_, gain_ = joints.nozzle_drive(c, sac.pressure, cylinder, max(y[core + 7], tops.tip))
        spray = orifice(drive_, gain_, sac.density, c.nozzle.offset)
        return (seat.slope + spray.slope) * sac.stiffness / room.sac

    return sac_rate  # type: ignore[no-any-return]


@physics
def _flexible_lifts(y: Any, body: int) -> Motion:
    return Motion(y[body], y[body + 14], y[body + 16])


@physics
def _rigid_lifts(y: Any, body: int) -> Motion:
    return Motion(y[body], y[body], y[body])


@physics
def _flexible_rates(c: Coefficients, y: Any, dy: Any, body: int, load: Any, friction: Any) -> None:
    """Position and velocity of each mass side by side, so that the Jacobian stays narrow."""
    b = body
    z = Nine(y[b], y[b + 2], y[b + 4], y[b + 6], y[b + 8], y[b + 10], y[b + 12], y[b + 14], y[b + 16])
    v = Nine(y[b + 1], y[b + 3], y[b + 5], y[b + 7], y[b + 9], y[b + 11], y[b + 13], y[b + 15], y[b + 17])
    a = plunger_needle.accelerations(c.plunger_needle, seat_contact(c), z, v, load)
    m = c.plunger_needle.per_mass
    for i in range(9):
        dy[b + 2 * i] = v[i]
        dy[b + 2 * i + 1] = a[i] - m[i] * friction_force(friction[i, 0], friction[i, 1], v[i])


@physics
def _rigid_rates(c: Coefficients, y: Any, dy: Any, body: int, load: Any, friction: Any) -> None:
    dy[body] = y[body + 1]
    dy[body + 1] = rigid_body.acceleration(c.plunger_needle, seat_contact(c), y[body], y[body + 1], load)


def start_vector(variant: Variant, c: Coefficients, state: Any, cells: tuple[int, int], at: Any) -> Any:
    """State at rest as the vector of the rates."""
    pipe = np.empty(2 * cells[0] + 1)
    pipe[0::2], pipe[1::2] = 0.0, at.rail
    core = [
        0.0,
        0.0,
        state.valve.lift,
        0.0,
        state.control_chamber.fuel.mass,
        state.accumulation.fuel.mass,
        state.sac.mass,
        0.0,
        0.0,
        0.0,
        0.0,
        state.rail.mass,
    ]
    z = state.body.z if variant.body is Body.FLEXIBLE else (state.body.z,)
    body = np.zeros(2 * len(z))
    body[0::2] = z
    line = np.empty(2 * cells[1])
    line[0::2], line[1::2] = at.low, 0.0
    return np.concatenate((pipe, core, body, line))


__all__ = [
    "CORE",
    "Outside",
    "compiled_rates",
    "feed",
    "inlet_law",
    "make_rates",
    "make_sac_rate",
    "past_limit",
    "start_vector",
    "tip_index",
]
