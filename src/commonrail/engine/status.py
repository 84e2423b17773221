"""Status of a simulation, with a sentence that says what to do."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arrays import Bools
from commonrail.base.choices import Boundary
from commonrail.base.errors import ConfigurationError
from commonrail.base.hooks import note
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.time_step import sound_speed
from commonrail.physics.components import feed_pipe, nozzle
from commonrail.physics.fuel import Fuel
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.variants import DRIVE, RETURN, reader_of, unread_inputs


class Status(IntEnum):
    """Outcome of one simulation. A `failed` one costs +inf in a study, like a needle still open in a quantity map."""

    OK = 0
    NOT_CLOSED_AT_START = 1
    STEP_UNSTABLE = 2
    RAN_AWAY = 3
    NOT_FINITE = 4
    STILL_INJECTING = 5
    OUTSIDE_DOMAIN = 6
    CONDITION_NOT_MET = 7  # set by a study only

    @property
    def sentence(self) -> str:
        """Event and cure in one sentence."""
        return _SENTENCES[self]

    @property
    def failed(self) -> bool:
        """Return whether the figures must not be used."""
        return self not in (Status.OK, Status.STILL_INJECTING)


_SENTENCES = {
    Status.OK: "The simulation ended well.",
    Status.NOT_CLOSED_AT_START: (
        "Needle or valve does not rest on its seat before energising: the opening forces exceed the closing ones; "
        "check plunger, guide and seat diameters and the springs of needle and valve."
    ),
    Status.STEP_UNSTABLE: (
        "The time step is too long for the stiffest spring of the plunger-needle, for the valve on its seat or for the "
        "travel time of a pipe; take a shorter time step or narrow the bounds."
    ),
    Status.RAN_AWAY: "The plunger-needle passed its seat or stop; check the stop's stiffness and the pressure areas.",
    Status.NOT_FINITE: "A pressure or mass left the range of the model; take a shorter time step or narrow the bounds.",
    Status.OUTSIDE_DOMAIN: (
        "A parameter is not finite or lies outside its domain, such as a length that is not positive; narrow the "
        "bounds (`commonrail catalogue parameters` lists the domains)."
    ),
    Status.CONDITION_NOT_MET: (
        "The injector does not behave as a condition of the study wants it; check the start values at that operating "
        "point, or correct the condition."
    ),
    Status.STILL_INJECTING: "The needle had not closed at the end of the simulated time; take a longer horizon.",
}


OK, STILL_INJECTING = int(Status.OK), int(Status.STILL_INJECTING)  # NumPy takes five times as long for an enum


def which_failed(statuses: NDArray[np.integer[Any]]) -> Bools:
    """Mask of failed statuses."""
    return np.asarray((statuses != OK) & (statuses != STILL_INJECTING))


# Checks of an operating point against its injector.

# Largest R q/Z of a feed pipe [1]. Fast engine against reference, virtual-lino-2016 with pipes of 0.3 to 3 m, 1 to
# 2.5 mm and f of 0.03 and 0.1, 160 MPa, 700 us: 0.03 % at 0.15, 0.08 % at 0.2, 0.16 % at 0.31, 0.66 to 0.75 % at 0.48,
# 1.6 % at 0.97, 4.9 % at 1.6.
MOST_LOSS = 0.3
ROUNDING = 1e-9  # of a pressure: tolerates the rounding of unit conversions


def check_inputs(injector: Injector, point: OperatingPoint) -> None:
    """Refuse measured courses that the injector does not read and would silently ignore.

    `ConfigurationError` if the point has a measured drive and the injector another kind of drive, or a course of
    the return pressure and the injector no return.
    """
    unread = unread_inputs(injector.variant)
    if DRIVE in unread and point.drive is not None:
        raise ConfigurationError(
            f"{injector.name} has a {injector.variant.drive.value} drive and does not read the measured drive of the "
            f"operating point; take {reader_of(DRIVE)}, or omit it."
        )
    if RETURN in unread and isinstance(point.return_pressure, Trace):
        raise ConfigurationError(
            f"{injector.name} is a {injector.variant.actuation.value} injector, without a return: it does not read the "
            "measured return pressure of the operating point; give a number."
        )


def check_point(injector: Injector, point: OperatingPoint) -> None:
    """Refuse a point that the injector's model or its fuel does not cover.

    Pressure waves inside the injector may exceed the fuel's range; its polynomials are fitted beyond it.

    `ConfigurationError` if a boundary pressure lies outside the fuel's range, or a rail volume is given
    a pressure trace.
    """
    if injector.variant.boundary is Boundary.VOLUME and isinstance(point.rail_pressure, Trace):
        raise ConfigurationError(
            f"{injector.name} is fed from a rail volume, whose pressure is simulated from its value at the start, but "
            'the operating point gives a measured trace of it; set rail_boundary to "ideal", so that the trace is the '
            "pressure at the inlet, or give the rail pressure as one number."
        )
    low, high = injector.fuel.pressure_range
    for name, course in point.pressures.items():
        values = course.value if isinstance(course, Trace) else (course,)
        for value in (min(values), max(values)):
            if not low * (1.0 - ROUNDING) <= value <= high * (1.0 + ROUNDING):
                raise ConfigurationError(
                    f"The {name} reaches {value * 1e-6:g} MPa, but the fuel {injector.fuel.name} is declared from "
                    f"{low * 1e-6:g} to {high * 1e-6:g} MPa; give a pressure inside this range, or another fuel."
                )


def note_limits(injector: Injector, points: Sequence[OperatingPoint]) -> None:
    """Note laws that are held at their limit by the injector's own values, each once per process."""
    if injector.variant.nozzle_law:
        return
    pressures = [point.at_start(point.rail_pressure) for point in points]
    for pressure in sorted({min(pressures), max(pressures)}, reverse=True):
        greatest = _greatest_discharge(injector.parameters.nozzle, pressure)
        if greatest > 1.0 + ROUNDING:
            note(
                f"{injector.name}: growth with pressure and shape would lift the nozzle's discharge coefficient to "
                f"{greatest:.3g} at {pressure * 1e-6:g} MPa; it is held at 1, beyond which no nozzle goes; check "
                "nozzle.discharge_growth and nozzle.shape_1 … shape_8, which were fitted at other pressures or lifts.",
                once=True,
            )
            return


@functools.lru_cache(maxsize=64)
def _greatest_discharge(p: nozzle.Parameters, rail_pressure: float) -> float:
    """Largest discharge coefficient of a nozzle by growth and shape [1], before it is limited to 1.

    `rail_pressure`: at time zero [Pa].
    """
    c = nozzle.coefficients(p, rail_pressure, 0.0)
    # both factors are linear, or rise as a sine, between these lifts
    lifts = (c.lift_transition, c.lift_maximum, *c.shape.knots)
    shaped = (nozzle.discharge(c, lift) * (1.0 + nozzle.change(c.shape, lift)) for lift in lifts)
    return max(nozzle.grown_discharge(p, rail_pressure), *shaped)


def note_narrow_pipe(injector: Injector, points: Sequence[OperatingPoint]) -> None:
    """Note a feed pipe with more friction than the fast engines resolve, by the injector's own values."""
    pressure = max(point.at_start(point.rail_pressure) for point in points)
    loss = pipe_loss(injector, pressure)
    if loss > MOST_LOSS:
        note(
            f"{injector.name}: the feed pipe is so narrow, long or rough (R q/Z = {loss:.2g} at {pressure * 1e-6:g} "
            f"MPa, above {MOST_LOSS:g}) that the fast engines may miss the quantity by more than 0.3 %; check "
            "feed_pipe.diameter, length and friction_factor, or compare with the reference engine.",
            once=True,
        )


def pipe_loss(injector: Injector, rail_pressure: float) -> float:
    """Friction of the feed pipe at the nozzle's full flow q, relative to its wave: R q/Z [1].

    `rail_pressure`: at time zero [Pa], taken upstream of the nozzle.
    """
    parts, temperature = injector.parameters, injector.values[FUEL_TEMPERATURE]
    density, speed = _density_and_speed(injector.fuel, rail_pressure, temperature)
    pipe = feed_pipe.coefficients(parts.feed_pipe, density, speed)
    holes = nozzle.coefficients(parts.nozzle, rail_pressure, 0.0)
    flow = nozzle.discharge(holes, holes.lift_maximum) * math.sqrt(2.0 * holes.area_squared * density * rail_pressure)
    return pipe.resistance * flow * pipe.admittance


@functools.lru_cache(maxsize=64)
def _density_and_speed(fuel: Fuel, pressure: float, temperature: float) -> tuple[float, float]:
    """Density [kg/m³] and speed of sound [m/s], cached for the next batch at the same point."""
    return float(fuel.density(pressure, temperature)), sound_speed(fuel, temperature, pressure)
