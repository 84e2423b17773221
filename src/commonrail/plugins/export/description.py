"""Variables of an FMU: names, references, units, start values, limits, descriptions."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from typing import NamedTuple
from xml.etree import ElementTree as Xml

from commonrail.base.choices import Drive
from commonrail.base.units import FAST
from commonrail.engine.operating_point import OTHER_PRESSURES, RAIL_PRESSURES
from commonrail.engine.time_step import DEFAULT_STEP, TIME_STEPS
from commonrail.physics import variants
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_paths
from commonrail.plugins.export.entry_points import channels
from commonrail.plugins.export.sources import Model, find_bounds

PLANNED = 4  # energisings that can be planned by parameters; c/fmu.h
AT_REST = "at_rest.rail_pressure"  # replaces the input for a rail volume
# Start values of the boundaries [Pa].
RAIL = 100e6
CYLINDER = 5e6
RETURN = 0.5e6
# References, as in c/fmu.h.
_STEP = 1000
_PLAN = 1001
_INPUT = 2000
_COMMAND = 2100
_CHANNEL = 3000
_RATE = 4000

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
# Display units of a quantity, the usual one first.
DISPLAY_UNITS = {
    "K": ("degC",),
    "Pa": ("bar", "MPa"),
    "kg": ("mg",),
    "kg/s": ("mg/ms",),
    "m": ("um", "mm"),
    "s": ("us", "ms"),
}
_NOMINAL = {"Pa": 1e8, "kg": 1e-5, "kg/s": 1e-2, "m": 1e-4, "A": 10.0, "N": 100.0, "s": 1e-3, "V": 10.0}


class Kind(NamedTuple):
    """Type of a variable and its part in the model, in the words of the standard."""

    type: str
    causality: str
    variability: str


class Variable(NamedTuple):
    """One variable with its reference in the C sources; `start`, `low` and `high` are in its SI unit.

    `unit` is "" unless it is a real number.
    """

    name: str
    reference: int
    kind: Kind
    unit: str
    meaning: str
    start: float | None = None
    low: float = -math.inf
    high: float = math.inf


_FIXED = Kind("Real", "parameter", "fixed")
_INPUT_KIND = Kind("Real", "input", "continuous")
_OUTPUT = Kind("Real", "output", "continuous")


def variables(injector: Injector, flat: bool = False) -> list[Variable]:
    """All variables of an injector's FMU, parameters first.

    Names are structured, ``energising[1].start``, or `flat`, ``energising_1__start``: importers may turn structured
    names into buses.
    """
    listed = [*_parameters(injector), *_plan(), *_inputs(injector), *_outputs(injector)]
    return [variable._replace(name=flat_name(variable.name)) for variable in listed] if flat else listed


def flat_name(name: str) -> str:
    """Name of a variable without points and brackets."""
    return name.replace("[", "_").replace("]", "").replace(".", "__")  # valve_lift is an output, valve.lift a parameter


def _parameters(injector: Injector) -> list[Variable]:
    parameters, unread = [], variants.unread_parameters(injector.variant)
    for i, path in enumerate((*parameter_paths(injector.variant.actuation), FUEL_TEMPERATURE)):
        if path not in unread:
            low, high, low_open, high_open = find_bounds(injector, path)
            limits = _inside(low, high, low_open), _inside(high, low, high_open)
            quantity, value = injector.quantities[path], injector.values[path]
            parameters.append(Variable(path, i, _FIXED, quantity.unit, quantity.meaning, value, *limits))
    return parameters


def _inside(limit: float, other: float, is_open: int) -> float:
    """Limit in the sense of the standard, which is inside the range: the next number if the range `is_open`."""
    if not is_open:
        return limit
    beside = math.nextafter(limit, other)
    return beside if limit else math.copysign(sys.float_info.min, beside)  # importers may flush denormal numbers


def _plan() -> list[Variable]:
    step = Variable("time_step", _STEP, _FIXED, "s", "inner time step", DEFAULT_STEP, TIME_STEPS.low, TIME_STEPS.high)
    meanings = {
        "start": "start of planned energising {}, after the start of the simulation",
        "duration": "duration of planned energising {}; 0: there is none",
    }
    return [step] + [
        Variable(f"energising[{i + 1}].{key}", _PLAN + 2 * i + j, _FIXED, "s", text.format(i + 1), 0.0, 0.0)
        for i in range(PLANNED)
        for j, (key, text) in enumerate(meanings.items())
    ]


def _inputs(injector: Injector) -> list[Variable]:
    low, high = injector.fuel.pressure_range
    rail = max(low, RAIL_PRESSURES.low), min(high, RAIL_PRESSURES.high)
    other = max(low, OTHER_PRESSURES.low), min(high, OTHER_PRESSURES.high)
    what, unit = ("voltage", "V") if injector.variant.drive is Drive.VOLTAGE else ("current", "A")
    back, driven = "pressure at the end of the return line", f"measured coil {what}, which drives the injector"
    boundaries = (
        Variable(variants.RAIL, _INPUT, _INPUT_KIND, "Pa", "rail pressure", RAIL, *rail),
        Variable("cylinder_pressure", _INPUT + 1, _INPUT_KIND, "Pa", "pressure in the cylinder", CYLINDER, *other),
        Variable(variants.RETURN, _INPUT + 2, _INPUT_KIND, "Pa", back, RETURN, *other),
        Variable(variants.DRIVE, _INPUT + 3, _INPUT_KIND, unit, driven, 0.0),
    )
    unread = variants.unread_inputs(injector.variant)
    inputs = [v._replace(name=f"boundary.{v.name}") for v in boundaries if v.name not in unread]
    if variants.RAIL in unread:
        meaning = "rail pressure at rest; from then on that of the rail's volume is simulated"
        inputs.insert(0, Variable(AT_REST, _INPUT, _FIXED, "Pa", meaning, RAIL, *rail))
    command = "true: the solenoid is energised"
    if variants.COMMAND in unread:
        command = "true: an injection begins, to which instants refer; the coil is driven by boundary.drive"
    return [*inputs, Variable("command", _COMMAND, Kind("Boolean", "input", "discrete"), "", command, 0.0)]


def _outputs(injector: Injector) -> list[Variable]:
    mean = "mean over the inner steps of the last communication step"
    is_open, status = Kind("Boolean", "output", "discrete"), Kind("Integer", "output", "discrete")
    more = (
        ("injection_rate", _OUTPUT, "kg/s", f"injection rate, {mean}"),
        ("return_rate", _OUTPUT, "kg/s", f"flow to the return, {mean}"),
        ("opening", _OUTPUT, "s", "instant at which the needle first rose by 5 um; 0 before"),
        ("closing", _OUTPUT, "s", "instant at which the needle met its seat for the last time; 0 while it is open"),
        ("first_closing", _OUTPUT, "s", "instant at which the needle first met its seat after it was open; 0 before"),
        ("needle_open", is_open, "", "the needle is open"),
        ("status", status, "", "status of the simulation: 0 well, 5 the needle is open, others a failure"),
    )
    observed = channels(injector.variant.actuation)
    return [
        *(Variable(c.name, _CHANNEL + i, _OUTPUT, c.unit, c.meaning) for i, c in enumerate(observed)),
        *(Variable(name, _RATE + i, kind, unit, text) for i, (name, kind, unit, text) in enumerate(more)),
    ]


# modelDescription.xml of both versions.

_TIME = 2200  # reference of the independent variable; c/fmu.h
_TYPES = {"Real": "Float64", "Boolean": "Boolean", "Integer": "Int32"}


def describe2(model: Model, listed: Sequence[Variable], token: str, sources: Sequence[str]) -> str:
    """Text of modelDescription.xml of FMI 2.0; `token` is the GUID that the binary compares.

    `sources` are the C files to compile on other platforms.
    """
    head = {"fmiVersion": "2.0", "guid": token, **_about(model, listed), "numberOfEventIndicators": "0"}
    root = Xml.Element("fmiModelDescription", head)
    able = ("HandleVariableCommunicationStepSize", "GetAndSetFMUstate", "SerializeFMUstate")
    abilities = {f"can{what}": "true" for what in (*able, "NotUseMemoryManagementFunctions")}
    simulation = Xml.SubElement(root, "CoSimulation", {"modelIdentifier": model.name, **abilities})
    files = Xml.SubElement(simulation, "SourceFiles")
    for name in sources:
        Xml.SubElement(files, "File", name=name)
    _add_units_and_experiment(root, listed)
    table = Xml.SubElement(root, "ModelVariables")
    for variable in listed:
        element = Xml.SubElement(table, "ScalarVariable", _identity(variable) | _initial(variable))
        Xml.SubElement(element, variable.kind.type, _range(variable) | _start(variable))
    structure = Xml.SubElement(root, "ModelStructure")
    for name in ("Outputs", "InitialUnknowns"):
        unknowns = Xml.SubElement(structure, name)
        for index, variable in enumerate(listed, start=1):
            if variable.kind.causality == "output":
                Xml.SubElement(unknowns, "Unknown", index=str(index))
    return _to_text(root)


def describe3(model: Model, listed: Sequence[Variable], token: str, sources: Sequence[str]) -> str:
    """Text of modelDescription.xml of FMI 3.0, as `describe2`; its `sources` are in `build_description`."""
    head = {"fmiVersion": "3.0", "instantiationToken": token, **_about(model, listed)}
    root = Xml.Element("fmiModelDescription", head)
    able = ("GetAndSetFMUState", "SerializeFMUState", "HandleVariableCommunicationStepSize")
    abilities = {f"can{what}": "true" for what in able} | {"maxOutputDerivativeOrder": "0"}
    Xml.SubElement(root, "CoSimulation", {"modelIdentifier": model.name, **abilities})
    _add_units_and_experiment(root, listed)
    table = Xml.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": str(_TIME), "causality": "independent", "variability": "continuous"}
    Xml.SubElement(table, "Float64", {**time, "unit": "s", "description": "simulated time"})
    for variable in listed:
        attributes = _identity(variable) | _range(variable) | _initial(variable) | _start(variable)
        Xml.SubElement(table, _TYPES[variable.kind.type], attributes)
    structure = Xml.SubElement(root, "ModelStructure")
    for name in ("Output", "InitialUnknown"):
        for variable in listed:
            if variable.kind.causality == "output":
                Xml.SubElement(structure, name, valueReference=str(variable.reference))
    return _to_text(root)


def _about(model: Model, listed: Sequence[Variable]) -> dict[str, str]:
    """Attributes that name the model and its maker."""
    is_flat = all(variable.name == flat_name(variable.name) for variable in listed)
    return {
        "modelName": model.injector.name,
        "description": model.injector.title,
        "version": version("commonrail"),
        "license": "Apache-2.0",
        "copyright": "The commonrail authors",
        "author": "commonrail",
        "generationTool": f"commonrail {version('commonrail')}",
        "generationDateAndTime": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "variableNamingConvention": "flat" if is_flat else "structured",
    }


def _add_units_and_experiment(root: Xml.Element, listed: Sequence[Variable]) -> None:
    """Add the definitions of the units that variables have, the category of messages, and the usual experiment."""
    units = Xml.SubElement(root, "UnitDefinitions")
    for name in sorted({variable.unit for variable in listed if variable.unit}):
        unit = Xml.SubElement(units, "Unit", name=name)
        Xml.SubElement(unit, "BaseUnit", {base: str(power) for base, power in BASE_UNITS[name].items()})
        for shown in DISPLAY_UNITS.get(name, ()):
            scale = FAST[shown]
            numbers = {"factor": repr(1.0 / scale.factor), "offset": repr(0.0 - scale.offset)}
            Xml.SubElement(unit, "DisplayUnit", {"name": shown, **numbers})
    categories = Xml.SubElement(root, "LogCategories")
    Xml.SubElement(categories, "Category", name="logStatusError", description="Sentences on what failed")
    Xml.SubElement(root, "DefaultExperiment", startTime="0", stopTime="0.01", stepSize="1e-05")


def _identity(variable: Variable) -> dict[str, str]:
    return {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.meaning,
        "causality": variable.kind.causality,
        "variability": variable.kind.variability,
    }


def _range(variable: Variable) -> dict[str, str]:
    """Unit, limits and nominal value of a real variable."""
    if variable.kind.type != "Real":
        return {}
    unit = {"unit": variable.unit}
    if variable.unit in DISPLAY_UNITS:
        unit["displayUnit"] = DISPLAY_UNITS[variable.unit][0]
    nominal = _NOMINAL.get(variable.unit, math.inf) if variable.kind.causality == "output" else math.inf
    numbers = {"min": variable.low, "max": variable.high, "nominal": nominal}
    return unit | {name: repr(float(value)) for name, value in numbers.items() if math.isfinite(value)}


def _initial(variable: Variable) -> dict[str, str]:
    kinds = {"parameter": "exact", "output": "calculated"}
    return {"initial": kinds[variable.kind.causality]} if variable.kind.causality in kinds else {}


def _start(variable: Variable) -> dict[str, str]:
    if variable.start is None:
        return {}
    return {"start": repr(float(variable.start)) if variable.kind.type == "Real" else str(bool(variable.start)).lower()}


def _to_text(root: Xml.Element) -> str:
    """Text of a document."""
    Xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"


# Build description of the sources, and terminals: FMI 3.0 only.


def build_description(model: Model, sources: Sequence[str]) -> str:
    """Text of ``sources/buildDescription.xml``."""
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=model.name)
    files = Xml.SubElement(configuration, "SourceFileSet", language="C11")
    for name in sources:
        Xml.SubElement(files, "SourceFile", name=name)
    Xml.SubElement(configuration, "Library", name="m", external="true")
    return _to_text(root)


def terminals(listed: Sequence[Variable]) -> str:
    """Text of terminalsAndIcons.xml: fuel line and coil, each with its `listed` variables."""
    names = {variable.name for variable in listed}
    root = Xml.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    table = Xml.SubElement(root, "Terminals")
    for name, members, description in (
        ("fuel_line", {"pressure": "boundary.rail_pressure", "flow": "inlet_flow"}, "inlet of the feed pipe"),
        ("coil", {"drive": "boundary.drive", "current": "coil_current"}, "coil of the solenoid"),
    ):
        connected = {m: text for m, variable in members.items() for text in {variable, flat_name(variable)} & names}
        if connected:
            terminal = Xml.SubElement(table, "Terminal", name=name, matchingRule="bus", description=description)
        for member, variable in connected.items():
            kind = "inflow" if member == "flow" else "signal"
            attributes = {"variableName": variable, "memberName": member, "variableKind": kind}
            Xml.SubElement(terminal, "TerminalMemberVariable", attributes)
    return _to_text(root)
