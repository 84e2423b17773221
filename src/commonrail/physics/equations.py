"""Equations of the injectors as a whole, dy/dt = f(t, y): method of lines, no splitting, no lag.

The same laws as the fast step's (`injector.step`), put together without its scheme: pipes are staggered finite volumes,
all pressures are taken at one time. Numbers of equations are the paper's; (3) is written in mass.

    dm/dt (control chamber) = q_Z − q_A − q_leak,plunger                                        (3)
    dm/dt (accumulation)    = q_pipe − q_seat − (1 − x) q_Z − q_leak,needle                     (3)
    dm/dt (SAC)             = q_seat − q_nozzle                                                 (3)
    q_Z, q_A, q_seat, q_nozzle: orifices (4), c_d of the nozzle (9); q_leak: guides (5)
    feed pipe and return line                                                                   (6)
    M z̈ = Σ F of plunger and needle                                                             (10)
    N dφ/dt = v − R i, F_ev of the solenoid                                                     (11), (12)

with x the share of the Z-hole that is fed from the pipe's inlet. A direct-acting injector has neither Z- and A-hole nor
guides; Newton's second law of armature and needle, which is not in the paper, takes the place of (10).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.base.choices import Actuation, Body
from commonrail.physics import connections
from commonrail.physics.algebraic import (
    OUTSIDE,
    Drain,
    Inlet,
    coil_law,
    coil_rates,
    drain_flow,
    feed,
    inlet_law,
    pressure_behind,
)
from commonrail.physics.components import direct_needle, nozzle, plunger_needle, solenoid, valve
from commonrail.physics.components.chain import Nine
from commonrail.physics.components.guide_friction import bench_friction
from commonrail.physics.components.plunger_needle import Motion
from commonrail.physics.direct.model import moving_masses
from commonrail.physics.direct.step import needle_pressure
from commonrail.physics.flow.volume import Contents, contents
from commonrail.physics.law import physics
from commonrail.physics.model import Coefficients, CumulativeFlows
from commonrail.physics.setup import control_volume, seat_contact
from commonrail.physics.state_vector import Core, DirectCore, Masses, NeedleMasses, core_of, make_frame
from commonrail.physics.variants import Variant, wiring

SHORTEST_LAG = 1e-9  # in place of a lag of zero in one direction [s]: the flux follows within a thousandth of a step


class Hydraulics(NamedTuple):
    """Lifts, volumes [m³], fuel in accumulation and SAC, and the greatest lift so far [m]; of either actuation."""

    lifts: Motion
    volumes: connections.Volumes
    accumulation: Contents
    sac: Contents
    reached: float


@physics
def pipe_rates(y: Any, dy: Any, cells: int, c: Any, inlet: float, end: float) -> None:
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
    behind the valve [kg/s]; `low`: pressure of the tank [Pa].
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
    lifts_of, volumes_of = wiring(variant).body.lifts, wiring(variant).volumes

    @physics
    def hydraulics(c: Any, fuel: Any, reached: float, z: Any) -> Hydraulics:
        lifts = lifts_of(z)
        volumes = volumes_of(c, lifts)
        return Hydraulics(
            lifts,
            volumes,
            contents(c.fuel, fuel.accumulation, 1.0 / volumes.accumulation),
            contents(c.fuel, fuel.sac, 1.0 / volumes.sac),
            max(reached, lifts.tip),
        )

    return hydraulics  # type: ignore[no-any-return]


def make_rates(variant: Variant) -> Callable[..., None]:
    """Function (y, outside, constants, cells, friction, dy) of a variant of either actuation."""
    return _make_direct_rates(variant) if variant.actuation is Actuation.DIRECT else _make_servo_rates(variant)


class Flows(NamedTuple):
    """Flows between the volumes [kg/s], as in the head of this module; `drain` is that of A-hole and valve."""

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
    accelerations, discharge, gap_law = wired.accelerations, wired.laws.discharge, wired.laws.gap_cda2
    store_accelerations = store_chain if variant.body is Body.FLEXIBLE else store_rigid
    inlet_of, coil = inlet_law(variant), coil_law(variant)

    def rates(y, outside_, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        c, outside, at = load(constants, 0, 1), load_outside(outside_, 0, 1), frame(cells)
        core, line = at.core, at.line
        s = load_core(y, core, 1)
        z, v = load_masses(y, at.body, 2), load_masses(y, at.body + 1, 2)
        h = hydraulics(c, s.fuel, s.nozzle.lift_reached, z)
        chamber = contents(c.fuel, s.fuel.control, 1.0 / control_volume(c, h.lifts))
        x = c.control_chamber.z_inlet_fraction
        wave = y[line] - c.return_line.impedance * y[line + 1] if cells[1] > 0 else outside.low
        gap_cda2 = gap_law(c, chamber, pressure_behind(c, s.outlet, wave), s.valve.lift)
        guides = c.plunger_needle.guides

        # flows: orifices, Eq. (4), with c_d of the nozzle by Eq. (9); guides, Eq. (5)
        entry = feed(c, inlet_of, Inlet(outside.rail, s.rail_mass, y[0]), h.accumulation.pressure, chamber.pressure)
        q = Flows(
            pipe=y[core - 1],
            z_hole=entry.z_flow,
            drain=drain_flow(c, chamber, gap_cda2, s.outlet, wave),
            seat=connections.seat_flow(c, h.accumulation, h.sac, h.lifts.tip).mass_flow,
            nozzle=connections.nozzle_flow(c, h.sac, outside.cylinder, discharge(c.nozzle, h.reached)).mass_flow,
            plunger_leak=connections.guide_leak(c, guides.plunger_leak, chamber.pressure, outside.low).mass_flow,
            needle_leak=connections.guide_leak(c, guides.needle_leak, h.accumulation.pressure, outside.low).mass_flow,
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
        pressing = connections.seat_pressure(c, gap_cda2, chamber.pressure, q.drain.behind)

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
            valve=valve.rates(c.valve, s.valve, magnetic_force, pressing),
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
    accelerations, discharge, coil = wired.accelerations, wired.laws.discharge, coil_law(variant)

    def rates(y, outside_, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        c, outside, at = load(constants, 0, 1), load_outside(outside_, 0, 1), frame(cells)
        s = load_core(y, at.core, 1)
        z, v = load_masses(y, at.body, 2), load_masses(y, at.body + 1, 2)
        h = hydraulics(c, s.fuel, s.nozzle.lift_reached, z)

        # flows: orifices, Eq. (4), with c_d of the nozzle by Eq. (9)
        pipe = y[at.core - 1]
        seat = connections.seat_flow(c, h.accumulation, h.sac, z.needle).mass_flow
        spray = connections.nozzle_flow(c, h.sac, outside.cylinder, discharge(c.nozzle, h.reached)).mass_flow

        # solenoid, Eq. (11), (12), with a lag for either direction
        lags = max(c.solenoid.eddy_lag, SHORTEST_LAG), max(c.flux_decay.lag, SHORTEST_LAG)
        magnet = coil_rates(c, outside, coil, s.solenoid, c.armature.travel - z.armature, lags)

        # lift that c_d of Eq. (9) remembers
        excess = h.sac.pressure - outside.cylinder
        remembering = connections.memory_rate(c, s.nozzle.lift_reached, z.needle, v.needle, excess)

        slopes = DirectCore(
            solenoid=magnet,
            fuel=NeedleMasses(accumulation=pipe - seat, sac=seat - spray),  # balances, Eq. (3)
            nozzle=nozzle.State(remembering, spray),
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
    """Write the chain's accelerations, less the guides' friction, behind the velocities.

    `dy`: rates; `first`: first place of plunger and needle; `a`, `v`: accelerations [m/s²] and velocities [m/s];
    `friction` (9, 2): dry friction [N] and viscous coefficient [N s/m] of the guides on each mass.
    """
    for i in range(9):
        resistance = bench_friction(friction[i, 0], friction[i, 1], v[i])
        dy[first + 2 * i + 1] = a[i] - c.per_mass[i] * resistance


@physics
def store_rigid(dy: Any, first: int, c: plunger_needle.Coefficients, a: float, v: float, friction: Any) -> None:
    """Write the rigid body's acceleration, less the friction on all masses, whose speed is its own.

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
        def direct_air_gap(c: Any, y: Any, cells: Any) -> float:
            return c.armature.travel - load_masses(y, frame(cells).body, 2).armature  # type: ignore[no-any-return]

        return direct_air_gap

    @physics
    def air_gap(c: Any, y: Any, cells: Any) -> float:
        return valve.air_gap(c.valve, load_core(y, frame(cells).core, 1).valve)

    return air_gap


def make_sac_rate(variant: Variant) -> Callable[..., float]:
    """Function (coefficients, y, cells, cylinder) → rate at which the SAC's pressure settles [1/s].

    It is the slope of seat and nozzle flow in the SAC's pressure times dp/dρ over its volume: large where the seat's
    or the holes' pressure drop is small, and the fastest rate of the hydraulics.
    """
    hydraulics, frame = make_hydraulics(variant), make_frame(variant)
    load_core, load_masses = core_of(variant).load, wiring(variant).positions.load
    discharge = wiring(variant).laws.discharge

    @physics
    def sac_rate(c: Any, y: Any, cells: Any, cylinder: float) -> float:
        at = frame(cells)
        s = load_core(y, at.core, 1)
        h = hydraulics(c, s.fuel, s.nozzle.lift_reached, load_masses(y, at.body, 2))
        seat = connections.seat_flow(c, h.accumulation, h.sac, h.lifts.tip)
        spray = connections.nozzle_flow(c, h.sac, cylinder, discharge(c.nozzle, h.reached))
        return (seat.slope + spray.slope) * h.sac.stiffness / h.volumes.sac

    return sac_rate  # type: ignore[no-any-return]
