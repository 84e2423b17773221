"""Entry points of the compiled physics for callers without Python.

A simulation is two arrays of doubles that the caller owns: `work`, the working rows of one candidate (`engine.rows`),
and `waves`, the ring buffers of the travelling waves. The functions are those of `engine.block`, shared by the lanes
and the CUDA kernel; nothing is allocated and nothing is raised.

====================  ==================================================================================================
entry                 arguments
====================  ==================================================================================================
``kernel_begin``      work, waves, ring, theta, rail, cylinder, low, dt, figures: puts the injector to rest
``kernel_march``      work, waves, ring, first, count, inputs (count, 6), dt: steps first … first + count − 1
``kernel_observe``    work, channels: reads the channels of the present state
``kernel_figures``    work, cylinder, figures: reads the fields of `engine.job.Outcome`
``kernel_medium``     fuel, pressure, medium: density [kg/m³], bulk modulus [Pa] and sound speed [m/s] of a fuel
====================  ==================================================================================================
"""

from __future__ import annotations

from typing import Any, NamedTuple

from commonrail.base.choices import Actuation
from commonrail.engine.block import (
    INPUTS,
    Law,
    Memory,
    copy_number,
    make_advance,
    make_begin,
    make_own_inputs,
    make_wave_transport,
)
from commonrail.engine.job import FUEL, Outcome, make_rows
from commonrail.engine.recorder import report_remaining
from commonrail.physics import fuel_kernel
from commonrail.physics.components import solenoid
from commonrail.physics.law import physics
from commonrail.physics.model import Inputs, Setting
from commonrail.physics.variants import Variant, wiring


class Channel(NamedTuple):
    """Name, SI unit and meaning of an observed quantity."""

    name: str
    unit: str
    meaning: str


class Sizes(NamedTuple):
    """Numbers in the arrays of a wiring.

    theta has `parameters`, then the coefficients of the `fuel`. `work` counts the working rows; `waves` has 3 · ring
    numbers, or the size of theta if larger.
    """

    parameters: int
    fuel: int
    work: int
    inputs: int
    figures: int
    channels: int


_FUEL = len(FUEL.paths)
_load_fuel = FUEL.load
_BOOKS = (
    Channel("injected", "kg", "fuel injected so far"),
    Channel("returned", "kg", "fuel given to the return so far"),
    Channel("supplied", "kg", "fuel taken from the rail so far"),
    Channel("needle_lift", "m", "lift of the needle tip"),
)
_COMMON = (
    Channel("accumulation_pressure", "Pa", "pressure in the accumulation volume"),
    Channel("sac_pressure", "Pa", "pressure in the sac"),
    Channel("coil_current", "A", "current of the coil"),
    Channel("magnetic_force", "N", "magnetic force on the armature"),
    Channel("discharge_coefficient", "1", "discharge coefficient of the nozzle holes"),
    Channel("inlet_flow", "kg/s", "flow into the feed pipe"),
)
_SERVO = (
    Channel("plunger_lift", "m", "lift of the plunger top"),
    Channel("valve_lift", "m", "lift of the control valve"),
    Channel("control_pressure", "Pa", "pressure in the control chamber"),
    Channel("rail_pressure", "Pa", "pressure in the rail volume; the boundary pressure where the rail is ideal"),
    Channel("return_pressure", "Pa", "pressure behind the control valve"),
)
_DIRECT = (Channel("armature_lift", "m", "lift of the armature"),)


def channels(actuation: Actuation) -> tuple[Channel, ...]:
    """Observed quantities of an actuation, in order."""
    return _BOOKS + _COMMON + (_DIRECT if actuation is Actuation.DIRECT else _SERVO)


def sizes(variant: Variant) -> Sizes:
    """Sizes of the arrays of a wiring."""
    return Sizes(
        len(wiring(variant).parameters.paths),
        len(FUEL.paths),
        make_rows(variant, 1).end,
        len(Inputs._fields),
        len(Outcome._fields),
        len(channels(variant.actuation)),
    )


def entries(*words: str) -> dict[str, tuple[Law, Any]]:
    """Functions and Numba signatures of a wiring by entry, for `compiler.cache.Source`.

    `words`: those of a `Variant`.
    """
    from numba import types

    place, real, integer = types.CPointer(types.float64), types.float64, types.int64
    variant = Variant(*words)
    begin, march = _loop_entries(variant)
    observe, figures = _read_entries(variant)
    return {
        "kernel_begin": (begin, types.void(place, place, integer, place, real, real, real, real, place)),
        "kernel_march": (march, types.void(place, place, integer, integer, integer, place, real)),
        "kernel_observe": (observe, types.void(place, place)),
        "kernel_figures": (figures, types.void(place, real, place)),
        "kernel_medium": (_medium_entry(), types.void(place, real, place)),
    }


def _medium_entry() -> Law:
    from numba import carray

    def medium(coefficients, pressure, properties):  # type: ignore[no-untyped-def]
        fuel, out = _load_fuel(carray(coefficients, (_FUEL,)), 0, 1), carray(properties, (3,))
        density = fuel_kernel.density(fuel, pressure)
        out[0] = density
        out[1] = density * fuel_kernel.stiffness(fuel, density)
        out[2] = fuel_kernel.sound_speed(fuel, density)

    return medium


def _loop_entries(variant: Variant) -> tuple[Law, Law]:
    from numba import carray

    rows, size = make_rows(variant, 1), sizes(variant)
    put, advance = make_begin(variant, rows), make_advance(variant, rows)
    arrive, leave = make_wave_transport(rows, copy_number)
    columns, working, inputs_of_step, noted = size.parameters + size.fuel, size.work, size.inputs, size.figures
    candidates = (-1, 0)  # operating point, then the candidate of the lane, as in a block

    def begin(work, waves, ring, theta, rail, cylinder, low, dt, figures):  # type: ignore[no-untyped-def]
        memory = Memory(carray(work, (working,)), carray(waves, (max(3 * ring, columns),)), ring, None)
        parameters, out = carray(theta, (1, columns)), carray(figures, (1, noted))
        put(memory, parameters, candidates, Setting(rail, cylinder, low, dt), out)

    def march(work, waves, ring, first, count, inputs, dt):  # type: ignore[no-untyped-def]
        memory = Memory(carray(work, (working,)), carray(waves, (3 * ring,)), ring, None)
        table = carray(inputs, (count, inputs_of_step))
        for n in range(count):
            k = first + n
            u = Inputs(table[n, 0], table[n, 1], table[n, 2], table[n, 3], table[n, 4], table[n, 5])
            arrive(memory, k, True)
            advance(memory.work, float(k + 1), u, dt)
            leave(memory, k)

    return begin, march


def _read_entries(variant: Variant) -> tuple[Law, Law]:
    from numba import carray

    rows, size, wired = make_rows(variant, 1), sizes(variant), wiring(variant)
    load_coefficients, load_state = wired.coefficients.load, wired.state.load
    working, seen, noted, discharge = size.work, size.channels, size.figures, wired.discharge
    tip, top, state, cylinder = rows.tip, rows.top, rows.state, rows.cylinder
    observe_rest = _observe_direct if variant.actuation is Actuation.DIRECT else _observe_servo

    def observe(work, channels):  # type: ignore[no-untyped-def]
        numbers, out = carray(work, (working,)), carray(channels, (seen,))
        c, s = load_coefficients(numbers, 0, 1), load_state(numbers, state, 1)
        out[0], out[1], out[2] = s.nozzle.injected, s.cumulative_flows.returned, s.cumulative_flows.supplied
        out[3], out[4], out[5] = numbers[tip], s.accumulation.fuel.pressure, s.sac.pressure
        out[7] = solenoid.magnetic_force(c.solenoid, s.solenoid.pulling_flux)
        out[8], out[9] = (
            discharge(c.nozzle, s.nozzle.lift_reached, s.sac.pressure, numbers[cylinder]),
            s.feed_pipe.inlet_flow,
        )
        out[6] = solenoid.circuit(c.solenoid, s.solenoid.flux, observe_rest(c, s, numbers[top], out), 0.0).current

    def figures(work, cylinder, out):  # type: ignore[no-untyped-def]
        report_remaining(carray(work, (working,)), rows, cylinder, carray(out, (1, noted)))

    return observe, figures


@physics
def _observe_servo(c, s, top, out):  # type: ignore[no-untyped-def]
    """Write the channels of a servo injector; returns the air gap that the armature leaves open [m]."""
    out[10], out[11], out[12] = top, s.valve.lift, s.control_chamber.fuel.pressure
    out[13], out[14] = s.rail.pressure, s.return_line.pressure
    return c.valve.lift - s.valve.lift


@physics
def _observe_direct(c, s, top, out):  # type: ignore[no-untyped-def]
    """Write the channel of a direct-acting injector; returns the air gap that the armature leaves open [m]."""
    out[10] = top
    return c.armature.travel - top


# Entry points that march a block of injectors side by side, one in each lane of vector registers.
#
# ========================  ==========================================================================================
# entry                     arguments ========================
# ========================================================================================== ``kernel_block``
# work (rows, LANES), waves (3 ring, LANES), ring, first, count,                           inputs (count, inputs,
# LANES),                           dt, alike: steps first … first + count − 1; alike is 1 if all waves have equal
# delays ``kernel_block_figures``  work, figures (LANES, figures): reads the fields of `engine.job.Outcome` of all lanes
# ========================  ==========================================================================================
#
# A block is assembled from single injectors (`export.entry_points`): a lane has the rows of a single injector.

LANES = 8  # doubles in the widest registers; sufficient for most engines


def block_entries(*words: str) -> dict[str, tuple[Law, Any]]:
    """Functions and Numba signatures of a wiring's block by entry, for `compiler.cache.Source`.

    `words`: those of a `Variant`.
    """
    from numba import carray, types

    from commonrail.compiler.laws import row_copier, row_gatherer, row_tester

    variant = Variant(*words)
    rows, copy, gather = make_rows(variant, LANES), row_copier(LANES), row_gatherer(LANES)
    advance = make_advance(variant, rows, make_own_inputs(), row_tester(LANES))
    arrive, leave = make_wave_transport(rows, copy, gather)
    working, first_input, input_count, noted = rows.end, rows.inputs, len(INPUTS.paths), len(Outcome._fields)

    def march(work, waves, ring, first, count, inputs, dt, alike):  # type: ignore[no-untyped-def]
        memory = Memory(carray(work, (working * LANES,)), carray(waves, (3 * ring * LANES,)), ring, None)
        table = carray(inputs, (count * input_count * LANES,))
        for n in range(count):
            k = first + n
            for i in range(input_count):
                copy(memory.work, (first_input + i) * LANES, table, (n * input_count + i) * LANES)
            arrive(memory, k, alike != 0)
            advance(memory.work, float(k + 1), k, dt)
            leave(memory, k)

    def figures(work, out):  # type: ignore[no-untyped-def]
        numbers = carray(work, (working * LANES,))
        # every step sets the cylinder pressure of all lanes; dependent values here are not read
        report_remaining(numbers, rows, numbers[rows.cylinder * LANES], carray(out, (LANES, noted)))

    place, real, integer = types.CPointer(types.float64), types.float64, types.int64
    return {
        "kernel_block": (march, types.void(place, place, integer, integer, integer, place, real, integer)),
        "kernel_block_figures": (figures, types.void(place, place)),
    }
