"""Maps as ASAM CDF 2.0 (CDFX), the XML format of calibration data of control units."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from commonrail.base.output import write_text
from commonrail.plugins.maps.dcm import number_text
from commonrail.plugins.maps.table import Axis, MapTable

_DOCTYPE = (
    '<!DOCTYPE MSRSW PUBLIC "-//ASAM//DTD CALIBRATION DATA FORMAT:V2.0.0:LAI:IAI:XML:CDF200.XSD//EN" '
    '"cdf_v2.0.0.sl.dtd">'
)
UNKNOWN = "information-not-available"  # of a system that is not named; the format's own word


def write_cdfx(path: Path, tables: Sequence[MapTable]) -> None:
    """Write maps into one file, whole or not at all; InputError if a cell has no number.

    Each map is a SW-INSTANCE of the category MAP with its own two axes; its value groups follow the y axis, the values
    in a group the x axis. The notes of the maps stand in the long name of the tree.
    """
    for table in tables:
        table.require_numbers("A CDFX file")
    root = Element("MSRSW")
    _text(root, "SHORT-NAME", "commonrail")
    _text(root, "CATEGORY", "CDF20")
    system = SubElement(SubElement(root, "SW-SYSTEMS"), "SW-SYSTEM")
    _text(system, "SHORT-NAME", UNKNOWN)
    tree = SubElement(SubElement(system, "SW-INSTANCE-SPEC"), "SW-INSTANCE-TREE")
    _text(tree, "SHORT-NAME", "commonrail")
    _text(tree, "LONG-NAME", "; ".join(dict.fromkeys(note for table in tables for note in table.notes)))
    _text(tree, "CATEGORY", "NO_VCD")
    for table in tables:
        tree.append(_instance(table))
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    write_text(path, f'<?xml version="1.0" encoding="UTF-8"?>\n{_DOCTYPE}\n{body}\n')


def _instance(table: MapTable) -> Element:
    instance = Element("SW-INSTANCE")
    _text(instance, "SHORT-NAME", table.label)
    _text(instance, "LONG-NAME", table.title)
    _text(instance, "CATEGORY", "MAP")
    content = SubElement(instance, "SW-VALUE-CONT")
    _text(content, "UNIT-DISPLAY-NAME", table.unit)
    values = SubElement(content, "SW-VALUES-PHYS")
    for place, row in zip(table.y.values.tolist(), table.values.tolist(), strict=True):
        group = SubElement(values, "VG")
        _text(group, "LABEL", number_text(place))
        _numbers(group, row)
    axes = SubElement(instance, "SW-AXIS-CONTS")
    for axis in (table.x, table.y):
        _axis(axes, axis)
    return instance


def _axis(axes: Element, axis: Axis) -> None:
    container = SubElement(axes, "SW-AXIS-CONT")
    _text(container, "CATEGORY", "STD_AXIS")
    _text(container, "UNIT-DISPLAY-NAME", axis.unit)
    _numbers(SubElement(container, "SW-VALUES-PHYS"), axis.values.tolist())


def _numbers(parent: Element, values: Iterable[float]) -> None:
    for value in values:
        _text(parent, "V", number_text(value))


def _text(parent: Element, tag: str, text: str) -> None:
    SubElement(parent, tag).text = text
