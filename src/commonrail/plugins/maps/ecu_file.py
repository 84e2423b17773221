"""Maps in files of control units, DCM, CDFX and TunerStudio tables: axes of a new map, and data of a study."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from decimal import Decimal
from html import unescape
from io import BytesIO
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.base.units import fits
from commonrail.plugins.maps.dcm import LARGEST, MOST_DECIMALS, MOST_MAPS, MOST_VALUES, read_dcm
from commonrail.plugins.maps.table import Axis, MapTable, is_turned
from commonrail.readers import quantity_matrix
from commonrail.readers.columns import PLAIN, Column, FileForm, Table, name_and_unit


class EcuMaps(NamedTuple):
    """Maps of a file by label, reasons why others were skipped, and the comments of the file."""

    kind: str
    tables: dict[str, MapTable]
    foreign: dict[str, str]
    comments: list[str]

    @property
    def sound(self) -> list[MapTable]:
        """Maps that are read."""
        return [table for label, table in self.tables.items() if label not in self.foreign]

    def add(self, texts: Sequence[str], axes: Sequence[tuple[str, list[str]]], rows: Sequence[Sequence[str]]) -> None:
        """Add a map from texts: label, title and unit; units and support points of x and y; rows of values."""
        label, title, unit = texts
        if len(self.tables) + len(self.foreign) == MOST_MAPS:
            raise ValueError(f"there are more than {MOST_MAPS} maps")
        try:
            x, y = (Axis(name, of, np.array(v, np.float64)) for name, (of, v) in zip("XY", axes, strict=True))
            values = np.array(rows, np.float64)
        except ValueError:
            self.foreign[label] = "it is not a table of numbers over two axes"
            return
        increase = all(len(axis.values) and np.all(np.diff(axis.values) > 0.0) for axis in (x, y))
        if values.shape != (len(y.values), len(x.values)) or not (increase and np.isfinite(values).all()):
            self.foreign[label] = "its support points do not increase, or do not match its values"
            return
        decimals = max(-int(Decimal(cell).as_tuple().exponent) for row in rows for cell in row)
        states = tuple(("",) * len(x.values) for _ in rows)
        decimals = min(max(decimals, 0), MOST_DECIMALS)
        table = MapTable(label, title, "value", unit, x, y, values, states, decimals=decimals)
        if self.tables.setdefault(label, table) is not table:
            self.foreign[label] = "its label is repeated"


def read_ecu_maps(path: Path) -> EcuMaps:
    """Read a DCM or CDFX file or a TunerStudio table; `InputError` if that fails."""
    data = read_plain(path, LARGEST)
    if not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        maps = EcuMaps("DCM 2", {}, {}, [])
        maps.tables.update({table.label: table for table in read_dcm(path, maps.foreign, maps.comments)})
        return maps
    if b"<!ENTITY" in data or b"\0" in data:  # entities can expand without limit
        raise InputError(f"{path}: XML with entities or in UTF-16 is not read; save it as plain UTF-8.")
    try:
        return _read_table(path, data) if b"<tableData" in data else _read_cdfx(path, data)
    except (ElementTree.ParseError, LookupError, StopIteration, ValueError) as error:
        raise InputError(f"{path}: this is not a readable CDFX file or TunerStudio table ({error}).") from error


def _elements(path: Path, data: bytes, tag: str) -> Iterator[ElementTree.Element]:
    """Elements of a name, without their name space; the content of others is dropped to save memory."""
    count = 0
    for event, element in ElementTree.iterparse(BytesIO(data), ("start", "end")):
        count += event == "start"
        if count > MOST_VALUES:
            raise InputError(f"{path}: the file has more than the {MOST_VALUES} elements that are read.")
        element.tag = element.tag.rpartition("}")[2]
        if event == "end" and element.tag == tag:
            yield element
            element.clear()


def _read_cdfx(path: Path, data: bytes) -> EcuMaps:
    """Read ASAM CDF 2.0; the support points of a map can be an instance of their own."""
    maps = EcuMaps("CDF 2", {}, {}, _notes(rb"<LONG-NAME>([^<]{1,4000})</LONG-NAME>", data))
    shared = {
        _text(instance, "SHORT-NAME"): [v.text or "" for v in instance.iter("V")]
        for instance in _elements(path, data, "SW-INSTANCE")
        if _text(instance, "CATEGORY") in ("COM_AXIS", "RES_AXIS", "AXIS_PTS")
    }
    for instance in _elements(path, data, "SW-INSTANCE"):
        if _text(instance, "CATEGORY") == "MAP":
            axes = []
            for axis in instance.iter("SW-AXIS-CONT"):
                points = [v.text or "" for v in axis.iter("V")] or shared.get(_text(axis, "SW-INSTANCE-REF"), [])
                axes.append((_text(axis, "UNIT-DISPLAY-NAME"), points))
            rows = [[v.text or "" for v in group.findall("V")] for group in instance.iter("VG")]
            texts = [_text(instance, n) for n in ("SHORT-NAME", "LONG-NAME", "SW-VALUE-CONT/UNIT-DISPLAY-NAME")]
            maps.add(texts, axes, rows)
    return maps


def _read_table(path: Path, data: bytes) -> EcuMaps:
    """Read a TunerStudio table; its axes have units only if their names state them."""
    root = next(_elements(path, data, "table"))
    maps = EcuMaps("TunerStudio", {}, {}, _notes(rb"<!--([^<]{1,4000})-->", data))
    places = [root.find("xAxis"), root.find("yAxis")]
    axes = [(name_and_unit(p.get("name", ""))[1], (p.text or "").split()) for p in places if p is not None]
    cells = (root.findtext("zValues") or "").split()
    width = len(axes[0][1]) or 1
    # what the product writes there: label, title and unit of the values
    heading = re.search(r"written by commonrail: (\S+); (.*?); values: \w+ \[([^\]]*)\]", "; ".join(maps.comments))
    texts = heading.groups() if heading else (path.stem, "", "")
    maps.add(texts, axes, [cells[i : i + width] for i in range(0, len(cells), width)])
    return maps


def _notes(pattern: bytes, data: bytes) -> list[str]:
    """Notes in the first match of a pattern, separated by semicolons."""
    note = re.search(pattern, data)
    return unescape((note[1] if note else b"").decode("utf-8", "replace").strip()).split("; ")


def _text(element: ElementTree.Element, name: str) -> str:
    return " ".join((element.findtext(name) or "").split())


def read_axes(path: Path) -> MapTable:
    """Read the first map of times over rail pressure and quantity, else the first map over both.

    `InputError` if no map has such axes.
    """
    maps = read_ecu_maps(path)
    fitting = [table for table in maps.sound if is_turned(table) is not None]
    if not fitting:
        passed = "".join(f"; {label} is not read: {reason}" for label, reason in list(maps.foreign.items())[:4])
        raise InputError(f"{path}: no map in it has an axis of pressure and one of quantity, with their units{passed}.")
    return next((table for table in fitting if fits(table.unit, "s")), fitting[0])


class MapFile:
    """File of a control unit: a `Sheet` with maps and without columns.

    Attributes
    ----------
    taken_for : str
    facts : dict of str to str
        Size, axes and unit of each map by label, or why it is not read.
    comments : sequence of str

    Raises
    ------
    InputError
        If it cannot be read or holds no map.
    """

    independent_columns = True
    names: Sequence[str] = ()

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        self.path = path
        maps = read_ecu_maps(path)
        if not (maps.tables or maps.foreign):
            raise InputError(f"{path}: there is no map in this file; single values and curves are skipped.")
        self._tables = maps.sound
        self.comments = maps.comments
        self.taken_for = f"calibration data, {maps.kind}"
        self.facts = {
            m.label: f"{len(m.x.values)} × {len(m.y.values)} over {m.x.unit or 'no unit'} × {m.y.unit or 'no unit'}, "
            f"values in {m.unit or 'no unit'}"
            for m in self._tables
        } | {label: f"not read: {reason}" for label, reason in maps.foreign.items()}

    def take(self, columns: Sequence[Column]) -> Table:
        """Raise `InputError`: the file has no columns."""
        raise InputError(f'{self.path}: this file holds maps and no columns; read it with layout = "found".')

    def quantity_map(self, units_in_study: quantity_matrix.GivenUnits) -> quantity_matrix.FoundMap:
        """First duration map of the file, else its first quantity map.

        `units_in_study` replace missing units. `InputError` if there is no such map.
        """
        stated = units_in_study.by_kind()
        candidates: list[tuple[bool, int, list[str], list[str], MapTable]] = []
        for table in self._tables:
            units = [table.y.unit, table.x.unit, table.unit]
            kinds = [quantity_matrix.kind_of(unit) for unit in units]
            missing = [kind for kind in quantity_matrix.KINDS if kind not in kinds]
            if kinds.count("") == len(missing) and all(map(stated.get, missing)) and kinds[2] != "rail pressure":
                kinds = [kind or (missing[0] if len(missing) == 1 else "") for kind in kinds]
                candidates.append((kinds[2] == "quantity", len(candidates), kinds, units, table))
        if not candidates:
            raise InputError(
                f"{self.path}: no map in it has rail pressures, quantities and energising times with their units; "
                "state the missing ones, a crank angle with its speed, as degCA@2000rpm."
            )
        _, _, kinds, units, table = min(candidates)
        by_kind = dict(zip(kinds, map(quantity_matrix.plain_unit, units), strict=True))
        matrix = quantity_matrix.Matrix(
            table.y.values, table.x.values, table.values, np.arange(1, table.values.size + 1)
        )
        in_file = {kind: stated[kind] or by_kind[kind] for kind in quantity_matrix.KINDS}
        orders = [(kinds[0], kinds[1])] if all(kinds) else quantity_matrix.ORDERS
        return quantity_matrix.map_of_matrix(self.path, matrix, in_file, orders, [f"map {table.label}"], self.comments)
