"""Equations of the injectors as a whole, dy/dt = f(t, y): method of lines, no splitting, no lag.

The same laws as the fast step's (`physics.step`), put together without its scheme: pipes are staggered finite volumes,
all pressures are taken at one time. Numbers of equations are the paper's; (3) is written in mass.

    dm/dt (control chamber) = q_Z − q_A − q_leak,plunger                                        (3)
    dm/dt (accumulation)    = q_pipe − q_seat − (1 − x) q_Z − q_leak,needle                     (3)
    dm/dt (SAC)             = q_seat − q_nozzle                                                 (3)
    q_Z, q_A, q_seat, q_nozzle: orifices (4), c_d of the nozzle (9); q_leak: guides (5)
    feed pipe and return line                                                                   (6)
    M z̈ = Σ F of plunger and needle                                                             (10)
    M ẍ = F_ev − spring + pressure + contact of armature and shutter                            Newton's law
    dm/dt (rail volume)     = −q_inlet − x q_Z                                                   (3)
    N dφ/dt = v − R i, F_ev of the solenoid                                                     (11), (12)

with x the share of the Z-hole that is fed from the pipe's inlet. A direct-acting injector has neither Z- and A-hole nor
guides; Newton's second law of armature and needle, which is not in the paper, takes the place of (10).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.base.choices import Actuation, Body, Boundary, Drive
from commonrail.physics import connections
from commonrail.physics.components import direct_needle, drive, nozzle, plunger_needle, solenoid, valve
from commonrail.physics.components.guide_friction import bench_friction
from commonrail.physics.components.plunger_needle import Motion, Nine
from commonrail.physics.direct_acting import Coefficients as DirectCoefficients
from commonrail.physics.direct_acting import moving_masses, needle_pressure
from commonrail.physics.flow import Contents, Flow, contents, jet, orifice
from commonrail.physics.law import layout_of, physics
from commonrail.physics.model import (
    Coefficients,
    CumulativeFlows,
    SharedCoefficients,
    ambient_density,
    control_volume,
    seat_contact,
)
from commonrail.physics.state_vector import Core, DirectCore, Masses, NeedleMasses, core_of, make_frame
from commonrail.physics.variants import Variant, connections_of, wiring

# Laws that the reference solves at one instant: boundaries, coil and drives, without any time step.

# Time constant with which the pressure after the valve follows the line: 1/30 of a wave's time through a cell [s].
OUTLET_TIME = 1e-7


class Outside(NamedTuple):
    """Boundary pressures [Pa], and what drives the coil: schedule, PWM's transistor, trace."""

    rail: float
    cylinder: float
    low: float
    on: float
    peak: float
    conducting: float
    trace: float


OUTSIDE = layout_of(Outside)
AT: Any = OUTSIDE.load(range(len(OUTSIDE.paths)), 0, 1)  # index of each field in an array


class Drain(NamedTuple):
    """Flow out of the control chamber [kg/s], pressure after the valve [Pa], flow into the line, rate of `outlet`."""

    flow: float
    behind: float
    line_flow: float
    outlet_rate: float


class Inlet(NamedTuple):
    """Rail pressure from outside [Pa], mass in a rail volume [kg], and flow into the feed pipe [kg/s]."""

    rail: float
    rail_mass: float
    flow: float


class Feed(NamedTuple):
    """Pressure at the feed pipe's inlet [Pa] and flow through the Z-hole [kg/s]."""

    inlet: float
    z_flow: float


@physics
def pressure_behind(c: Coefficients, outlet: float, wave: float) -> float:
    """Pressure downstream of the valve [Pa]; same arguments as `drain_flow`."""
    return max(outlet if c.return_line.impedance > 0.0 else wave, c.fuel.vapour_pressure)


@physics
def drain_flow(
    c: Coefficients, hole: connections.Hole, chamber: Contents, gap_cda2: float, outlet: float, wave: float
) -> Drain:
    """Flow through A-hole and valve, Eq. (4), and into the return line.

    A small volume of liquid at the valve's outlet, which the line's impedance fills within `OUTLET_TIME`, gives the
    pressure there; it holds the vapour pressure while liquid is missing, as the other volumes do.

    `hole`: the A-hole; `gap_cda2`: (c_d A)² of the valve's gap [m⁴]; `outlet`: state of `Core` [Pa], not used without a
    return line; `wave`: wave arriving in the line, or tank pressure without a line [Pa].
    """
    z = c.return_line.impedance
    behind = pressure_behind(c, outlet, wave)
    through = connections.drain_cda2(c, hole, chamber.pressure, behind, gap_cda2)
    flow = jet(through.cda2_dp, chamber.density, c.control_chamber.a_offset).mass_flow
    if z > 0.0:
        return Drain(flow, behind, (behind - wave) / z, (z * flow - (behind - wave)) / OUTLET_TIME)
    return Drain(flow, behind, flow, 0.0)


@physics
def coil_rates(
    c: SharedCoefficients, outside: Outside, law: Any, s: solenoid.State, gap: float, lags: tuple[float, float]
) -> solenoid.State:
    """Rates of both fluxes [V]: N dφ/dt = v − R i, Eq. (11), and dφ_f/dt = (φ − φ_f)/τ. For both actuations.

    `c`, `outside`: coefficients, and what comes from outside; `gap`: air gap that the armature leaves [m]; `lags`
    (float, float): of a rising and of a falling flux [s]; the first is zero for none.
    """
    rising, falling = lags
    now = solenoid.circuit(c.solenoid, s.flux, gap)
    supply = drive.Supply(drive.Schedule(outside.on, outside.peak), outside.trace)
    rate = law(c, outside, supply, now)
    pulling_rate = solenoid.lag_rate(s.flux, s.pulling_flux, rising, falling) if rising > 0.0 else rate
    return solenoid.State(rate, pulling_rate)


@physics
def inlet_ideal(c: Coefficients, at: Inlet, z_flow: float) -> float:
    """Pressure at the pipe's inlet: the rail's."""
    return at.rail


@physics
def inlet_throttled(c: Coefficients, at: Inlet, z_flow: float) -> float:
    """Pressure at the pipe's inlet, downstream of the rail's throttle, Eq. (4) solved for the pressure."""
    rail = contents(c.fuel, at.rail_mass, c.rail.volume)
    total = at.flow + c.control_chamber.z_inlet_fraction * z_flow
    return rail.pressure - total * abs(total) / (2.0 * rail.density * c.rail.throttle_cda2)


@physics
def feed(c: Coefficients, law: Any, at: Inlet, accumulation: float, control: float) -> Feed:
    """Pressure at the inlet, and flow through the Z-hole.

    The flow through the Z-hole depends on the inlet pressure, and with a rail volume the pressure depends on the flow:
    six iterations converge.

    `law`: `inlet_law` of a variant; `accumulation`, `control`: pressures in accumulation volume and control chamber
    [Pa].
    """
    z_flow = 0.0
    inlet = at.rail
    from_inlet = c.control_chamber.z_inlet_fraction
    for _ in range(6):
        inlet = law(c, at, z_flow)
        source = from_inlet * inlet + (1.0 - from_inlet) * accumulation
        through = connections.z_hole_cda2(c, source, control)
        z_flow = orifice(through, ambient_density(c.source, source), c.control_chamber.z_offset).mass_flow
        if from_inlet == 0.0:
            break
    return Feed(inlet, z_flow)


@physics
def past_limit(c: SharedCoefficients, peak: float, conducting: float, flux: float, gap: float) -> float:
    """Positive once the PWM's current has passed the limit at which it switches; relative to its band.

    `flux`: φ through one turn [Wb]; `gap`: air gap that the armature leaves [m]; `peak`, `conducting`: as in `Outside`.
    """
    in_peak = peak > 0.5
    mean = c.drive.peak_current if in_peak else c.drive.hold_current
    band = c.drive.peak_band if in_peak else c.drive.hold_band
    over = (solenoid.circuit(c.solenoid, flux, gap).current - mean) / band
    return (over if conducting > 0.5 else -over) - 0.5


@physics
def pwm_flux_rate(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """PWM whose transistor is set by the solver's events; after the end −boost until the current is gone."""
    live = drive.apply_voltage(c.solenoid, drive.pwm_voltage(c.drive, outside.conducting), now).flux_rate
    quenching = drive.quench(c.drive, c.solenoid, now).flux_rate
    return live if outside.on > 0.5 else quenching


def inlet_law(variant: Variant) -> Callable[..., float]:
    """Law of the pressure at the feed pipe's inlet."""
    return inlet_ideal if variant.boundary is Boundary.IDEAL else inlet_throttled


def coil_law(variant: Variant) -> Callable[..., float]:
    """Law of the coil's flux rate: the drive's law for a step of zero length; a PWM is switched by events."""
    if variant.drive is Drive.PWM:
        return pwm_flux_rate
    law = wiring(variant).drive

    @physics
    def flux_rate(c: SharedCoefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
        return law(c.drive, c.solenoid, drive.State(1.0), supply, now, 0.0).flux_rate  # type: ignore[no-any-return]

    return flux_rate


SHORTEST_LAG = 1e-9  # in place of a lag of zero in one direction [s]: the flux follows within a thousandth of a step


class Hydraulics(NamedTuple):
    """Lifts, volumes [m³], fuel in accumulation and SAC, and the greatest lift so far [m]. For both actuations."""

    lifts: Motion
    volumes: connections.Volumes
    accumulation: Contents
    sac: Contents
    reached: float


@physics
def pipe_rates(y: Any, dy: Any, cells: int, c: SharedCoefficients, inlet: float, end: float) -> None:
    """Rates of the feed pipe, Eq. (6), as flow–pressure pairs: face 0, cell 0, face 1, …, cell n−1, face n.

    `y`, `dy`: the vector and its rates; `inlet`, `end`: pressures at both ends [Pa].
    """
    z = c.feed_pipe.impedance
    per_cell = cells / c.feed_pipe.travel_time
    friction = c.feed_pipe.resistance / (z * c.feed_pipe.travel_time)
    for j in range(cells + 1):
        i = 2 * j
        q = y[i]
        left = y[i - 1] if j > 0 else inlet
        right = y[i + 1] if j < cells else end
        width = 1.0 if 0 < j < cells else 0.5
        dy[i] = -(right - left) * per_cell / (z * width) - friction * q * abs(q)
        if j < cells:
            dy[i + 1] = -(y[i + 2] - q) * per_cell * z


@physics
def return_rates(y: Any, dy: Any, place: tuple[int, int], c: Coefficients, inflow: float, low: float) -> None:
    """Rates of the return line, Eq. (6), as pressure–flow pairs: cell 0, face 1, …, cell n−1, face n at the tank.

    `y`, `dy`: the vector and its rates; `place` (int, int): first place of the line in it, and its cells; `inflow`:
    downstream of the valve [kg/s]; `low`: pressure of the tank [Pa].
    """
    z, (first, cells) = c.return_line.impedance, place
    per_cell = 2.0 * cells / c.return_line.round_trip
    for j in range(cells):
        i = first + 2 * j
        before = y[i - 1] if j > 0 else inflow
        dy[i] = -(y[i + 1] - before) * per_cell * z
        last = j == cells - 1
        behind = low if last else y[i + 2]
        dy[i + 1] = -(behind - y[i]) * per_cell / (z * (0.5 if last else 1.0))


def make_hydraulics(variant: Variant) -> Callable[..., Hydraulics]:
    """Function (coefficients, masses of fuel, greatest lift so far, positions) → `Hydraulics`."""
    lifts_of, volumes_of = wiring(variant).body.lifts, connections_of(variant).volumes

    @physics
    def hydraulics(c: SharedCoefficients, fuel: Any, reached: float, z: Any) -> Hydraulics:
        lifts = lifts_of(z)
        volumes = volumes_of(c, lifts)
        return Hydraulics(
            lifts,
            volumes,
            contents(c.fuel, fuel.accumulation, volumes.accumulation),
            contents(c.fuel, fuel.sac, volumes.sac),
            max(reached, lifts.tip),
        )

    return hydraulics  # type: ignore[no-any-return]


def make_needle_flows(variant: Variant) -> Callable[..., tuple[Flow, Flow]]:
    """Function (coefficients, hydraulics, cylinder pressure [Pa]) → flows through needle seat and nozzle."""
    discharge = wiring(variant).discharge

    @physics
    def needle_flows(c: SharedCoefficients, h: Hydraulics, cylinder: float) -> tuple[Flow, Flow]:
        seat = connections.seat_flow(c, h.accumulation, h.sac, h.lifts.tip)
        coefficient = discharge(c.nozzle, h.reached, h.sac.pressure, cylinder)
        return seat, connections.nozzle_flow(c, h.sac, cylinder, coefficient)

    return needle_flows  # type: ignore[no-any-return]


def make_rates(variant: Variant) -> Callable[..., None]:
    """Make the function (y, outside, constants, cells, friction, dy) that computes the rates of a variant."""
    return _make_direct_rates(variant) if variant.actuation is Actuation.DIRECT else _make_servo_rates(variant)


class Flows(NamedTuple):
    """Flows between the volumes [kg/s], as in the head of this module; `drain` passes A-hole and valve."""

    pipe: float
    z_hole: float
    drain: Drain
    seat: float
    nozzle: float
    plunger_leak: float
    needle_leak: float


def _make_servo_rates(variant: Variant) -> Callable[..., None]:
    wired, frame, hydraulics = wiring(variant), make_frame(variant), make_hydraulics(variant)
    load, load_outside = wired.coefficients.load, OUTSIDE.load
    load_core, store_core = core_of(variant).load, core_of(variant).store
    load_masses, store_masses = wired.positions.load, wired.positions.store
    accelerations, needle_flows = wired.accelerations, make_needle_flows(variant)
    laws = connections_of(variant).laws
    gap_law, leak_law, film_law, hole_law = laws.gap_cda2, laws.leak, laws.film, laws.a_hole
    store_accelerations = store_chain if variant.body is Body.FLEXIBLE else store_rigid
    inlet_of, coil = inlet_law(variant), coil_law(variant)

    def rates(y, outside_, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        c, outside, at = load(constants, 0, 1), load_outside(outside_, 0, 1), frame(cells)
        core, line = at.core, at.line
        s = load_core(y, core, 1)
        z, v = load_masses(y, at.body, 2), load_masses(y, at.body + 1, 2)
        h = hydraulics(c, s.fuel, s.nozzle.lift_reached, z)
        chamber = contents(c.fuel, s.fuel.control, control_volume(c, h.lifts))
        x = c.control_chamber.z_inlet_fraction
        wave = y[line] - c.return_line.impedance * y[line + 1] if cells[1] > 0 else outside.low
        behind = pressure_behind(c, s.outlet, wave)
        hole = hole_law(c.control_chamber, chamber.pressure, behind)
        gap_cda2 = gap_law(c, hole, chamber, behind, s.valve.lift)
        guides = c.plunger_needle.guides

        # flows: orifices, Eq. (4), with c_d of the nozzle by Eq. (9); guides, Eq. (5)
        entry = feed(c, inlet_of, Inlet(outside.rail, s.rail_mass, y[0]), h.accumulation.pressure, chamber.pressure)
        seat, spray = needle_flows(c, h, outside.cylinder)
        q = Flows(
            pipe=y[core - 1],
            z_hole=entry.z_flow,
            drain=drain_flow(c, hole, chamber, gap_cda2, s.outlet, wave),
            seat=seat.mass_flow,
            nozzle=spray.mass_flow,
            plunger_leak=leak_law(c, guides.plunger_gap, chamber.pressure, outside.low).mass_flow,
            needle_leak=leak_law(c, guides.needle_gap, h.accumulation.pressure, outside.low).mass_flow,
        )

        # balances of the volumes, Eq. (3)
        masses = Masses(
            control=q.z_hole - q.drain.flow - q.plunger_leak,
            accumulation=q.pipe - q.seat - (1.0 - x) * q.z_hole - q.needle_leak,
            sac=q.seat - q.nozzle,
        )
        supplied = y[0] + x * q.z_hole

        # solenoid, Eq. (11), (12); armature and shutter: Newton's second law
        lag = c.solenoid.eddy_lag
        magnet = coil_rates(c, outside, coil, s.solenoid, valve.air_gap(c.valve, s.valve), (lag, lag))
        magnetic_force = solenoid.magnetic_force(c.solenoid, s.solenoid.pulling_flux)
        pressing = connections.seat_pressure(c, hole, gap_cda2, chamber.pressure, q.drain.behind)

        # plunger and needle, Eq. (10)
        load_ = plunger_needle.loads(
            guides, c.needle_seat.area, chamber.pressure, h.accumulation.pressure, h.sac.pressure, outside.low
        )
        store_masses(dy, at.body, 2, v)
        a = accelerations(c.plunger_needle, seat_contact(c), z, v, load_)
        store_accelerations(dy, at.body, c.plunger_needle, a, v, friction)

        # lift that c_d of Eq. (9) remembers
        excess = h.sac.pressure - outside.cylinder
        remembering = connections.memory_rate(c, s.nozzle.lift_reached, h.lifts.tip, dy[line - 2], excess)

        slopes = Core(
            solenoid=magnet,
            valve=valve.rates(c.valve, s.valve, magnetic_force, pressing, film_law(c.valve, s.valve)),
            fuel=masses,
            nozzle=nozzle.State(remembering, q.nozzle),
            cumulative_flows=CumulativeFlows(q.drain.flow + q.plunger_leak + q.needle_leak, supplied),
            rail_mass=-supplied,
            outlet=q.drain.outlet_rate,
        )
        store_core(dy, core, 1, slopes)

        # pipes, Eq. (6)
        pipe_rates(y, dy, cells[0], c, entry.inlet, h.accumulation.pressure)
        return_rates(y, dy, (line, cells[1]), c, q.drain.line_flow, outside.low)

    return rates


def _make_direct_rates(variant: Variant) -> Callable[..., None]:
    """Equations of the direct-acting injector, whose guides have no friction."""
    wired, frame, hydraulics = wiring(variant), make_frame(variant), make_hydraulics(variant)
    load, load_outside = wired.coefficients.load, OUTSIDE.load
    load_core, store_core = core_of(variant).load, core_of(variant).store
    load_masses, store_masses = wired.positions.load, wired.positions.store
    accelerations, coil, needle_flows = wired.accelerations, coil_law(variant), make_needle_flows(variant)

    def rates(y, outside_, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        c, outside, at = load(constants, 0, 1), load_outside(outside_, 0, 1), frame(cells)
        s = load_core(y, at.core, 1)
        z, v = load_masses(y, at.body, 2), load_masses(y, at.body + 1, 2)
        h = hydraulics(c, s.fuel, s.nozzle.lift_reached, z)

        # flows: orifices, Eq. (4), with c_d of the nozzle by Eq. (9)
        pipe = y[at.core - 1]
        seat, spray = needle_flows(c, h, outside.cylinder)

        # solenoid, Eq. (11), (12), with a lag for either direction
        lags = max(c.solenoid.eddy_lag, SHORTEST_LAG), max(c.flux_decay.lag, SHORTEST_LAG)
        magnet = coil_rates(c, outside, coil, s.solenoid, c.armature.travel - z.armature, lags)

        # lift that c_d of Eq. (9) remembers
        excess = h.sac.pressure - outside.cylinder
        remembering = connections.memory_rate(c, s.nozzle.lift_reached, z.needle, v.needle, excess)

        slopes = DirectCore(
            solenoid=magnet,
            # balances of the volumes, Eq. (3)
            fuel=NeedleMasses(accumulation=pipe - seat.mass_flow, sac=seat.mass_flow - spray.mass_flow),
            nozzle=nozzle.State(remembering, spray.mass_flow),
            cumulative_flows=CumulativeFlows(returned=0.0, supplied=y[0]),
        )
        store_core(dy, at.core, 1, slopes)

        # armature and needle
        magnetic_force = solenoid.magnetic_force(c.solenoid, s.solenoid.pulling_flux)
        load_ = direct_needle.Loads(magnetic_force, needle_pressure(c, h.accumulation.pressure, h.sac.pressure))
        store_masses(dy, at.body, 2, v)
        store_masses(dy, at.body + 1, 2, accelerations(moving_masses(c), seat_contact(c), z, v, load_))

        # feed pipe, Eq. (6)
        pipe_rates(y, dy, cells[0], c, outside.rail, h.accumulation.pressure)

    return rates


@physics
def store_chain(dy: Any, first: int, c: plunger_needle.Coefficients, a: Nine, v: Nine, friction: Any) -> None:
    """Write the chain's accelerations, less the guides' friction, after the velocities.

    `dy`: rates; `first`: first place of plunger and needle; `a`, `v`: accelerations [m/s²] and velocities [m/s];
    `friction` (9, 2): dry friction [N] and viscous coefficient [N s/m] of the guides on each mass.
    """
    for i in range(9):
        resistance = bench_friction(friction[i, 0], friction[i, 1], v[i])
        dy[first + 2 * i + 1] = a[i] - c.per_mass[i] * resistance


@physics
def store_rigid(dy: Any, first: int, c: plunger_needle.Coefficients, a: float, v: float, friction: Any) -> None:
    """Write the acceleration of the rigid body, reduced by the friction of all masses at its speed.

    Arguments as in `store_chain`.
    """
    resistance = 0.0
    for i in range(9):
        resistance += bench_friction(friction[i, 0], friction[i, 1], v)
    dy[first + 1] = a - resistance / c.total_mass


def make_air_gap(variant: Variant) -> Callable[..., float]:
    """Function (coefficients, y, cells) → air gap that the armature leaves [m]."""
    frame, load_core, load_masses = make_frame(variant), core_of(variant).load, wiring(variant).positions.load
    if variant.actuation is Actuation.DIRECT:

        @physics
        def direct_air_gap(c: DirectCoefficients, y: Any, cells: Any) -> float:
            return c.armature.travel - load_masses(y, frame(cells).body, 2).armature  # type: ignore[no-any-return]

        return direct_air_gap

    @physics
    def air_gap(c: Coefficients, y: Any, cells: Any) -> float:
        return valve.air_gap(c.valve, load_core(y, frame(cells).core, 1).valve)

    return air_gap


def make_sac_rate(variant: Variant) -> Callable[..., float]:
    """Function (coefficients, y, cells, cylinder) → rate at which the SAC's pressure settles [1/s].

    It is the slope of seat and nozzle flow in the SAC's pressure times dp/dρ over its volume: large where the seat's
    or the holes' pressure drop is small, and the fastest rate of the hydraulics.
    """
    hydraulics, frame = make_hydraulics(variant), make_frame(variant)
    load_core, load_masses = core_of(variant).load, wiring(variant).positions.load
    needle_flows = make_needle_flows(variant)

    @physics
    def sac_rate(c: SharedCoefficients, y: Any, cells: Any, cylinder: float) -> float:
        at = frame(cells)
        s = load_core(y, at.core, 1)
        h = hydraulics(c, s.fuel, s.nozzle.lift_reached, load_masses(y, at.body, 2))
        seat, spray = needle_flows(c, h, cylinder)
        return (seat.slope + spray.slope) * h.sac.stiffness / h.volumes.sac

    return sac_rate  # type: ignore[no-any-return]
