"""Reader of workbooks for `guarded`: cells as the spreadsheet last computed them; nothing in them is run."""

from __future__ import annotations

import math
import re
from io import BytesIO
from pathlib import Path
from typing import Any

from openpyxl import load_workbook
from openpyxl.utils import range_boundaries

from commonrail.base.errors import InputError, nearest
from commonrail.readers.guarded import Save
from commonrail.readers.location import MOST_COLUMNS, Shape

WHAT = "workbook"

MOST_ROWS = 1_048_576  # of a sheet, by the format
MOST_TEXT = 20_000_000  # characters of all cells
UNCOMPUTED = "formula never computed: save in Excel"  # in place of the value that the workbook lacks
MOST_MERGED = 10_000  # ranges of merged cells that are filled


def read(path: Path, data: bytes, save: Save, sheet: str | None) -> dict[str, Any]:
    """Rows, their numbers and the name of a sheet, by default the first that is not empty."""
    book = load_workbook(BytesIO(data), read_only=True, data_only=True)
    if sheet is not None and sheet not in book.sheetnames:
        available = ", ".join(book.sheetnames)
        raise InputError(
            f'{path}: there is no sheet "{sheet}"{nearest(sheet, book.sheetnames)}; it has {available}.',
            code="missing-sheet",
            file=path,
        )
    for name in book.sheetnames if sheet is None else [sheet]:
        try:
            rows, lines = _cells(path, book[name], None)
            if any("" in row or len(row) < len(rows[0]) for row in rows):  # gaps, or formulas that nobody computed
                rows, lines = _cells(path, book[name], load_workbook(BytesIO(data), read_only=True)[name])
        except (InputError, MemoryError):
            raise
        except Exception as error:  # a sheet is parsed when its rows are asked for
            raise InputError(
                f'{path}: the sheet "{name}" cannot be read ({type(error).__name__}).', code="damaged", file=path
            ) from error
        if rows:
            return {"rows": rows, "lines": lines, "sheet": name}
    raise InputError(f"{path}: {'all sheets are' if sheet is None else 'the sheet is'} empty.", code="empty", file=path)


def _cells(path: Path, sheet: Any, formulas: Any) -> tuple[list[list[str | float]], list[int]]:
    """Rows and their numbers; a cell that is empty but in the sheet with `formulas`, if given, is `UNCOMPUTED`."""
    rows: list[list[str | float]] = []
    lines: list[int] = []
    merged = _find_merged(sheet)
    shape, left = Shape(path, "row"), MOST_TEXT
    if not hasattr(sheet, "iter_rows"):  # a sheet that is a chart
        return rows, lines
    # What a sheet says of its size may be less than it holds, and openpyxl would read no more than that.
    sheet.reset_dimensions()
    each = sheet.iter_rows(values_only=True)
    if formulas is not None:
        formulas.reset_dimensions()
        pairs = zip(each, formulas.iter_rows(values_only=True), strict=False)
        each = (
            [UNCOMPUTED if v is None and f is not None else v for v, f in zip(*pair, strict=False)] for pair in pairs
        )
    for number, row in enumerate(each, start=1):
        if number > MOST_ROWS:
            raise InputError(
                f"{path}: the sheet has more than the {MOST_ROWS} rows that a sheet can have.",
                code="too-many",
                file=path,
            )
        if row[MOST_COLUMNS:].count(None) == len(row[MOST_COLUMNS:]):
            row = row[:MOST_COLUMNS]  # cells that have a format and nothing else may reach to column XFD
        width = next((n for n in range(len(row), 0, -1) if _cell(row[n - 1]) != ""), 0)
        if width:
            shape.add(width, number)
            rows.append([_cell(value) for value in row[:width]])
            lines.append(number)
            left -= sum(len(cell) for cell in rows[-1] if isinstance(cell, str))
            if left < 0:
                raise InputError(
                    f"{path}: the sheet has more than the {MOST_TEXT} characters that are read.",
                    code="too-many",
                    file=path,
                )
    _fill(rows, lines, merged)
    return rows, lines


def _find_merged(sheet: Any) -> list[tuple[int, int, int, int]]:
    """Ranges of merged cells: first column, first row, last column and last row, from 1."""
    with sheet._get_source() as source:  # what openpyxl reads cell by cell has no list of them
        ranges = re.findall(rb'<mergeCell ref="([A-Z]{1,3}[0-9]{1,7}:[A-Z]{1,3}[0-9]{1,7})"', source.read())
    return [range_boundaries(cell_range.decode()) for cell_range in ranges[:MOST_MERGED]]


def _fill(rows: list[list[str | float]], lines: list[int], merged: list[tuple[int, int, int, int]]) -> None:
    """Write the value of merged cells into all of them; a title alone in its row is not repeated."""
    at = {line: row for line, row in zip(lines, rows, strict=True)}
    for left, top, right, bottom in merged:
        row = at.get(top, [])
        value = row[left - 1] if left <= len(row) else ""
        is_title = sum(cell != "" for cell in row) == 1
        for line in range(top, min(bottom, lines[-1]) + 1):
            cells = at.get(line, [])
            for i in range(left - 1, min(left if is_title else right, MOST_COLUMNS)):
                cells.extend([""] * (i + 1 - len(cells)))
                cells[i] = cells[i] if cells[i] != "" else value


def _cell(value: Any) -> str | float:
    if value is None:
        return ""
    if isinstance(value, int | float) and not isinstance(value, bool):
        number = float(value)
        return number if math.isfinite(number) else str(value)
    return str(value).strip()
