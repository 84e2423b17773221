"""Sheets of a workbook (.xlsx): values as the spreadsheet last computed them; nothing in it is run.

A table of columns in a sheet has one header row, which may stand below other texts; the unit of a column stands in the
header, ``rate [mm3/ms]``, or in the row below it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from commonrail.errors import InputError, nearest
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.grid import MOST_CELLS, Grid
from commonrail.reading.guarded_file import read_plain
from commonrail.reading.sheet import Column, Table, cell_place, find_column, name_and_unit

__all__ = ["WorkbookSheet", "read_sheet", "sheet_names"]

LARGEST_CONTENT = 500_000_000  # of a workbook when it is unpacked [bytes]
MOST_COLUMNS = 1000
MOST_ABOVE = 30  # rows in which the header of a table is looked for


class WorkbookSheet:
    """Columns of a sheet of a workbook, a `Sheet`.

    Parameters
    ----------
    path : Path
    form : FileForm
        Its `sheet`; encoding and decimal sign have no meaning here.

    Raises
    ------
    InputError
        As `read_sheet`, or if the sheet has no header.
    """

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        self.path = path
        self.apart = True
        self._grid = read_sheet(path, form.sheet or None)
        rows = self._grid.rows
        texts = [sum(isinstance(cell, str) and cell != "" for cell in row) for row in rows[:MOST_ABOVE]]
        if max(texts) < 2:
            raise InputError(f"{path}: the sheet has no header row with the names of columns.")
        self._header = next(i for i, count in enumerate(texts) if count >= 2)
        named = [name_and_unit(str(cell)) for cell in rows[self._header]]
        self.names = [name for name, _ in named]
        self._units = [unit for _, unit in named]

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns; see `Sheet.take`."""
        places = [find_column(self.path, self.names, column.name) for column in columns]
        numeric = [i for column, i in zip(columns, places, strict=True) if column.unit]
        start, units = self._header + 1, self._units
        below = self._grid.rows[start] if start < len(self._grid.rows) else ()
        if numeric and all(isinstance(_at(below, i), str) for i in numeric) and any(_at(below, i) for i in numeric):
            units = [str(_at(below, i)).strip("[]") or unit for i, unit in enumerate(self._units)]
            start += 1
        rows, lines = self._grid.rows[start:], self._grid.lines[start:]
        numbers: dict[str, list[float]] = {}
        texts: dict[str, list[str]] = {}
        for column, i in zip(columns, places, strict=True):
            if column.unit:
                cells = zip(lines, rows, strict=True)
                numbers[column.name] = [self._number(_at(row, i), column, line) for line, row in cells]
            else:
                texts[column.name] = [str(_at(row, i)) for row in rows]
        given = {column.name: units[i] for column, i in zip(columns, places, strict=True)}
        found = {name: np.array(values, np.float64) for name, values in numbers.items()}
        return Table(self.path, found, texts, given, np.array(lines, np.intp), row="row")

    def _number(self, cell: str | float, column: Column, line: int) -> float:
        if isinstance(cell, float):
            return cell
        if cell == "" and not column.required:
            return math.nan
        found = f'"{cell[:40]}" is a text' if cell else "the cell is empty"
        raise cell_place(self.path, line, column.name, "row").error(f"{found}, and a number is expected")


def _at(row: Sequence[str | float], column: int) -> str | float:
    """Cell of a row, empty behind its last one."""
    return row[column] if column < len(row) else ""


def sheet_names(path: Path) -> list[str]:
    """Names of the sheets of a workbook.

    Raises
    ------
    InputError
        If it is no workbook or openpyxl is not installed.
    """
    return [str(name) for name in _opened(path).sheetnames]


def read_sheet(path: Path, sheet: str | None = None) -> Grid:
    """Cells of a sheet.

    Parameters
    ----------
    path : Path
    sheet : str, optional
        By default the first that is not empty.

    Raises
    ------
    InputError
        If it is no workbook, too large, has no such sheet or nothing in it, or openpyxl is not installed.
    """
    book = _opened(path)
    if sheet is not None and sheet not in book.sheetnames:
        known = ", ".join(book.sheetnames)
        raise InputError(f'{path}: there is no sheet "{sheet}"{nearest(sheet, book.sheetnames)}; it has {known}.')
    for name in book.sheetnames if sheet is None else [sheet]:
        rows, lines = _cells(path, book[name])
        if rows:
            return Grid(path, tuple(rows), tuple(lines), (f'sheet "{name}"',))
    raise InputError(f"{path}: {'all sheets are' if sheet is None else 'the sheet is'} empty.")


def _opened(path: Path) -> Any:
    if find_spec("openpyxl") is None:
        raise InputError(f"{path}: Excel files need openpyxl; install commonrail[excel], or export the sheet to CSV.")
    from openpyxl import load_workbook

    data = read_plain(path)
    try:
        with ZipFile(BytesIO(data)) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
        if size > LARGEST_CONTENT:
            raise InputError(f"{path}: unpacked the workbook has {size / 1e6:.0f} MB, more than is read.")
        return load_workbook(BytesIO(data), read_only=True, data_only=True)
    except InputError:
        raise
    except Exception as error:  # openpyxl raises a dozen types for damaged workbooks
        raise InputError(f"{path}: this is no workbook that can be read ({type(error).__name__}).") from error


def _cells(path: Path, sheet: Any) -> tuple[list[tuple[str | float, ...]], list[int]]:
    rows: list[tuple[str | float, ...]] = []
    lines: list[int] = []
    count = 0
    for number, row in enumerate(sheet.iter_rows(values_only=True, max_col=MOST_COLUMNS), start=1):
        cells = tuple(map(_cell, row))
        while cells and cells[-1] == "":
            cells = cells[:-1]
        count += len(cells)
        if count > MOST_CELLS:
            raise InputError(f"{path}: the sheet has more than the {MOST_CELLS} cells that are read.")
        if cells:
            rows.append(cells)
            lines.append(number)
    return rows, lines


def _cell(value: Any) -> str | float:
    if value is None:
        return ""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value) if math.isfinite(value) else ""
    return str(value).strip()
