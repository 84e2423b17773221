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
from commonrail.engine.operating_point import OTHER_PRESSURES, RAIL_PRESSURES
from commonrail.engine.time_step import DEFAULT_STEP, TIME_STEPS
from commonrail.physics import variants
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_paths
from commonrail.plugins.export.entries import channels
from commonrail.plugins.export.sources import Model, bounds_of

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
    found, unread = [], variants.unread_parameters(injector.variant)
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
        (variants.RAIL, "Pa", RAIL, *rail, "rail pressure"),
        ("cylinder_pressure", "Pa", CYLINDER, *other, "pressure in the cylinder"),
        (variants.RETURN, "Pa", RETURN, *other, "pressure at the end of the return line"),
        (variants.DRIVE, unit, 0.0, -math.inf, math.inf, f"measured coil {what}, which drives the injector"),
    ]
    unread = variants.unread_inputs(injector.variant)
    found = [
        Variable(f"boundary.{name}", _INPUT + i, _INPUT_KIND, own, start, least, most, meaning)
        for i, (name, own, start, least, most, meaning) in enumerate(given)
        if name not in unread
    ]
    if variants.RAIL in unread:
        meaning = "rail pressure at rest; from then on that of the rail's volume is simulated"
        found.insert(0, Variable(AT_REST, _INPUT, _FIXED, "Pa", RAIL, *rail, meaning))
    command = "true: the solenoid is energised"
    if variants.COMMAND in unread:
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


# modelDescription.xml of FMI 2.0.


def describe2(model: Model, listed: Sequence[Variable], token: str, sources: Sequence[str]) -> str:
    """Text of the description.

    Parameters
    ----------
    model : Model
    listed : sequence of Variable
    token : str
        GUID that the binary compares.
    sources : sequence of str
        C files to be compiled where there is no binary.
    """
    attributes = {"fmiVersion": "2.0", "guid": token, **about(model), "numberOfEventIndicators": "0"}
    root = Xml.Element("fmiModelDescription", attributes)
    simulation = Xml.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
        canNotUseMemoryManagementFunctions="true",
    )
    files = Xml.SubElement(simulation, "SourceFiles")
    for name in sources:
        Xml.SubElement(files, "File", name=name)
    root.append(units_element(listed))
    categories = Xml.SubElement(root, "LogCategories")
    Xml.SubElement(categories, "Category", name="logStatusError", description="Sentences on what failed")
    Xml.SubElement(root, "DefaultExperiment", startTime="0", stopTime="0.01", stepSize="1e-05")
    table = Xml.SubElement(root, "ModelVariables")
    for variable in listed:
        _variable(table, variable)
    outputs = [i for i, variable in enumerate(listed, start=1) if variable.kind.causality == "output"]
    structure = Xml.SubElement(root, "ModelStructure")
    for name in ("Outputs", "InitialUnknowns"):
        unknowns = Xml.SubElement(structure, name)
        for index in outputs:
            Xml.SubElement(unknowns, "Unknown", index=str(index))
    return written(root)


def about(model: Model) -> dict[str, str]:
    """Attributes that name the model and its maker."""
    injector = model.injector
    return {
        "modelName": injector.name,
        "description": injector.title,
        "version": version("commonrail"),
        "license": "Apache-2.0",
        "copyright": "The commonrail authors",
        "author": "commonrail",
        "generationTool": f"commonrail {version('commonrail')}",
        "generationDateAndTime": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "variableNamingConvention": "structured",
    }


def units_element(listed: Sequence[Variable]) -> Xml.Element:
    """Definitions of the units that variables have."""
    units = Xml.Element("UnitDefinitions")
    for name in sorted({variable.unit for variable in listed if variable.unit}):
        unit = Xml.SubElement(units, "Unit", name=name)
        Xml.SubElement(unit, "BaseUnit", {base: str(power) for base, power in BASE_UNITS[name].items()})
        for shown, factor, offset in DISPLAY_UNITS.get(name, ()):
            Xml.SubElement(unit, "DisplayUnit", {"name": shown, "factor": number(factor), "offset": number(offset)})
    return units


def _variable(table: Xml.Element, variable: Variable) -> None:
    kind = variable.kind
    initial = {"parameter": "exact", "output": "calculated"}.get(kind.causality)
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.meaning,
        "causality": kind.causality,
        "variability": kind.variability,
        **({"initial": initial} if initial else {}),
    }
    element = Xml.SubElement(table, "ScalarVariable", attributes)
    typed: dict[str, str] = {}
    if kind.type == "Real":
        typed["unit"] = variable.unit
        if variable.unit in DISPLAY_UNITS:
            typed["displayUnit"] = DISPLAY_UNITS[variable.unit][0][0]
        typed |= limits(variable)
        if variable.start is not None:
            typed["start"] = number(variable.start)
    elif variable.start is not None:
        typed["start"] = "true" if variable.start else "false"
    Xml.SubElement(element, kind.type, typed)


def limits(variable: Variable) -> dict[str, str]:
    """Attributes of the limits and the usual size."""
    found = {"min": variable.low, "max": variable.high, "nominal": variable.nominal}
    return {name: number(value) for name, value in found.items() if value is not None and math.isfinite(value)}


def number(value: float) -> str:
    """Number with all its digits."""
    return repr(float(value))


def written(root: Xml.Element) -> str:
    """Text of a document."""
    Xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"


# Description of FMI 3.0: modelDescription.xml, what builds the sources, and the terminals.

_TIME = 2200  # reference of the independent variable; c/fmu.h
_TYPES = {"Real": "Float64", "Boolean": "Boolean", "Integer": "Int32"}


def describe3(model: Model, listed: Sequence[Variable], token: str, sources: Sequence[str]) -> str:
    """Text of the description.

    Parameters
    ----------
    model : Model
    listed : sequence of Variable
    token : str
        Instantiation token that the binary compares.
    sources : sequence of str
        Not used: `build_description` lists them.
    """
    root = Xml.Element("fmiModelDescription", {"fmiVersion": "3.0", "instantiationToken": token, **about(model)})
    Xml.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        canHandleVariableCommunicationStepSize="true",
        maxOutputDerivativeOrder="0",
    )
    units = units_element(listed)
    root.append(units)
    categories = Xml.SubElement(root, "LogCategories")
    Xml.SubElement(categories, "Category", name="logStatusError", description="Sentences on what failed")
    Xml.SubElement(root, "DefaultExperiment", startTime="0", stopTime="0.01", stepSize="1e-05")
    table = Xml.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": str(_TIME), "causality": "independent", "variability": "continuous"}
    Xml.SubElement(table, "Float64", {**time, "unit": "s", "description": "simulated time"})
    for variable in listed:
        Xml.SubElement(table, _TYPES[variable.kind.type], _attributes(variable))
    structure = Xml.SubElement(root, "ModelStructure")
    outputs = [variable for variable in listed if variable.kind.causality == "output"]
    for name in ("Output", "InitialUnknown"):
        for variable in outputs:
            Xml.SubElement(structure, name, valueReference=str(variable.reference))
    return written(root)


def _attributes(variable: Variable) -> dict[str, str]:
    kind = variable.kind
    found = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.meaning,
        "causality": kind.causality,
        "variability": kind.variability,
    }
    if kind.type == "Real":
        found["unit"] = variable.unit
        if variable.unit in DISPLAY_UNITS:
            found["displayUnit"] = DISPLAY_UNITS[variable.unit][0][0]
        found |= limits(variable)
    if kind.causality in ("parameter", "output"):
        found["initial"] = "exact" if kind.causality == "parameter" else "calculated"
    if variable.start is not None:
        found["start"] = number(variable.start) if kind.type == "Real" else ("true" if variable.start else "false")
    return found


def build_description(model: Model, sources: Sequence[str]) -> str:
    """Text of ``sources/buildDescription.xml``."""
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=model.name)
    files = Xml.SubElement(configuration, "SourceFileSet", language="C11")
    for name in sources:
        Xml.SubElement(files, "SourceFile", name=name)
    Xml.SubElement(configuration, "Library", name="m", external="true")
    return written(root)


def terminals(listed: Sequence[Variable]) -> str:
    """Text of ``terminalsAndIcons/terminalsAndIcons.xml``: fuel line and coil.

    Parameters
    ----------
    listed : sequence of Variable
        Of the FMU: a terminal has the variables that are among them.
    """
    names = {variable.name for variable in listed}
    root = Xml.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    table = Xml.SubElement(root, "Terminals")
    for name, members, description in (
        ("fuel_line", (("pressure", "boundary.rail_pressure"), ("flow", "inlet_flow")), "inlet of the feed pipe"),
        ("coil", (("drive", "boundary.drive"), ("current", "coil_current")), "coil of the solenoid"),
    ):
        terminal = Xml.SubElement(table, "Terminal", name=name, matchingRule="bus", description=description)
        for member, variable in members:
            if variable not in names:
                continue
            Xml.SubElement(
                terminal,
                "TerminalMemberVariable",
                variableName=variable,
                memberName=member,
                variableKind="inflow" if member == "flow" else "signal",
            )
    return written(root)
