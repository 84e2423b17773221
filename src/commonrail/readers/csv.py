"""CSV text: rows and columns, every fault with its line and column.

A file may begin with comment lines (``#``), then has one header row. The unit of a column stands in the header,
``rate [mm3/ms]``, or in a row of units below it; it is never guessed from a name. Rows come one after the other, so
that a large file never stands in memory as cells.
"""

from __future__ import annotations

import csv
import math
import re
import sys
from array import array
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.csv_output import restored, restored_note
from commonrail.base.errors import InputError
from commonrail.base.input import LARGEST_FILE
from commonrail.base.units import fits, read_decimal
from commonrail.physics.law import Domain
from commonrail.readers.columns import LARGEST, PLAIN, Column, FileForm, Table, cell_place, find_column, name_and_unit
from commonrail.readers.location import LONGEST_NAME, check_columns, read_lines, without_thousands

MOST_ROWS = 1_000_000  # one second at 1 MHz
LONGEST_NUMBER = 100  # [characters]
LARGEST_PLAIN = 1_000_000_000  # file that the program has written, such as the curves of a large study [bytes]
MOST_COMMENTS = 1000  # that are kept

NumberedRows = Iterator[tuple[int, list[str]]]  # line of the file on which a row begins, and its cells

_COMMA = str.maketrans({",": ".", ".": "_"})  # a point among decimal commas is no number

_QUOTED = re.compile(r'"[^"]*"')


class CsvFile:
    """CSV file, a `Sheet`; its `rows` can be gone through once, and its `comments` are complete then.

    The cells of the text are separated by commas, semicolons or tabs; at most `most` rows are read. A `plain` file
    is one that the program has written: commas, comments only above the header, names and texts as they stand.
    Raises `InputError` if the file cannot be read, has no row or too many columns. A row that cannot be read, has
    more or fewer cells than the header or is one too many is found when its turn comes.
    """

    def __init__(self, path: Path, form: FileForm = PLAIN, *, most: int = MOST_ROWS, plain: bool = False) -> None:
        self.path = path
        self.apart = False
        self._decimal = form.decimal
        self.comments: list[str] = []
        lines = _lines(path, self.comments, plain, form.encoding)
        first = next(lines, None)
        if first is None:
            raise InputError(f"{path}: the file has no rows; a header row and rows of numbers are expected.")
        separator = "," if plain else _delimiter(first[1])
        rows = _cells(path, chain((first,), lines), separator, plain)
        if plain:
            rows = ((line, [restored(cell) for cell in row]) for line, row in rows)
        _, header = next(rows)
        self.header = header if plain else [cell.strip() for cell in header]
        _check_header(path, self.header)
        self.rows = _checked(path, rows, len(header), most)
        if separator != "," and not form.decimal:
            self.rows = without_thousands(path, self.rows)
        named = [(cell, "") if plain else name_and_unit(cell) for cell in self.header]
        self.names, self._units = (list(parts) for parts in zip(*named, strict=True))

    def unit(self, name: str) -> str:
        """Unit of a column in the header, empty if there is none."""
        return str(self._units[self.names.index(name)])

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns; the other cells are let go at once."""
        places = [find_column(self.path, self.names, column.name) for column in columns]
        body = self.rows
        first = next(body, None)
        below = _units_row(first, [i for c, i in zip(columns, places, strict=True) if c.unit and not self._units[i]])
        if first is not None and below is None:
            body = chain((first,), body)
        lines = array("q")
        cells: list[Any] = [array("d") if column.unit else [] for column in columns]
        wanted = list(zip(columns, places, cells, strict=True))
        for line, row in body:
            lines.append(line)
            for column, i, content in wanted:
                # a text is one of the same few names in every row
                content.append(self._number(row[i], column, line) if column.unit else sys.intern(row[i]))
        found = {column.name: content for column, content in zip(columns, cells, strict=True)}
        return Table(
            self.path,
            {c.name: np.array(found[c.name], np.float64) for c in columns if c.unit},
            {c.name: list(found[c.name]) for c in columns if not c.unit},
            {column.name: (below or self._units)[i] for column, i in zip(columns, places, strict=True)},
            np.array(lines, np.intp),
            tuple(self.comments),
        )

    def _number(self, cell: str, column: Column, line: int) -> float:
        text = cell.strip()
        # "nan" fills up columns of curves that end earlier; what has a domain is left empty where it is missing.
        if not column.required and (text == "" or (text == "nan" and column.domain is Domain.ANY)):
            return math.nan
        if self._decimal == ",":
            text = text.translate(_COMMA)
        try:
            value = read_decimal(text) if len(text) <= LONGEST_NUMBER else math.nan
        except ValueError:
            value = math.nan
        if abs(value) <= LARGEST:
            return value
        at = cell_place(self.path, line, column.name)
        if math.isfinite(value):
            raise at.error(f'"{text}" is larger than any measured value')
        if not text:
            raise at.error("the cell is empty, and a number is expected")
        if re.fullmatch(r"[+-]?\d{1,3}( \d{3})+\S*", text):
            raise at.error(f'"{text}" has a space; write thousands without one')
        if re.fullmatch(r"[+-]?\d+,\d+", text):
            sign = 'state decimal = "," in a study, --decimal , on the command line'
            raise at.error(f'"{text}" has a decimal comma; write the decimal sign as a point, or {sign}')
        expected = "with a decimal comma" if self._decimal == "," else ""
        raise at.error(f'"{cell.strip()[:40]}" is not a finite number{expected and f" {expected}"}')


def _check_header(path: Path, names: list[str]) -> None:
    """Refuse a header with too many columns or a name that nobody would write."""
    check_columns(str(path), len(names))
    for number, name in enumerate(names, start=1):
        if len(name) > LONGEST_NAME or not name.isprintable():
            raise InputError(
                f"{path}: the name of column {number} is longer than {LONGEST_NAME} characters or has one that is not "
                "printed; rename it."
            )


def _checked(path: Path, rows: NumberedRows, columns: int, most: int) -> NumberedRows:
    """Rows, each with as many cells as the header."""
    for count, (line, row) in enumerate(rows, start=1):
        if len(row) != columns:
            hint = "; the decimal sign must be a point, or the separator a semicolon" if len(row) > columns else ""
            raise InputError(f"{path}, line {line}: the row has {len(row)} cells, the header {columns}{hint}.")
        if count > most:
            raise InputError(
                f"{path}, line {line}: the file has more than the {most} rows that are read; keep only what is needed."
            )
        yield line, row


def _cells(path: Path, lines: Iterator[tuple[int, str]], delimiter: str, plain: bool) -> NumberedRows:
    """Cells of each row and the line on which it begins, from lines with their numbers."""
    taken: list[int] = []  # lines of the row at hand: a quoted cell may go on

    def texts() -> Iterator[str]:
        for number, text in lines:
            taken.append(number)
            yield text + "\n"

    reader = csv.reader(texts(), delimiter=delimiter, strict=True, skipinitialspace=not plain)
    while True:
        taken.clear()
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise InputError(f"{path}, line {taken[0]}: the row cannot be read ({error}).") from error
        yield taken[0], row


def _lines(path: Path, comments: list[str], plain: bool, encoding: str) -> Iterator[tuple[int, str]]:
    """Lines that count with their numbers; the others join the comments."""
    header = False
    for number, line in enumerate(read_lines(path, LARGEST_PLAIN if plain else LARGEST_FILE, encoding), 1):
        if line.lstrip().startswith("#") and not (plain and header):
            if len(comments) < MOST_COMMENTS:
                comment = line.lstrip()[1:].strip()
                comments.append(restored_note(comment) if plain else comment)
        elif line.strip():
            header = True
            yield number, line


def _delimiter(header: str) -> str:
    """Semicolon or tab where the header has one outside quotes, else comma."""
    bare = _QUOTED.sub("", header)
    return next((sign for sign in (";", "\t") if sign in bare), ",")


def _units_row(first: tuple[int, list[str]] | None, places: Sequence[int]) -> list[str] | None:
    """Units of the row below the header, if that row holds units: text all over, a unit where it counts."""
    if first is None:
        return None
    row = [cell.strip().removeprefix("[").removesuffix("]").strip() for cell in first[1]]
    if any(_is_number(cell) for cell in row) or not any(row[i] and fits(row[i], row[i]) for i in places):
        return None
    return row


def _is_number(text: str) -> bool:
    try:
        read_decimal(text)
    except ValueError:
        return False
    return True
