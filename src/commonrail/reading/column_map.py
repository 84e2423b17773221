"""Quantity map in the columns of a file with named and typed columns, found by their units whatever their names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.errors import InputError
from commonrail.reading.map_table import BAND, KINDS, FoundMap, GivenUnits, kind_of
from commonrail.reading.parquet_file import ParquetFile
from commonrail.reading.sheet import Column

__all__ = ["find_column_map"]

FORM = "a table with a row for each point"


def find_column_map(file: ParquetFile, given: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of a file whose columns state their units.

    Parameters
    ----------
    file : ParquetFile
    given : GivenUnits
        They count before those of the file.

    Raises
    ------
    InputError
        If not exactly one column has a unit of each kind, or a cell of them holds no number.
    """
    names = {kind: _column(file, kind) for kind in KINDS}
    stated = given.by_kind()
    units = {kind: stated[kind] or file.unit(name) for kind, name in names.items()}
    wanted = [Column(name, "1", required=kind != "quantity") for kind, name in names.items()]
    table = file.take(wanted)
    pressure, time, quantity = (table.columns[name] for name in names.values())
    filled = np.isfinite(quantity)
    if not filled.any():
        raise InputError(f'{file.path}: the map holds no quantity; "{names["quantity"]}" has no finite number.')
    said = ["columns " + ", ".join(f'"{name}"' for name in names.values())]
    if empty := int(filled.size - filled.sum()):
        said.append(f"{empty} without a quantity omitted")
    return FoundMap(FORM, pressure[filled], time[filled], quantity[filled], units, tuple(said), table.rows[filled])


def _column(file: ParquetFile, kind: str) -> str:
    """Name of the only column with a unit of a kind."""
    found = [name for name in file.names if BAND not in name and (unit := file.unit(name)) and kind_of(unit) == kind]
    if len(found) == 1:
        return found[0]
    raise InputError(
        f"{file.path}: {_shown(found)} the unit of a {kind}, and one column must have it; name columns as in "
        '"rail_pressure [MPa]", "energising_time [us]" and "quantity [mm3]".'
    )


def _shown(names: Sequence[str]) -> str:
    if not names:
        return "no column has"
    return "the columns " + " and ".join(f'"{name}"' for name in names[:4]) + " have"
