"""Right-hand side of the whole injector for the reference engine: method of lines, no splitting, no lag.

The same laws as the lanes', put together without their scheme: pipes are staggered finite volumes, all
pressures are taken at one time.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.choices import Body
from commonrail.compile import kernel, physics
from commonrail.engine.instant import (
    OUTSIDE,
    Inlet,
    coil_law,
    coil_rates,
    drain_flow,
    feed,
    friction_force,
    inlet_law,
)
from commonrail.engine.vector import CORE, Core, Masses, make_frame
from commonrail.flow.orifice import jet, orifice
from commonrail.injector import joints
from commonrail.injector.model import Books, Coefficients
from commonrail.injector.setup import seat_contact
from commonrail.injector.variants import Variant, wiring
from commonrail.parts import needle_seat, nozzle, plunger_needle, solenoid, valve
from commonrail.parts.contents import Contents, contents
from commonrail.parts.plunger_needle import Motion

__all__ = ["compiled_rates", "make_hydraulics", "make_rates", "make_sac_rate"]

RESET_TIME = 1e-7  # the memory of the greatest lift fades this fast on a seated, relaxed needle [s]


class Hydraulics(NamedTuple):
    """Lifts, fuel in the three volumes, their sizes [m³], and the greatest lift so far [m]."""

    lifts: Motion
    room: joints.Room
    chamber: Contents
    store: Contents
    sac: Contents
    reached: float


@physics
def pipe_rates(y: Any, dy: Any, cells: int, c: Coefficients, inlet: float, end: float) -> None:
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
def return_rates(y: Any, dy: Any, first: int, c: Coefficients, inflow: float, low: float) -> None:
    """Rates of the return line as pressure–flow pairs: cell 0, face 1, …, cell n−1, face n at the tank.

    Parameters
    ----------
    y, dy : array
        The vector and its rates.
    first : int
        First place of the line in it.
    c : Coefficients
    inflow : float
        Through the valve [kg/s].
    low : float
        Pressure of the tank [Pa].
    """
    z, cells = c.return_line.impedance, (len(y) - first) // 2
    per_cell = 2.0 * cells / c.return_line.round_trip
    for j in range(cells):
        i = first + 2 * j
        before = y[i - 1] if j > 0 else inflow
        dy[i] = -(y[i + 1] - before) * per_cell * z
        last = j == cells - 1
        behind = low if last else y[i + 2]
        dy[i + 1] = -(behind - y[i]) * per_cell / (z * (0.5 if last else 1.0))


@functools.cache
def compiled_rates(variant: Variant) -> Callable[..., None]:
    """Function (y, outside, constants, cells, friction, dy) of a variant, compiled."""
    return kernel(make_rates(variant), f"rates: {variant.label}")  # type: ignore[no-any-return]


def make_hydraulics(variant: Variant) -> Callable[..., Hydraulics]:
    """Function (coefficients, core, positions) → `Hydraulics`."""
    lifts_of = wiring(variant).body.lifts

    @physics
    def hydraulics(c: Coefficients, s: Core, z: Any) -> Hydraulics:
        lifts = lifts_of(z)
        room = joints.make_room(c, lifts)
        return Hydraulics(
            lifts,
            room,
            contents(c.fuel, s.fuel.control, 1.0 / room.control),
            contents(c.fuel, s.fuel.store, 1.0 / room.store),
            contents(c.fuel, s.fuel.sac, 1.0 / room.sac),
            max(s.nozzle.lift_reached, lifts.tip),
        )

    return hydraulics  # type: ignore[no-any-return]


def make_rates(variant: Variant) -> Callable[..., None]:
    """Function (y, outside, constants, cells, friction, dy) of a variant."""
    wired, frame, hydraulics = wiring(variant), make_frame(variant), make_hydraulics(variant)
    load, load_core, store_core, load_outside = wired.coefficients.load, CORE.load, CORE.store, OUTSIDE.load
    load_masses, store_masses = wired.positions.load, wired.positions.store
    lifts_of, accelerations = wired.body.lifts, wired.body.accelerations
    rubs = variant.body is Body.FLEXIBLE
    inlet, coil = inlet_law(variant), coil_law(variant)

    def rates(y, outside_, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        c, outside, at = load(constants, 0, 1), load_outside(outside_, 0, 1), frame(cells)
        s = load_core(y, at.core, 1)
        z, v = load_masses(y, at.body, 2), load_masses(y, at.body + 1, 2)
        lifts, _, chamber, store, sac, reached = hydraulics(c, s, z)

        gain = needle_seat.gap_drive(c.needle_seat, lifts.tip)
        seat = jet(gain * (store.pressure - sac.pressure), store.density, c.needle_seat.offset).mass_flow
        spray_drive, _ = joints.nozzle_drive(c, sac.pressure, outside.cylinder, reached)
        spray = jet(spray_drive, sac.density, c.nozzle.offset).mass_flow

        line = at.line
        wave = y[line] - c.return_line.impedance * y[line + 1] if cells[1] > 0 else outside.low
        drain = drain_flow(c, chamber.pressure, chamber.density, s.valve.lift, wave)

        tap = c.control_chamber.z_from_inlet
        entry = feed(c, inlet, Inlet(outside.rail, s.rail_mass, y[0]), store.pressure, chamber.pressure)
        guides = c.plunger_needle.guides
        plunger_leak = joints.guide_leak(c, guides.plunger_leak, chamber.pressure, outside.low).mass_flow
        needle_leak = joints.guide_leak(c, guides.needle_leak, store.pressure, outside.low).mass_flow

        gap = valve.gap_drive(c.valve, s.valve.lift)
        pressing = joints.seat_pressure(c, gap, chamber.pressure, drain.behind)
        pull = solenoid.pull(c.solenoid, s.solenoid.pulling_flux)

        load_ = plunger_needle.loads(
            guides, c.needle_seat.area, chamber.pressure, store.pressure, sac.pressure, outside.low
        )
        store_masses(dy, at.body, 2, v)
        store_masses(dy, at.body + 1, 2, accelerations(c.plunger_needle, seat_contact(c), z, v, load_))
        if rubs:
            for i in range(9):
                speed = at.body + 2 * i + 1
                rubbing = friction_force(friction[i, 0], friction[i, 1], y[speed])
                dy[speed] -= c.plunger_needle.per_mass[i] * rubbing

        reached_before, rise = s.nozzle.lift_reached, lifts_of(v).tip
        relaxed = lifts.tip <= 0.0 and sac.pressure - outside.cylinder < joints.RELAXED
        rising = max(rise, 0.0) if lifts.tip >= reached_before else 0.0
        supplied = y[0] + tap * entry.z_flow
        core = Core(
            solenoid=coil_rates(c, outside, coil, s),
            valve=valve.rates(c.valve, s.valve, pull, pressing),
            fuel=Masses(
                control=entry.z_flow - drain.flow - plunger_leak,
                store=y[at.core - 1] - seat - (1.0 - tap) * entry.z_flow - needle_leak,
                sac=seat - spray,
            ),
            nozzle=nozzle.State(-reached_before / RESET_TIME if relaxed else rising, spray),
            books=Books(returned=drain.flow + plunger_leak + needle_leak, supplied=supplied),
            rail_mass=-supplied,
        )
        store_core(dy, at.core, 1, core)
        pipe_rates(y, dy, cells[0], c, entry.inlet, store.pressure)
        return_rates(y, dy, line, c, drain.flow, outside.low)

    return rates


def make_sac_rate(variant: Variant) -> Callable[..., float]:
    """Function (coefficients, y, cells, cylinder) → rate at which the SAC's pressure settles [1/s].

    It is the slope of seat and nozzle flow in the SAC's pressure times dp/dρ over its volume: large where the seat's
    or the holes' pressure drop is small, and the fastest rate of the hydraulics.
    """
    hydraulics, frame = make_hydraulics(variant), make_frame(variant)
    load_core, load_masses = CORE.load, wiring(variant).positions.load

    @physics
    def sac_rate(c: Coefficients, y: Any, cells: Any, cylinder: float) -> float:
        at = frame(cells)
        h = hydraulics(c, load_core(y, at.core, 1), load_masses(y, at.body, 2))
        gain = needle_seat.gap_drive(c.needle_seat, h.lifts.tip)
        seat = orifice(gain * (h.store.pressure - h.sac.pressure), gain, h.store.density, c.needle_seat.offset)
        drive_, gain_ = joints.nozzle_drive(c, h.sac.pressure, cylinder, h.reached)
        spray = orifice(drive_, gain_, h.sac.density, c.nozzle.offset)
        return (seat.slope + spray.slope) * h.sac.stiffness / h.room.sac

    return sac_rate  # type: ignore[no-any-return]
