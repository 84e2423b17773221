"""Sheets of a workbook (.xlsx) as tables."""

from __future__ import annotations

from pathlib import Path

from commonrail.readers.columns import PLAIN, FileForm
from commonrail.readers.grid import GridSheet, read_sheet


class WorkbookSheet(GridSheet):
    """Columns of a sheet of a workbook.

    `form`: its `sheet`; encoding and decimal sign have no meaning here. Raises `InputError` as `read_sheet`, or if the
    sheet has no header.
    """

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        super().__init__(read_sheet(path, form.sheet or None))
