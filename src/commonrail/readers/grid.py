"""Cells of a table from anywhere: text in several encodings, with decimal points or commas, or a sheet of a workbook.

What a study reads is stricter (`csv_file`): there nothing is guessed. Here the encoding, the separator and the decimal
sign are detected, and `Grid.said` states what was taken, so that whoever asked can check it.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

import numpy as np

from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.base.units import fits
from commonrail.readers.columns import PLAIN, Column, FileForm, Table, cell_place, find_column, name_and_unit
from commonrail.readers.guarded import read_apart
from commonrail.readers.location import LONGEST_LINE, Shape, plain_spaces, without_thousands

LONGEST_NUMBER = 100  # [characters]
MOST_COMMENTS = 1000  # that are kept

_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_COMMENT = re.compile(r"^[^\S\n]*#([^\n]*)", re.M)
_LINE = re.compile(r"^[^\S\n]*[^\s#][^\n]*", re.M)  # that holds something, and is no comment
_POINT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.A)
_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?", re.A)


class TooManyCells(InputError):
    """Row of a text that holds more cells than its table has columns."""


@dataclass(frozen=True)
class Grid:
    """Cells of a table without comment lines and empty ones; texts are stripped, numbers are floats."""

    path: Path
    rows: tuple[tuple[str | float, ...], ...]
    lines: tuple[int, ...]  # line in the file, or row of the sheet, of each row
    said: tuple[str, ...]  # what was taken for encoding, separator, decimal sign and sheet
    comments: tuple[str, ...] = ()
    texts: tuple[
        tuple[str | float, ...], ...
    ] = ()  # the rows with all texts, where some of them were taken for numbers


def read_grid(path: Path, form: FileForm = PLAIN) -> Grid:
    """Cells of a text table or of a sheet of a workbook (.xlsx).

    Encoding and decimal sign of a text are detected unless `form` states them; of a workbook the first sheet that is
    not empty is taken by default. Raises `InputError` if the file cannot be read, is too large or holds nothing.
    """
    if path.suffix.lower() == ".xlsx":
        return read_sheet(path, form)
    text, found = _decoded(path, read_plain(path), form.encoding)
    return _parsed(path, plain_spaces(text).replace("\r\n", "\n").replace("\r", "\n"), found, form.decimal)


def read_sheet(path: Path, form: FileForm = PLAIN) -> Grid:
    """Cells of a sheet of a workbook (.xlsx), read by openpyxl in a child process.

    By default the first that is not empty. Raises `InputError` if it is no workbook, too large, has no such sheet
    or nothing in it, or openpyxl is not installed.
    """
    if find_spec("openpyxl") is None:
        raise InputError(f"{path}: Excel files need openpyxl; install commonrail[excel], or export the sheet to CSV.")
    about = read_apart("commonrail.readers.xlsx_child", path, read_plain(path), sheet=form.sheet or None).about
    rows, lines, said = tuple(map(tuple, about["rows"])), tuple(about["lines"]), f'sheet "{about["sheet"]}"'
    flat = [cell for row in rows for cell in row if isinstance(cell, str)]
    comma = _has_commas(path, flat, form.decimal)
    if not form.decimal:
        _ = list(without_thousands(path, zip(lines, rows, strict=True)))
    if not comma and not any("." in cell and _POINT.fullmatch(cell) for cell in flat):
        return Grid(path, rows, lines, (said,))
    number = _with_comma if comma else _with_point
    read = tuple(tuple(number(cell) if isinstance(cell, str) else cell for cell in row) for row in rows)
    return Grid(
        path, read, lines, (said, f"numbers written as texts, decimal {'comma' if comma else 'point'}"), (), rows
    )


def refuse_longer_rows(grid: Grid, header: int, start: int) -> None:
    """Refuse a row from `start` on with a cell behind the names and units in the rows from `header` to there.

    A decimal comma between commas splits a number in two, and moves what follows it. Rows below a lone title and those
    of a workbook, whose cells stand where they are, are let pass. Raises `TooManyCells`.
    """
    columns = max(map(_width, grid.rows[header:start]))
    if columns < 2 or grid.path.suffix.lower() == ".xlsx":
        return
    for line, row in zip(grid.lines[start:], grid.rows[start:], strict=True):
        if len(row) > columns and (width := _width(row)) > columns:
            cure = "name the column of each cell, or take away what stands behind the last one"
            if "separated by commas" in grid.said:
                cure = "write a decimal sign as a point, or separate the columns by semicolons"
            raise TooManyCells(f"{grid.path}, line {line}: the row has {width} cells, the header {columns}; {cure}.")


def _width(row: Sequence[str | float]) -> int:
    """Number of cells up to the last one that is filled."""
    return max((i for i, cell in enumerate(row, 1) if cell != ""), default=0)


def numbers_of(cells: Sequence[str | float]) -> list[float] | None:
    """Numbers of cells, NaN for empty ones; None if one is a text."""
    if any(isinstance(cell, str) and cell for cell in cells):
        return None
    return [cell if isinstance(cell, float) else math.nan for cell in cells]


def _decoded(path: Path, data: bytes, encoding: str) -> tuple[str, str]:
    mark = next((name for start, name in _MARKS.items() if data.startswith(start)), None)
    zeros = (data[1:200:2].count(0), data[0:200:2].count(0))
    if not encoding and mark is None and max(zeros) > 20:
        mark = "utf-16-le" if zeros[0] > zeros[1] else "utf-16-be"
    for name in [encoding] if encoding else [mark] if mark else ["utf-8", "cp1252"]:
        try:
            return data.decode(str(name)), str(name)
        except UnicodeError:
            continue
        except LookupError as error:
            raise InputError(f'{path}: there is no encoding "{name}"; write utf-8, utf-16 or cp1252.') from error
    raise InputError(f"{path}: this is no text in {encoding or mark or 'UTF-8 or cp1252'}; name its encoding.")


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines of cells with their numbers, one by one: a file may have as many lines as bytes."""
    number, last = 1, 0
    for found in _LINE.finditer(text):
        number, last = number + text.count("\n", last, found.start()), found.start()
        yield number, found[0]


def _parsed(path: Path, text: str, encoding: str, decimal: str) -> Grid:
    comments = tuple(found[1].strip() for found in islice(_COMMENT.finditer(text), MOST_COMMENTS))
    separator = _separator(path, _lines(text))
    cells: list[list[str]] = []
    lines: list[int] = []
    shape = Shape(path)
    for n, line in _lines(text):
        row = [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
        shape.add(len(row), n)
        cells.append(row)
        lines.append(n)
    flat = [cell for row in cells for cell in row if cell]
    comma = (separator != "," or decimal == ",") and _has_commas(path, flat, decimal)
    if comma and separator == "," and not any(map(_COMMA.fullmatch, flat)):
        raise InputError(
            f"{path}: a decimal comma is stated, but commas separate the columns and no number has one in quotes; "
            "state a decimal point, or separate the columns by semicolons."
        )
    number = _with_comma if comma else _with_point
    names = {";": "semicolons", "\t": "tabs", ",": "commas"}
    sign = "decimal comma" if comma else "decimal point"
    if separator != "," and not decimal:
        _ = list(without_thousands(path, zip(lines, cells, strict=True)))
    said = (f"encoding {encoding}", f"separated by {names[separator]}", sign)
    return Grid(path, tuple(tuple(map(number, row)) for row in cells), tuple(lines), said, comments)


def _has_commas(path: Path, cells: Sequence[str], decimal: str) -> bool:
    """Return whether the decimal sign is a comma, if nobody states it that of any number; refuse points beside it."""
    comma = decimal == "," or (not decimal and any(_COMMA.fullmatch(cell) for cell in cells))
    if comma and (pointed := next((cell for cell in cells if "." in cell and _POINT.fullmatch(cell)), "")):
        if decimal:
            raise InputError(
                f'{path}: a decimal comma is stated, and "{pointed}" has a point; state what the file has.'
            )
        raise InputError(
            f'{path}: some numbers have a decimal comma, and "{pointed}" has a point; write all of them alike, and '
            "thousands without a sign."
        )
    return comma


def _separator(path: Path, lines: Iterator[tuple[int, str]]) -> str:
    """The separator: the one that stands in more than half of the lines."""
    total = semicolons = tabs = 0
    for n, line in lines:
        if len(line) > LONGEST_LINE:
            raise InputError(
                f"{path}, line {n}: the line has {len(line)} characters, more than the {LONGEST_LINE} that are "
                "read; keep only the columns that are needed."
            )
        if "\0" in line:
            raise InputError(f"{path}, line {n}: this is no row of text.")
        total, semicolons, tabs = total + 1, semicolons + (";" in line), tabs + ("\t" in line)
    if not total:
        raise InputError(f"{path}: the file has no rows of text.")
    return ";" if semicolons * 2 > total else "\t" if tabs * 2 > total else ","


def _with_point(cell: str) -> str | float:
    return _number(cell, _POINT, lambda c: c)


def _with_comma(cell: str) -> str | float:
    found = _number(cell, _COMMA, lambda c: c.replace(",", "."))
    return _with_point(cell) if isinstance(found, str) else found


def _number(cell: str, form: re.Pattern[str], plain: Callable[[str], str]) -> str | float:
    if not (cell and len(cell) <= LONGEST_NUMBER and form.fullmatch(cell)):
        return cell
    value = float(plain(cell))
    return value if math.isfinite(value) else cell


# Columns of a grid of cells: a sheet of a workbook, or a text whose form was detected.
#
# One header row, which may stand below other texts; the unit of a column stands in it, ``rate [mm3/ms]``, or in the
# row below it.

MOST_ABOVE = 30  # rows in which the header of a table is looked for


class GridSheet:
    """Columns of a grid, a `Sheet`.

    Raises `InputError` if it has no header.
    """

    apart = True

    def __init__(self, grid: Grid) -> None:
        self.path = grid.path
        self._grid = grid
        self._header, self._start = _header(grid)
        refuse_longer_rows(grid, self._header, self._start)
        self._texts = (grid.texts or grid.rows)[self._start :]
        named = [name_and_unit(str(cell)) for cell in (grid.texts or grid.rows)[self._header]]
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
                texts[column.name] = [str(_at(row, i)) for row in self._texts]
        given = {column.name: self._units[i] for column, i in zip(columns, places, strict=True)}
        found = {name: np.array(values, np.float64) for name, values in numbers.items()}
        above = (cell for row in self._grid.rows[: self._header] for cell in row if isinstance(cell, str) and cell)
        comments = (*self._grid.comments, *above)
        return Table(self.path, found, texts, given, np.array(lines, np.intp), comments, row="row")

    def _number(self, cell: str | float, column: Column, line: int) -> float:
        if isinstance(cell, float):
            return cell
        if cell == "" and not column.required:
            return math.nan
        found = f'"{cell[:40]}" is a text' if cell else "the cell is empty"
        raise cell_place(self.path, line, column.name, "row").error(f"{found}, and a number is expected")


class WorkbookSheet(GridSheet):
    """Columns of a sheet of a workbook (.xlsx); of the form only the sheet counts."""

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        super().__init__(read_sheet(path, form))


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
