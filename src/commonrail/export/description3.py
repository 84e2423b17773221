"""Description of FMI 3.0: modelDescription.xml, what builds the sources, and the terminals."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as Xml

from commonrail.export.description2 import about, limits, number, units_element, written
from commonrail.export.sources import Model
from commonrail.export.variables import DISPLAY_UNITS, Variable

__all__ = ["build_description", "describe3", "terminals"]

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
