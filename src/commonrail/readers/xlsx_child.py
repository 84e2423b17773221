"""Reader of workbooks for `guarded`: cells as the spreadsheet last computed them; nothing in them is run."""

from __future__ import annotations

import math
from io import BytesIO
from pathlib import Path
from typing import Any

from openpyxl import load_workbook

from commonrail.base.errors import InputError, nearest
from commonrail.readers.guarded import Save
from commonrail.readers.location import MOST_COLUMNS, Shape

MOST_ROWS = 1_048_576  # of a sheet, by the format
MOST_TEXT = 20_000_000  # characters of all cells


def read(path: Path, data: bytes, save: Save, sheet: str | None) -> dict[str, Any]:
    """Rows, their numbers and the name of a sheet, by default the first that is not empty."""
    try:
        book = load_workbook(BytesIO(data), read_only=True, data_only=True)
    except MemoryError:
        raise
    except Exception as error:  # openpyxl raises a dozen types for damaged workbooks
        raise InputError(f"{path}: this is no workbook that can be read ({type(error).__name__}).") from error
    if sheet is not None and sheet not in book.sheetnames:
        known = ", ".join(book.sheetnames)
        raise InputError(f'{path}: there is no sheet "{sheet}"{nearest(sheet, book.sheetnames)}; it has {known}.')
    for name in book.sheetnames if sheet is None else [sheet]:
        try:
            rows, lines = _cells(path, book[name])
        except (InputError, MemoryError):
            raise
        except Exception as error:  # a sheet is parsed when its rows are asked for
            raise InputError(f'{path}: the sheet "{name}" cannot be read ({type(error).__name__}).') from error
        if rows:
            return {"rows": rows, "lines": lines, "sheet": name}
    raise InputError(f"{path}: {'all sheets are' if sheet is None else 'the sheet is'} empty.")


def _cells(path: Path, sheet: Any) -> tuple[list[list[str | float]], list[int]]:
    rows: list[list[str | float]] = []
    lines: list[int] = []
    shape, left = Shape(path, "row"), MOST_TEXT
    if not hasattr(sheet, "iter_rows"):  # a sheet that is a chart
        return rows, lines
    # What a sheet says of its size may be less than it holds, and openpyxl would read no more than that.
    sheet.reset_dimensions()
    for number, row in enumerate(sheet.iter_rows(values_only=True), start=1):
        if number > MOST_ROWS:
            raise InputError(f"{path}: the sheet has more than the {MOST_ROWS} rows that a sheet can have.")
        if row[MOST_COLUMNS:].count(None) == len(row[MOST_COLUMNS:]):
            row = row[:MOST_COLUMNS]  # cells that have a format and nothing else may reach to column XFD
        width = next((n for n in range(len(row), 0, -1) if _cell(row[n - 1]) != ""), 0)
        if width:
            shape.add(width, number)
            rows.append([_cell(value) for value in row[:width]])
            lines.append(number)
            left -= sum(len(cell) for cell in rows[-1] if isinstance(cell, str))
            if left < 0:
                raise InputError(f"{path}: the sheet has more than the {MOST_TEXT} characters that are read.")
    return rows, lines


def _cell(value: Any) -> str | float:
    if value is None:
        return ""
    if isinstance(value, int | float) and not isinstance(value, bool):
        number = float(value)
        return number if math.isfinite(number) else str(value)
    return str(value).strip()
