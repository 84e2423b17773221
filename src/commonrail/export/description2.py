"""modelDescription.xml of FMI 2.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from xml.etree import ElementTree as Xml

from commonrail.export.sources import Model
from commonrail.export.variables import BASE_UNITS, DISPLAY_UNITS, Variable

__all__ = ["describe2", "number", "units_element"]


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
