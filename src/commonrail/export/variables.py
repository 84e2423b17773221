"""Variables of an FMU: names, references, units, start values, limits, descriptions."""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

from commonrail.choices import Drive
from commonrail.engine.operating_point import OTHER_PRESSURES, RAIL_PRESSURES
from commonrail.engine.time_step import DEFAULT_STEP, TIME_STEPS
from commonrail.export.entries import channels
from commonrail.export.sources import bounds_of
from commonrail.injector import reads
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector, parameter_paths

__all__ = ["BASE_UNITS", "CYLINDER", "DISPLAY_UNITS", "PLANNED", "RAIL", "RETURN", "Kind", "Variable", "variables"]

PLANNED = 4  # energisings that parameters plan; c/fmu.h
AT_REST = "at_rest.rail_pressure"  # in place of the input where the rail is a volume
RAIL, CYLINDER, RETURN = 100e6, 5e6, 0.5e6  # start values of the boundaries [Pa]
_STEP, _PLAN, _INPUT, _COMMAND, _CHANNEL, _RATE = 1000, 1001, 2000, 2100, 3000, 4000  # references, as in c/fmu.h

# Exponents of the SI base units.
BASE_UNITS = {
    "1": {},
    "1/Pa": {"kg": -1, "m": 1, "s": 2},
    "A": {"A": 1},
    "K": {"K": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N s/m": {"kg": 1, "s": -1},
    "N/m": {"kg": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "T": {"kg": 1, "s": -2, "A": -1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "V/A": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "kg": {"kg": 1},
    "kg/s": {"kg": 1, "s": -1},
    "m": {"m": 1},
    "m/Pa": {"kg": -1, "m": 2, "s": 2},
    "m2": {"m": 2},
    "m3": {"m": 3},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "rad": {"rad": 1},
    "s": {"s": 1},
    "s/m": {"m": -1, "s": 1},
}
# What people read a quantity in: name, factor from SI, offset.
DISPLAY_UNITS = {
    "K": (("degC", 1.0, -273.15),),
    "Pa": (("bar", 1e-5, 0.0), ("MPa", 1e-6, 0.0)),
    "kg": (("mg", 1e6, 0.0),),
    "kg/s": (("mg/ms", 1e3, 0.0),),
    "m": (("um", 1e6, 0.0), ("mm", 1e3, 0.0)),
    "s": (("us", 1e6, 0.0), ("ms", 1e3, 0.0)),
}
_NOMINAL = {"Pa": 1e8, "kg": 1e-5, "kg/s": 1e-2, "m": 1e-4, "A": 10.0, "N": 100.0, "s": 1e-3, "V": 10.0}


class Kind(NamedTuple):
    """Type of a variable and its part in the model, in the words of the standard."""

    type: str
    causality: str
    variability: str


class Variable(NamedTuple):
    """One variable.

    Attributes
    ----------
    name : str
    reference : int
    kind : Kind
    unit : str
        SI unit, "" for what is no real number.
    start : float or None
    low, high : float
        Limits, infinite where there are none.
    meaning : str
    """

    name: str
    reference: int
    kind: Kind
    unit: str
    start: float | None
    low: float
    high: float
    meaning: str

    @property
    def nominal(self) -> float | None:
        """Usual size of an output."""
        return _NOMINAL.get(self.unit) if self.kind.causality == "output" else None


_FIXED = Kind("Real", "parameter", "fixed")
_INPUT_KIND = Kind("Real", "input", "continuous")
_OUTPUT = Kind("Real", "output", "continuous")


def variables(injector: Injector) -> list[Variable]:
    """All variables of an injector's FMU, parameters first."""
    return [*_parameters(injector), *_plan(), *_inputs(injector), *_outputs(injector)]


def _parameters(injector: Injector) -> list[Variable]:
    found, unread = [], reads.unread_parameters(injector.variant)
    for i, path in enumerate((*parameter_paths(injector.variant.actuation), FUEL_TEMPERATURE)):
        if path in unread:
            continue
        low, high, low_open, high_open = bounds_of(injector, path)
        limits = _inside(low, high, low_open), _inside(high, low, high_open)
        quantity = injector.quantities[path]
        found.append(Variable(path, i, _FIXED, quantity.unit, injector.values[path], *limits, quantity.meaning))
    return found


def _inside(limit: float, other: float, is_open: int) -> float:
    """Limit that belongs to the range itself, as the standard's do: the next number inside where it does not.

    Parameters
    ----------
    limit, other : float
    is_open : int
        1 if the limit itself is outside.
    """
    if not is_open:
        return limit
    beside = math.nextafter(limit, other)
    return (
        beside if limit else math.copysign(sys.float_info.min, beside)
    )  # no denormal number, which importers may flush


def _plan() -> list[Variable]:
    step = "inner time step"
    found = [Variable("time_step", _STEP, _FIXED, "s", DEFAULT_STEP, TIME_STEPS.low, TIME_STEPS.high, step)]
    for i in range(PLANNED):
        start = f"start of planned energising {i + 1}, after the start of the simulation"
        duration = f"duration of planned energising {i + 1}; 0: there is none"
        name, at = f"energising[{i + 1}]", _PLAN + 2 * i
        found.append(Variable(f"{name}.start", at, _FIXED, "s", 0.0, 0.0, math.inf, start))
        found.append(Variable(f"{name}.duration", at + 1, _FIXED, "s", 0.0, 0.0, math.inf, duration))
    return found


def _inputs(injector: Injector) -> list[Variable]:
    low, high = injector.fuel.pressure_range
    rail = max(low, RAIL_PRESSURES.low), min(high, RAIL_PRESSURES.high)
    other = max(low, OTHER_PRESSURES.low), min(high, OTHER_PRESSURES.high)
    what, unit = ("voltage", "V") if injector.variant.drive is Drive.VOLTAGE else ("current", "A")
    given = [
        (reads.RAIL, "Pa", RAIL, *rail, "rail pressure"),
        ("cylinder_pressure", "Pa", CYLINDER, *other, "pressure in the cylinder"),
        (reads.RETURN, "Pa", RETURN, *other, "pressure at the end of the return line"),
        (reads.DRIVE, unit, 0.0, -math.inf, math.inf, f"measured coil {what}, which drives the injector"),
    ]
    unread = reads.unread_inputs(injector.variant)
    found = [
        Variable(f"boundary.{name}", _INPUT + i, _INPUT_KIND, own, start, least, most, meaning)
        for i, (name, own, start, least, most, meaning) in enumerate(given)
        if name not in unread
    ]
    if reads.RAIL in unread:
        meaning = "rail pressure at rest; from then on that of the rail's volume is simulated"
        found.insert(0, Variable(AT_REST, _INPUT, _FIXED, "Pa", RAIL, *rail, meaning))
    command = "true: the solenoid is energised"
    if reads.COMMAND in unread:
        command = "true: an injection begins, of which the instants are; the coil is driven by boundary.drive"
    kind = Kind("Boolean", "input", "discrete")
    return [*found, Variable("command", _COMMAND, kind, "", 0.0, -math.inf, math.inf, command)]


def _outputs(injector: Injector) -> list[Variable]:
    infinite = (-math.inf, math.inf)
    found = [
        Variable(c.name, _CHANNEL + i, _OUTPUT, c.unit, None, *infinite, c.meaning)
        for i, c in enumerate(channels(injector.variant.actuation))
    ]
    mean = "mean over the inner steps of the last communication step"
    more = (
        ("injection_rate", "kg/s", f"injection rate, {mean}"),
        ("return_rate", "kg/s", f"flow to the return, {mean}"),
        ("opening", "s", "instant at which the needle first rose by 5 um; 0 before"),
        ("closing", "s", "instant at which the needle met its seat for the last time; 0 while it is open"),
        ("first_closing", "s", "instant at which the needle first met its seat after it was open; 0 before"),
    )
    found += [
        Variable(name, _RATE + i, _OUTPUT, unit, None, *infinite, text) for i, (name, unit, text) in enumerate(more)
    ]
    is_open, status = Kind("Boolean", "output", "discrete"), Kind("Integer", "output", "discrete")
    found.append(Variable("needle_open", _RATE + 5, is_open, "", None, *infinite, "the needle is open"))
    words = "status of the simulation: 0 well, 5 the needle is open, others a failure"
    found.append(Variable("status", _RATE + 6, status, "", None, *infinite, words))
    return found
