"""Columns of a grid of cells: a sheet of a workbook, or a text whose form was detected.

One header row, which may stand below other texts; the unit of a column stands in it, ``rate [mm3/ms]``, or in the row
below it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from commonrail.errors import InputError
from commonrail.reading.grid import Grid
from commonrail.reading.sheet import Column, Table, cell_place, find_column, name_and_unit
from commonrail.units import fits

__all__ = ["GridSheet"]

MOST_ABOVE = 30  # rows in which the header of a table is looked for


class GridSheet:
    """Columns of a grid, a `Sheet`.

    Parameters
    ----------
    grid : Grid

    Raises
    ------
    InputError
        If it has no header.
    """

    apart = True

    def __init__(self, grid: Grid) -> None:
        self.path = grid.path
        self._grid = grid
        self._header, self._start = _header(grid)
        named = [name_and_unit(str(cell)) for cell in grid.rows[self._header]]
        self.names = [name for name, _ in named]
        self._units = [unit for _, unit in named]
        if self._start > self._header + 1:
            below = grid.rows[self._header + 1]
            self._units = [str(_at(below, i)).strip("[] ") or unit for i, unit in enumerate(self._units)]

    def unit(self, name: str) -> str:
        """Unit of a column, empty if the file has none."""
        return self._units[self.names.index(name)]

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns; see `Sheet.take`."""
        places = [find_column(self.path, self.names, column.name) for column in columns]
        rows, lines = self._grid.rows[self._start :], self._grid.lines[self._start :]
        numbers: dict[str, list[float]] = {}
        texts: dict[str, list[str]] = {}
        for column, i in zip(columns, places, strict=True):
            if column.unit:
                cells = zip(lines, rows, strict=True)
                numbers[column.name] = [self._number(_at(row, i), column, line) for line, row in cells]
            else:
                texts[column.name] = [str(_at(row, i)) for row in rows]
        given = {column.name: self._units[i] for column, i in zip(columns, places, strict=True)}
        found = {name: np.array(values, np.float64) for name, values in numbers.items()}
        return Table(self.path, found, texts, given, np.array(lines, np.intp), row="row")

    def _number(self, cell: str | float, column: Column, line: int) -> float:
        if isinstance(cell, float):
            return cell
        if cell == "" and not column.required:
            return math.nan
        found = f'"{cell[:40]}" is a text' if cell else "the cell is empty"
        raise cell_place(self.path, line, column.name, "row").error(f"{found}, and a number is expected")


def _header(grid: Grid) -> tuple[int, int]:
    """Row of the header, and the first row of numbers."""
    rows = grid.rows[: MOST_ABOVE + 2]
    start = next((i for i, row in enumerate(rows) if _mostly(row, float)), len(rows))
    header = start - 1
    units = [str(cell).strip("[] ") for cell in rows[header] if cell] if header > 0 else []
    if header > 0 and _mostly(rows[header - 1], str) and all(fits(unit, unit) for unit in units):
        header -= 1
    if header < 0 or not _mostly(rows[header], str):
        raise InputError(f"{grid.path}: the table has no header row with the names of columns above its numbers.")
    return header, start


def _mostly(row: Sequence[str | float], kind: type) -> bool:
    filled = [cell for cell in row if cell != ""]
    return bool(filled) and 2 * sum(isinstance(cell, kind) for cell in filled) > len(filled)


def _at(row: Sequence[str | float], column: int) -> str | float:
    """Cell of a row, empty behind its last one."""
    return row[column] if column < len(row) else ""
