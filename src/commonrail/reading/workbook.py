"""Sheets of a workbook (.xlsx): values as the spreadsheet last computed them; nothing in it is run."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from commonrail.errors import InputError, nearest
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.grid import MOST_CELLS, Grid
from commonrail.reading.grid_sheet import GridSheet
from commonrail.reading.guarded_file import read_plain

__all__ = ["WorkbookSheet", "read_sheet", "sheet_names"]

LARGEST_CONTENT = 500_000_000  # of a workbook when it is unpacked [bytes]
MOST_COLUMNS = 1000
MOST_ROWS = 1_048_576  # of a sheet


class WorkbookSheet(GridSheet):
    """Columns of a sheet of a workbook.

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
        super().__init__(read_sheet(path, form.sheet or None))


def sheet_names(path: Path) -> list[str]:
    """Names of the sheets of a workbook.

    Raises
    ------
    InputError
        If it is no workbook or openpyxl is not installed.
    """
    with _in_silence():
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
    with _in_silence():
        return _read_sheet(path, sheet)


@contextmanager
def _in_silence() -> Iterator[None]:
    """Keep openpyxl's warnings from the terminal: of styles, headers and other things that no cell is read from."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=r"openpyxl\b")
        yield


def _read_sheet(path: Path, sheet: str | None) -> Grid:
    book = _opened(path)
    if sheet is not None and sheet not in book.sheetnames:
        known = ", ".join(book.sheetnames)
        raise InputError(f'{path}: there is no sheet "{sheet}"{nearest(sheet, book.sheetnames)}; it has {known}.')
    for name in book.sheetnames if sheet is None else [sheet]:
        try:
            rows, lines = _cells(path, book[name])
        except InputError:
            raise
        except Exception as error:  # openpyxl reads a sheet when its rows are asked for, and raises as in `_opened`
            raise InputError(f'{path}: the sheet "{name}" cannot be read ({type(error).__name__}).') from error
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
    if not hasattr(sheet, "iter_rows"):  # a sheet that is a chart
        return rows, lines
    # What a sheet says of its size may be less than it holds, and openpyxl would read no more than that.
    sheet.reset_dimensions()
    for number, row in enumerate(sheet.iter_rows(values_only=True), start=1):
        if number > MOST_ROWS:
            raise InputError(f"{path}: the sheet has more than the {MOST_ROWS} rows that a sheet can have.")
        cells = tuple(map(_cell, row))
        while cells and cells[-1] == "":
            cells = cells[:-1]
        if len(cells) > MOST_COLUMNS:
            raise InputError(
                f"{path}, row {number}: there are {len(cells)} columns, and at most {MOST_COLUMNS} are read; keep only "
                "those that are needed."
            )
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
        number = float(value)
        return number if math.isfinite(number) else str(value)
    return str(value).strip()
