"""Quantity map found in a file, a matrix or a table with other names, as the columns that a map is read from."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from commonrail.errors import InputError
from commonrail.notice import note
from commonrail.parts.furniture import Domain
from commonrail.reading.column_map import find_column_map
from commonrail.reading.file_form import FileForm
from commonrail.reading.grid import read_grid
from commonrail.reading.map_table import FoundMap, GivenUnits, find_map
from commonrail.reading.mat_file import MatFile
from commonrail.reading.mat_map import find_mat_map
from commonrail.reading.parquet_file import ParquetFile
from commonrail.reading.sheet import Table
from commonrail.units import convert

__all__ = ["found_table"]

_SI = {"rail pressure": "Pa", "energising time": "s"}
_NO_MAP = (".mf4", ".mdf", ".lvm")
_COLUMNS = (".parquet", ".pq")


def found_table(path: Path, form: FileForm, given: GivenUnits, quantity: str, *, matrix: bool) -> Table:
    """Columns rail_pressure, energising_time and quantity in SI units, a row for each point.

    Parameters
    ----------
    path : Path
        CSV or text table, workbook, MAT or Parquet file.
    form : FileForm
    given : GivenUnits
        They count before those of the file.
    quantity : str
        Name of the column of the quantities.
    matrix : bool
        Whether only a matrix is taken.

    Raises
    ------
    InputError
        If it cannot be read, no map is found in it, or a number makes no sense.
    """
    suffix = path.suffix.lower()
    if suffix in _NO_MAP or (matrix and suffix in _COLUMNS):
        raise InputError(f"{path}: a matrix is read from CSV, Excel and MAT files; this format holds columns only.")
    if suffix == ".mat":
        found = find_mat_map(MatFile(path), given)
    elif suffix in _COLUMNS:
        found = find_column_map(ParquetFile(path), given)
    else:
        found = find_map(read_grid(path, form.encoding or None, form.sheet or None), given)
    if matrix and not found.form.startswith("a matrix"):
        raise InputError(f'{path}: this is {found.form} and no matrix; state layout = "found".')
    note(f"{path}: read as {found.form}; {'; '.join(found.said)}.")
    return _table(path, found, quantity)


def _table(path: Path, found: FoundMap, quantity: str) -> Table:
    units = {kind: _SI.get(kind, "kg" if found.by_mass else "m3") for kind in found.units}
    names = {"rail pressure": "rail_pressure", "energising time": "energising_time", "quantity": quantity}
    content = {
        "rail pressure": found.rail_pressure,
        "energising time": found.energising_time,
        "quantity": found.quantity,
    }
    with np.errstate(over="ignore"):
        columns = {names[kind]: convert(v, found.units[kind], units[kind]) for kind, v in content.items()}
    table = Table(
        path,
        columns,
        {},
        {names[kind]: unit for kind, unit in found.units.items()},
        found.lines,
        units={names[kind]: unit for kind, unit in units.items()},
    )
    outside = np.flatnonzero(~(np.isfinite(columns[quantity]) & Domain.NON_NEGATIVE.admits(columns[quantity])))
    if len(outside):
        raise table.place(quantity, int(outside[0])).error(f"the value must be {Domain.NON_NEGATIVE.value}")
    return table
