"""Measured columns of a file as SI values: every number with its unit, every fault with its line and column.

The unit of a column is in the file or stated by the caller; it is never guessed from a name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from commonrail.base import registry
from commonrail.base.errors import InputError
from commonrail.base.hooks import note
from commonrail.base.units import NAMES, compatible, convert, same_scale
from commonrail.physics.law import Domain
from commonrail.readers.columns import PLAIN, Column, FileForm, Sheet, Table, find_headings
from commonrail.readers.formats import find_format, refuse_unread
from commonrail.readers.grid import read_grid
from commonrail.readers.location import Place, locate_errors
from commonrail.readers.quantity_matrix import FoundMap, GivenUnits, find_map, map_in
from commonrail.readers.table_sheet import open_table

LEAST_SAMPLES = 4

_GRIDS = ("csv", "txt", "tsv", "xlsx")  # formats of files with cells, in which a table may be anywhere
_FORM_KEYS = {"xlsx": ("decimal", "sheet"), "lvm": ("encoding",)}  # fields of the form that a format reads
# Files to which a field of the form applies, in words.
_READ_BY = {"encoding": "texts", "decimal": "texts and workbooks (.xlsx)", "sheet": "workbooks (.xlsx)"}


def read_columns(path: Path, columns: Sequence[Column], least: int = LEAST_SAMPLES, form: FileForm = PLAIN) -> Table:
    """Columns of a file that has `least` rows; `form`: encoding, decimal sign and sheet.

    Raises `InputError` if the file cannot be read, a column or unit is missing, or a cell is not a finite number.
    """
    return take_columns(open_sheet(path, form), columns, least)


def take_columns(sheet: Sheet, requested: Sequence[Column], least: int = LEAST_SAMPLES) -> Table:
    """Named columns of an open file in SI units; see `read_columns`."""
    path, headings = sheet.path, find_headings(sheet, requested)
    table = sheet.take([column._replace(name=headings.get(column.name, column.name)) for column in requested])
    if others := {name: heading for name, heading in headings.items() if heading != name}:
        names = {heading: name for name, heading in others.items()}
        contents: list[dict[str, Any]] = [table.columns, table.texts, table.written_units]
        columns, texts, units = ({names.get(key, key): item for key, item in of.items()} for of in contents)
        table = replace(table, columns=columns, texts=texts, written_units=units, headings=others)
        shown = (f'"{heading}" as {name}' for name, heading in others.items())
        note(f"{path}: columns are read by their usual names or units: {', '.join(shown)}.")
    if len(table.rows) < least:
        raise InputError(
            f"{path}: the file has {len(table.rows)} rows of numbers, and at least {least} are needed.",
            code="too-few",
            file=path,
        )
    numeric = [column for column in requested if column.unit]
    for column in numeric:
        name, at = column.name, Place(str(path), f'column "{headings.get(column.name, column.name)}"')
        table.written_units[name] = _unit(column, table.written_units[name], at)
        table.units[name] = _kind(column, table.written_units[name], at)
        with np.errstate(over="ignore"):  # the check below names the line
            table.columns[name] = convert(table.columns[name], table.written_units[name], table.units[name], str(at))
    for column in numeric:
        values = table.columns[column.name]
        if column.domain is not Domain.ANY:
            outside = np.flatnonzero(~(column.domain.admits(values) | np.isnan(values)))
            if len(outside):
                raise table.place(column.name, int(outside[0])).error(
                    f"the value must be {column.domain.value}", code="out-of-range"
                )
    for column in numeric:
        if column.increasing:
            _check_increasing(table, column.name)
    return table


def take_each(sheet: Sheet, time: Column, columns: Sequence[Column]) -> list[Table]:
    """One table for each column, with its times; the file is read once."""
    each = {column.name: column for column in columns}
    if sheet.independent_columns:
        read = {name: take_columns(sheet, [time, column]) for name, column in each.items()}
    else:
        read = dict.fromkeys(each, take_columns(sheet, [time, *each.values()]))
    return [read[column.name] for column in columns]


def has_columns(sheet: Sheet, columns: Sequence[Column]) -> list[Column]:
    """Columns that an open file has, under any usual heading."""
    headings = find_headings(sheet, columns)
    return [column for column in columns if column.name in headings]


def open_sheet(path: Path, form: FileForm = PLAIN) -> Sheet:
    """File with named columns; its first bytes or else its ending give the format, text by default.

    Raises `InputError` if the file cannot be read, or its format has no reader.
    """
    if reader := _format(find_format(path)):
        opener = reader.load()
        with reader.blame(f"fails on {path}"):
            return cast(Sheet, opener(path, form))
    refuse_unread(path)
    return open_table(path, form)


def read_found_map(path: Path, form: FileForm = PLAIN, given_units: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of a file in any format; `given_units` override the units of the file.

    Raises `InputError` if the file cannot be read, or no map is found in it.
    """
    return (
        find_map(read_grid(path, form), given_units) if is_grid(path) else map_in(open_sheet(path, form), given_units)
    )


def is_grid(path: Path) -> bool:
    """True if a file holds cells, in which a table may be anywhere: a text or a workbook, not named columns."""
    name = find_format(path)
    return name in _GRIDS or _format(name) is None


def idle_key(form: FileForm, files: Sequence[Path]) -> tuple[str, str] | None:
    """First stated field of a form that has no effect on any of the files, with a clause on it; None if all have."""
    for key in (key for key in _READ_BY if getattr(form, key)):
        if not any(key in form_keys(file) for file in files):
            return key, f"it is for {_READ_BY[key]}, and does nothing for {files[0]}; omit it"
    return None


def form_keys(path: Path) -> tuple[str, ...]:
    """Fields of a `FileForm` by which a file is read; all of them for a format of an installed package."""
    ending = find_format(path)
    if path.is_dir() or registry.find("inspectors", ending):
        return ()
    reader = _format(ending)
    if reader is not None and reader.distribution != registry.PACKAGE:
        return FileForm._fields
    return _FORM_KEYS.get(ending, ("encoding", "decimal") if is_grid(path) else ())


def _format(name: str) -> registry.Entry | None:
    """Format that ships or is installed; a file of any other is read as a text."""
    return registry.find("readers", name) if name else None


def _example(column: Column) -> str:
    """Example units for a column, "mm3/ms or mg/ms"; "%" for a share."""
    return " or ".join(NAMES[unit][1].partition(" ")[2] or "%" if unit in NAMES else unit for unit in column.units)


def _unit(column: Column, written: str, at: Place) -> str:
    """Unit of a column, from the file or stated elsewhere."""
    with locate_errors(at):
        is_other = written and column.stated and not same_scale(written, column.stated)
    if is_other:
        raise at.error(
            f'the file gives the unit "{written}", {column.stating} "{column.stated}"; keep one of them',
            code="conflict",
        )
    if not (written or column.stated or column.otherwise):
        example = _example(column).split()[0]
        stating = ", or state it in the study" if column.stating == "the study" else f", or give {column.stating}"
        stating *= bool(column.stating) and column.stated is None
        raise at.error(
            f'there is no unit; write it in the header, as in "{column.name} [{example}]"{stating}', code="no-unit"
        )
    return written or column.stated or column.otherwise


def _kind(column: Column, written: str, at: Place) -> str:
    """The wanted unit that measures the same kind of quantity as the column's own."""
    with locate_errors(at):
        fitting = [unit for unit in column.units if compatible(written, unit)]
    if not fitting:
        raise at.error(f'a unit like {_example(column)} is expected, not "{written}"', code="wrong-unit")
    return fitting[0]


def _check_increasing(table: Table, column: str) -> None:
    steps = np.diff(table.columns[column])
    if np.all(steps > 0.0):
        return
    row = int(np.argmax(steps <= 0.0)) + 1
    what = "repeats" if steps[row - 1] == 0.0 else "runs back behind"
    others = (name for name, values in table.columns.items() if name != column and np.all(np.diff(values) > 0.0))
    other = next(others, "")
    raise table.place(column, row).error(
        f"this {column} {what} the one on {table.row} {table.rows[row - 1]}; it must increase from row to row"
        + (f', as the column "{other}" does: the two may be exchanged in the header' if other else ""),
        code="order",
    )
