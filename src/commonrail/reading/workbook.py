"""Sheets of a workbook (.xlsx), read by openpyxl in a child process."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from commonrail.errors import InputError
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.grid import Grid
from commonrail.reading.grid_sheet import GridSheet
from commonrail.reading.guarded_child import read_apart
from commonrail.reading.guarded_file import read_plain

__all__ = ["WorkbookSheet", "read_sheet"]


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
    if find_spec("openpyxl") is None:
        raise InputError(f"{path}: Excel files need openpyxl; install commonrail[excel], or export the sheet to CSV.")
    about = read_apart("xlsx", path, read_plain(path), sheet=sheet).about
    return Grid(path, tuple(map(tuple, about["rows"])), tuple(about["lines"]), (f'sheet "{about["sheet"]}"',))
