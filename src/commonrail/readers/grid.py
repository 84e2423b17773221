"""Cells of a table from anywhere: a text, or a sheet of a workbook.

Encoding, separator and decimal sign are detected unless they are stated. `Grid.said` reports the choices for the user
to check.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

from commonrail.base.errors import InputError
from commonrail.base.input import LARGEST_FILE, read_plain
from commonrail.readers.columns import PLAIN, FileForm
from commonrail.readers.formats import find_format, refuse_unread
from commonrail.readers.guarded import read_apart
from commonrail.readers.location import Shape
from commonrail.readers.text import (
    Cell,
    NumberedRows,
    find_decimal_comma,
    find_separator,
    number_lines,
    read_encoded,
    read_number,
    split_lines,
)

MOST_COMMENTS = 1000  # that are kept
KEPT = 1_000_000  # text whose rows are kept, because several blocks and columns may be read of it [bytes]

_COMMENT = re.compile(r"^[^\S\n]*#([^\n]*)", re.M)
_SIGNS = {";": "semicolons", "\t": "tabs", ",": "commas"}


class TooManyCells(InputError):
    """Row of a text that holds more cells than its table has columns."""


@dataclass(eq=False)
class Grid:
    """Cells of a table without comment lines and empty ones."""

    path: Path
    read: Callable[[], NumberedRows]  # goes through the rows
    said: tuple[str, ...]  # encoding, separator, decimal sign and sheet in words
    comma: bool  # whether numbers that are texts have decimal commas
    comments: tuple[str, ...] = ()  # without their sign
    word: str = "line"  # for a row in messages

    def each(self) -> NumberedRows:
        """Line in the file, or row of the sheet, and cells of each row as they are in the file; texts are stripped."""
        return iter(self._cells) if "_cells" in self.__dict__ else self.read()

    @cached_property
    def _cells(self) -> list[tuple[int, Sequence[Cell]]]:
        shape, rows = Shape(self.path, self.word), []
        for line, row in self.read():
            shape.add(len(row), line)
            rows.append((line, row))
        return rows

    @cached_property
    def rows(self) -> tuple[tuple[Cell, ...], ...]:
        """Rows of cells; numbers are floats."""
        return tuple(tuple(read_number(cell, self.comma) for cell in row) for _, row in self._cells)

    @cached_property
    def lines(self) -> tuple[int, ...]:
        """Line in the file, or row of the sheet, of each row."""
        return tuple(line for line, _ in self._cells)


def read_grid(path: Path, form: FileForm = PLAIN) -> Grid:
    """Cells of a text table or of a sheet of a workbook.

    Encoding and decimal sign of a text are detected unless `form` states them; of a workbook the first sheet that is
    not empty is taken by default. Raises `InputError` if the file cannot be read, is too large or holds nothing.
    """
    if find_format(path) == "xlsx":
        return read_sheet(path, form)
    refuse_unread(path)
    data, encoding = read_encoded(path, LARGEST_FILE, form.encoding)

    def filled() -> Iterator[tuple[int, str]]:
        return ((n, line) for n, line in number_lines(path, data) if line.strip()[:1] not in ("", "#"))

    if next(filled(), None) is None:
        raise InputError(
            f"{path}: the file has no rows; a header row and rows of numbers are expected.", code="empty", file=path
        )
    separator = find_separator(line for _, line in filled())

    def each() -> NumberedRows:
        return split_lines(path, filled(), separator)

    each = _cache_rows(each) if len(data) <= KEPT else each
    comma = find_decimal_comma(path, each(), form.decimal, separator)
    said = f"encoding {encoding}", f"separated by {_SIGNS[separator]}", f"decimal {'comma' if comma else 'point'}"
    comments = tuple(comment[1].strip() for comment in islice(_COMMENT.finditer(data.decode("utf-8")), MOST_COMMENTS))
    return Grid(path, each, said, comma, comments)


def _cache_rows(each: Callable[[], NumberedRows]) -> Callable[[], NumberedRows]:
    """Return a function that yields the same rows and caches them after the first complete pass."""
    cached: list[list[tuple[int, Sequence[Cell]]]] = []

    def rows() -> NumberedRows:
        passed = []
        for row in cached[0] if cached else each():
            passed.append(row)
            yield row
        cached[:] = [passed]

    return rows


def read_sheet(path: Path, form: FileForm = PLAIN) -> Grid:
    """Cells of a sheet of a workbook (.xlsx, .xlsm), read by openpyxl in a child process.

    By default the first that is not empty. Raises `InputError` if it is no workbook, too large, has no such sheet
    or nothing in it, or openpyxl is not installed.
    """
    if find_spec("openpyxl") is None:
        raise InputError(
            f"{path}: Excel files need openpyxl; install commonrail[excel], or export the sheet to CSV.",
            code="missing-package",
            file=path,
        )
    about = read_apart("commonrail.readers.xlsx_child", path, read_plain(path), sheet=form.sheet or None).about
    numbered = list(zip(about["lines"], map(tuple, about["rows"]), strict=True))
    comma = find_decimal_comma(path, iter(numbered), form.decimal)
    said: tuple[str, ...] = (f'sheet "{about["sheet"]}"',)
    if any(isinstance(cell, str) and cell != read_number(cell, comma) for _, row in numbered for cell in row):
        said += (f"numbers written as texts, decimal {'comma' if comma else 'point'}",)
    return Grid(path, lambda: iter(numbered), said, comma, word="row")


def check_width(grid: Grid, line: int, row: Sequence[Cell], columns: int) -> None:
    """Refuse a row of a text with a cell after the last of the `columns`: `TooManyCells`.

    A decimal comma between commas splits a number in two, and moves what follows it. Rows below a lone title and those
    of a workbook, whose cells are where they are, are let pass.
    """
    if 1 < columns < len(row) and grid.word == "line" and (width := filled_width(row)) > columns:
        cure = "name the column of each cell, or remove what is behind the last one"
        if "separated by commas" in grid.said:
            cure = "write a decimal sign as a point, or separate the columns by semicolons"
        raise TooManyCells(
            f"{grid.path}, line {line}: the row has {width} cells, the header {columns}; {cure}.",
            code="row-too-long",
            file=grid.path,
            place=f"line {line}",
        )


def filled_width(row: Sequence[Cell]) -> int:
    """Number of cells up to the last one that is filled."""
    return max((i for i, cell in enumerate(row, 1) if cell != ""), default=0)


def read_numbers(cells: Sequence[Cell]) -> list[float] | None:
    """Numbers of cells, NaN for empty ones; None if one is a text."""
    if any(isinstance(cell, str) and cell for cell in cells):
        return None
    return [cell if isinstance(cell, float) else math.nan for cell in cells]
