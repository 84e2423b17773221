"""Write maps into files whose format follows from the ending of their name."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.csv_output import neutralise, write_csv
from commonrail.base.errors import InputError
from commonrail.base.output import replacing, write_text
from commonrail.base.record import to_record
from commonrail.base.text import numbers
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.dcm import number_text, write_dcm, write_into_dcm
from commonrail.plugins.maps.difference import Comparison
from commonrail.plugins.maps.response import Conditions
from commonrail.plugins.maps.run import InjectionMap, MapBands
from commonrail.plugins.maps.table import Axis, Layer, MapTable, arrange_like
from commonrail.report.html import render

LONGEST_SHEET = 31  # characters of the name of a sheet


def write_map_file(path: Path, tables: Sequence[MapTable]) -> None:
    """Write maps into one file, atomically, in the format of its ending (`ENDINGS`); CSV holds one map.

    `InputError` if the ending is unknown, the format cannot hold the maps, or its library is not installed.
    """
    check_map_file(path)
    form = _FORMS[path.suffix.lower()]
    if form.single and len(tables) != 1:
        raise InputError(f"{path}: a {form.name} holds one map, not {len(tables)}; write each into a file of its own.")
    for table in tables if form.full else ():
        table.require_numbers(f"A {form.name}")
    form.write(path, tables)


def write_map_like(path: Path, table: MapTable, like: MapTable, source: Path) -> None:
    """Write a map in the shape of another one, whose file is `source`; from DCM to DCM as a copy with new values."""
    table = arrange_like(table, like)
    if path.suffix.lower() == source.suffix.lower() == ".dcm":
        write_into_dcm(path, source, like.label, table)
    else:
        write_map_file(path, [table])


def check_map_file(path: Path) -> None:
    """Refuse a name with an unknown ending, and a format whose library is missing."""
    suffix = path.suffix.lower()
    if suffix not in _FORMS:
        raise InputError(f"{path}: maps are written as {', '.join(ENDINGS)}; name a file that ends so.")
    if suffix == ".xlsx" and find_spec("openpyxl") is None:
        raise InputError(f"{path}: Excel files need openpyxl; install commonrail[excel], or write CSV.")


def _write_csv(path: Path, tables: Sequence[MapTable]) -> None:
    """One row per cell, a form that a study can read as data."""
    (table,) = tables
    parts: list[Axis | Layer] = [table.x, table.y, *table.layers]
    x, y, *layers = (f"{column.name} [{column.unit}]" for column in parts)
    rows = []
    for i, x_value in enumerate(table.x.values.tolist()):
        for j, y_value in enumerate(table.y.values.tolist()):
            cells = [number_text(x_value), number_text(y_value), _cell(table.values[j, i]), table.states[j][i]]
            rows.append(cells + [_cell(layer.values[j, i]) for layer in table.layers])
    header = [x, y, f"{table.name} [{table.unit}]", "state", *layers]
    write_csv(path, (table.title, *table.notes), header, rows)


def _cell(value: float) -> str:
    return number_text(float(value)) if np.isfinite(value) else ""


def _write_json(path: Path, tables: Sequence[MapTable]) -> None:
    record = {"kind": "maps", "schema": 1, "maps": to_record(tables)}
    write_text(path, json.dumps(record, indent=1, allow_nan=False) + "\n")


def _write_mat(path: Path, tables: Sequence[MapTable]) -> None:
    """MATLAB 5: a structure for each map, named by its label."""
    from scipy.io import savemat

    content = {}
    for table in tables:
        axes: dict[str, Any] = {}
        for key, axis in (("x", table.x), ("y", table.y)):
            axes |= {f"{key}_name": axis.name, f"{key}_unit": axis.unit, key: axis.values}
        content[_variable(path, table.label)] = {
            "title": table.title,
            "name": table.name,
            "unit": table.unit,
            **axes,
            "values": table.values,
            "states": np.array(table.states, object),
            "notes": np.array(table.notes, object),
            **{layer.name: layer.values for layer in table.layers},
        }
    if len(content) != len(tables):
        raise InputError(f"{path}: two of the maps have the same name in MATLAB; rename a label.")
    with replacing(path, "wb") as stream:
        savemat(stream, content, oned_as="row")


def _variable(path: Path, label: str) -> str:
    """Name of a MATLAB variable: points and brackets become underscores."""
    name = label.translate(str.maketrans(".[]", "___"))
    if len(name) > 31 or name.startswith("_"):
        raise InputError(
            f"{path}: the label {label} cannot be a MATLAB variable, which has at most 31 characters and begins "
            "with a letter; give a shorter label."
        )
    return name


def _write_xlsx(path: Path, tables: Sequence[MapTable]) -> None:
    """Sheets for each map with its values, states and edges of bands, and one with notes."""
    from openpyxl import Workbook

    book = Workbook()
    last = book.active
    last.title = "notes"
    for table in tables:
        for line in (f"{table.label}: {table.title}", *table.notes):
            last.append([neutralise(line)])
        parts = [(table.name, table.unit, numbers(table.values)), ("states", "", table.states)]
        parts += [(layer.name, layer.unit, numbers(layer.values)) for layer in table.layers]
        for what, unit, cells in parts:
            sheet = book.create_sheet(_sheet_name(what, [s.title for s in book.worksheets]))
            title = f"{what} [{unit}]" if unit else what
            notes = filter(None, (*table.notes[:1], "; ".join(table.notes[1:])))
            sheet.append([title, *map(neutralise, notes)])
            sheet.append(
                [f"{table.y.name} [{table.y.unit}] \\ {table.x.name} [{table.x.unit}]", *table.x.values.tolist()]
            )
            for place, row in zip(table.y.values.tolist(), cells, strict=True):
                sheet.append([place, *row])
            sheet.freeze_panes = "B3"
    book.move_sheet(last, len(book.worksheets))  # readers take the first sheet
    with replacing(path, "wb") as stream:
        book.save(stream)


def _sheet_name(label: str, taken: Sequence[str]) -> str:
    name, count = label[:LONGEST_SHEET], 2
    while name in taken:
        name, count = f"{label[: LONGEST_SHEET - 3]} {count}", count + 1
    return name


def _write_cdfx(path: Path, tables: Sequence[MapTable]) -> None:
    """ASAM CDF 2.0, the XML format of calibration data of control units."""
    notes = dict.fromkeys(note for table in tables for note in table.notes)
    write_text(path, render("cdfx.xml", __package__, tables=tables, notes="; ".join(notes), text=number_text) + "\n")


def _write_table(path: Path, tables: Sequence[MapTable]) -> None:
    """TunerStudio table, for open control units."""
    (table,) = tables
    values = f"values: {table.name} [{table.unit}]"
    notes = "; ".join((f"written by commonrail: {table.label}", table.title, values, *table.notes))
    notes = notes.replace("--", "\u2010\u2010")  # two hyphens would end the XML comment
    write_text(path, render("table.xml", __package__, table=table, notes=notes, text=number_text) + "\n")


class _Form(NamedTuple):
    """Format of a file: its writer, its name, whether it holds a `single` map, and whether it requires `full` maps."""

    write: Callable[[Path, Sequence[MapTable]], None]
    name: str
    single: bool = False
    full: bool = False


_FORMS = {
    ".csv": _Form(_write_csv, "CSV file", single=True),
    ".xlsx": _Form(_write_xlsx, "workbook"),
    ".mat": _Form(_write_mat, "MATLAB file"),
    ".json": _Form(_write_json, "JSON file"),
    ".dcm": _Form(write_dcm, "DCM file", full=True),
    ".cdfx": _Form(_write_cdfx, "CDFX file", full=True),
    ".table": _Form(_write_table, ".table file", single=True, full=True),
}
ENDINGS = tuple(_FORMS)


# A map as one JSON object in SI units.


def map_record(maps: Mapping[str, InjectionMap], compared: Comparison | None = None) -> dict[str, Any]:
    """Record [SI] of maps by label, the first compared with measured data; null if a number is missing."""
    parts: dict[str, Any] = {"maps": [_one_map_record(label, m) for label, m in maps.items()]}
    if compared is not None:
        parts["measured"] = {
            "source": compared.source,
            "rail_pressure": compared.measured.rail_pressure,
            "energising_time": compared.measured.energising_time,
            "measured": compared.measured.volume,
            "simulated": compared.simulated,
            "rms_large": compared.rms_large,
            "rms_small": compared.rms_small,
        }
    record: dict[str, Any] = to_record({"schema": 1, "kind": "map", **parts})
    return record


def conditions_record(conditions: Conditions) -> dict[str, float]:
    """Pressures [Pa] and time step [s]; threads change no result."""
    return {name: value for name, value in conditions._asdict().items() if name != "threads"}


def _one_map_record(label: str, m: InjectionMap) -> dict[str, Any]:
    """Content of the record of a map."""
    return {
        "label": label,
        "injector": m.injector.name,
        "variant": m.injector.variant.label,
        "synthetic": m.injector.synthetic,
        "conditions": conditions_record(m.conditions),
        "reference_density": m.density,
        "rules": {"several": m.rules.several, "unreachable": m.rules.beyond},
        "adjustment": m.adjustment._asdict(),
        "costs": m.costs,
        "simulations": m.simulations,
        **vars(m.axes),
        "injected_volume": m.volume,
        "ballistic": m.ballistic,
        "falls_with_pressure": m.falls_with_pressure,
        "inverse": {
            "energising_time": m.inverse.energising_time,
            "delivered": m.inverse.delivered,
            "state": [[CellState(state).name for state in row] for row in m.inverse.state.tolist()],
            "ballistic": m.inverse_ballistic,
        },
        "falls": m.falls,
        "bands": None if m.bands is None else _bands(m.bands),
    }


def _bands(bands: MapBands) -> dict[str, Any]:
    """Edges of the bands by level, over the cells of the quantity map and of the inverse."""
    edges = {
        name: [{"lower": low, "upper": high} for low, high in pairs.values()]
        for name, pairs in (("injected_volume", bands.quantity), ("delivered", bands.delivered))
    }
    return {"estimator": bands.estimator, "levels": list(bands.quantity), **edges}
