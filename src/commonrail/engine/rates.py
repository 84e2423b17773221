"""Right-hand side of the whole injector for the reference engine: method of lines, no splitting, no lag.

The same laws as the lanes', put together without their scheme: pipes are staggered finite volumes, all
pressures are taken at one time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.choices import Body
from commonrail.compile import physics
from commonrail.engine.instant import (
    OUTSIDE,
    Inlet,
    coil_law,
    coil_rates,
    drain_flow,
    feed,
    friction_force,
    inlet_law,
    pressure_behind,
)
from commonrail.engine.vector import CORE, ROW, Core, Masses, make_frame
from commonrail.flow.orifice import jet, orifice
from commonrail.injector import joints
from commonrail.injector.layout import layout_of
from commonrail.injector.model import Books, Coefficients
from commonrail.injector.setup import seat_contact
from commonrail.injector.variants import Variant, wiring
from commonrail.parts import needle_seat, nozzle, plunger_needle, solenoid, valve
from commonrail.parts.chain import Nine
from commonrail.parts.contents import Contents, contents
from commonrail.parts.plunger_needle import Motion

__all__ = ["make_hydraulics", "make_rates", "make_sac_rate"]


class Hydraulics(NamedTuple):
    """Lifts, fuel in the three volumes, their sizes [m³], and the greatest lift so far [m]."""

    lifts: Motion
    room: joints.Room
    chamber: Contents
    store: Contents
    sac: Contents
    reached: float


@physics
def pipe_rates(y: Any, dy: Any, cells: int, c: Any, inlet: float, end: float) -> None:
    """Rates of the feed pipe, Eq. (6), as flow–pressure pairs: face 0, cell 0, face 1, …, cell n−1, face n.

    Parameters
    ----------
    y, dy : array
        The vector and its rates.
    cells : int
    c : Coefficients
    inlet, end : float
        Pressures at both ends [Pa].
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
    """Rates of the return line as pressure–flow pairs: cell 0, face 1, …, cell n−1, face n at the tank.

    Parameters
    ----------
    y, dy : array
        The vector and its rates.
    place : (int, int)
        First place of the line in it, and its cells.
    c : Coefficients
    inflow : float
        Behind the valve [kg/s].
    low : float
        Pressure of the tank [Pa].
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
    lifts_of = wiring(variant).body.lifts

    @physics
    def hydraulics(c: Coefficients, fuel: Masses, reached: float, z: Any) -> Hydraulics:
        lifts = lifts_of(z)
        room = joints.make_room(c, lifts)
        return Hydraulics(
            lifts,
            room,
            contents(c.fuel, fuel.control, 1.0 / room.control),
            contents(c.fuel, fuel.store, 1.0 / room.store),
            contents(c.fuel, fuel.sac, 1.0 / room.sac),
            max(reached, lifts.tip),
        )

    return hydraulics  # type: ignore[no-any-return]


def make_rates(variant: Variant) -> Callable[..., None]:
    """Function (y, outside, constants, cells, friction, dy) of a variant."""
    wired, frame, hydraulics = wiring(variant), make_frame(variant), make_hydraulics(variant)
    load, store_core, load_outside = wired.coefficients.load, CORE.store, OUTSIDE.load
    load_fuel, load_coil, load_valve = (layout_of(kind).load for kind in (Masses, solenoid.State, valve.State))
    load_masses, store_masses = wired.positions.load, wired.positions.store
    accelerations, discharge, gap_law = wired.accelerations, wired.laws.discharge, wired.laws.gap
    store_accelerations = store_rubbed if variant.body is Body.FLEXIBLE else store_rigid
    inlet, coil = inlet_law(variant), coil_law(variant)
    row = ROW

    # The compiler sums in the order in which it reads: each state is read where it is used.
    def rates(y, outside_, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        c, outside, at = load(constants, 0, 1), load_outside(outside_, 0, 1), frame(cells)
        core, line = at.core, at.line
        fuel = load_fuel(y, core + row.fuel.control, 1)
        lifts, _, chamber, store, sac, reached = hydraulics(
            c, fuel, y[core + row.nozzle.lift_reached], load_masses(y, at.body, 2)
        )
        gain = needle_seat.gap_drive(c.needle_seat, lifts.tip)
        seat = jet(gain * (store.pressure - sac.pressure), store.density, c.needle_seat.offset).mass_flow
        spray_drive, _ = joints.nozzle_drive(c, sac.pressure, outside.cylinder, discharge(c.nozzle, reached))
        spray = jet(spray_drive, sac.density, c.nozzle.offset).mass_flow

        wave = y[line] - c.return_line.impedance * y[line + 1] if cells[1] > 0 else outside.low
        behind = pressure_behind(c, y[core + row.outlet], wave)
        gap = gap_law(c, chamber, behind, y[core + row.valve.lift])
        drain = drain_flow(c, chamber, gap, y[core + row.outlet], wave)

        tap = c.control_chamber.z_from_inlet
        supply = Inlet(outside.rail, y[core + row.rail_mass], y[0])
        entry = feed(c, inlet, supply, store.pressure, chamber.pressure)
        guides = c.plunger_needle.guides
        plunger_leak = joints.guide_leak(c, guides.plunger_leak, chamber.pressure, outside.low).mass_flow
        needle_leak = joints.guide_leak(c, guides.needle_leak, store.pressure, outside.low).mass_flow

        magnet, moving = load_coil(y, core + row.solenoid.flux, 1), load_valve(y, core + row.valve.lift, 1)
        pressing = joints.seat_pressure(c, gap, chamber.pressure, drain.behind)
        supplied = y[0] + tap * entry.z_flow
        slopes = Core(
            solenoid=coil_rates(c, outside, coil, magnet, valve.air_gap(c.valve, moving)),
            valve=valve.rates(c.valve, moving, solenoid.pull(c.solenoid, magnet.pulling_flux), pressing),
            fuel=Masses(
                control=entry.z_flow - drain.flow - plunger_leak,
                store=y[core - 1] - seat - (1.0 - tap) * entry.z_flow - needle_leak,
                sac=seat - spray,
            ),
            nozzle=nozzle.State(0.0, spray),
            books=Books(returned=drain.flow + plunger_leak + needle_leak, supplied=supplied),
            rail_mass=-supplied,
            outlet=drain.outlet_rate,
        )
        store_core(dy, core, 1, slopes)

        load_ = plunger_needle.loads(
            guides, c.needle_seat.area, chamber.pressure, store.pressure, sac.pressure, outside.low
        )
        z, v = load_masses(y, at.body, 2), load_masses(y, at.body + 1, 2)
        store_masses(dy, at.body, 2, v)
        a = accelerations(c.plunger_needle, seat_contact(c), z, v, load_)
        store_accelerations(dy, at.body, c.plunger_needle, a, v, friction)

        reached, rise = y[core + row.nozzle.lift_reached], dy[line - 2]
        rate = joints.memory_rate(c, reached, lifts.tip, rise, sac.pressure - outside.cylinder)
        dy[core + row.nozzle.lift_reached] = rate
        pipe_rates(y, dy, cells[0], c, entry.inlet, store.pressure)
        return_rates(y, dy, (line, cells[1]), c, drain.line_flow, outside.low)

    return rates


@physics
def store_rubbed(dy: Any, first: int, c: plunger_needle.Coefficients, a: Nine, v: Nine, friction: Any) -> None:
    """Write the chain's accelerations, less the guides' friction, behind the velocities.

    Parameters
    ----------
    dy : array
        Rates.
    first : int
        First place of plunger and needle.
    c : Coefficients
    a, v : Nine
        Accelerations [m/s²] and velocities [m/s].
    friction : (9, 2)
        Coulomb force [N] and viscous coefficient [N s/m] of the guides on each mass.
    """
    for i in range(9):
        rubbing = friction_force(friction[i, 0], friction[i, 1], v[i])
        dy[first + 2 * i + 1] = a[i] - c.per_mass[i] * rubbing


@physics
def store_rigid(dy: Any, first: int, c: plunger_needle.Coefficients, a: float, v: float, friction: Any) -> None:
    """Write the rigid body's acceleration, less the friction on all masses, whose speed is its own.

    Parameters
    ----------
    dy, first, c, a, v, friction
        As of `store_rubbed`.
    """
    rubbing = 0.0
    for i in range(9):
        rubbing += friction_force(friction[i, 0], friction[i, 1], v)
    dy[first + 1] = a - rubbing / c.total_mass


def make_sac_rate(variant: Variant) -> Callable[..., float]:
    """Function (coefficients, y, cells, cylinder) → rate at which the SAC's pressure settles [1/s].

    It is the slope of seat and nozzle flow in the SAC's pressure times dp/dρ over its volume: large where the seat's
    or the holes' pressure drop is small, and the fastest rate of the hydraulics.
    """
    hydraulics, frame = make_hydraulics(variant), make_frame(variant)
    load_core, load_masses = CORE.load, wiring(variant).positions.load
    discharge = wiring(variant).laws.discharge

    @physics
    def sac_rate(c: Coefficients, y: Any, cells: Any, cylinder: float) -> float:
        at = frame(cells)
        s = load_core(y, at.core, 1)
        h = hydraulics(c, s.fuel, s.nozzle.lift_reached, load_masses(y, at.body, 2))
        gain = needle_seat.gap_drive(c.needle_seat, h.lifts.tip)
        seat = orifice(gain * (h.store.pressure - h.sac.pressure), gain, h.store.density, c.needle_seat.offset)
        drive_, gain_ = joints.nozzle_drive(c, h.sac.pressure, cylinder, discharge(c.nozzle, h.reached))
        spray = orifice(drive_, gain_, h.sac.density, c.nozzle.offset)
        return (seat.slope + spray.slope) * h.sac.stiffness / h.room.sac

    return sac_rate  # type: ignore[no-any-return]
