"""Rows of a CSV text with their lines in the file: comments, blank lines and delimiters are dealt with here.

Rows come one after the other, so that a large file never stands in memory as cells.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from commonrail.errors import InputError
from commonrail.reading.text_file import read_lines

__all__ = ["MOST_ROWS", "Rows", "read_rows"]

LARGEST_FILE = 100_000_000  # [bytes]
MOST_ROWS = 1_000_000  # one second at 1 MHz
MOST_COLUMNS = 1000
LONGEST_NAME = 200
MOST_COMMENTS = 1000  # that are kept

NumberedRows = Iterator[tuple[int, list[str]]]  # line of the file on which a row begins, and its cells

_QUOTED = re.compile(r'"[^"]*"')


@dataclass(frozen=True)
class Rows:
    """Header, and rows of cells with the line in the file on which each begins; they can be gone through once."""

    header: list[str]
    rows: NumberedRows
    comments: list[str]


def read_rows(path: Path, most: int = MOST_ROWS, *, plain: bool = False) -> Rows:
    """Rows of a CSV file whose first row is its header.

    Comments are complete once the rows have been gone through, and so are the errors: a row that cannot be read is
    found when its turn comes.

    Parameters
    ----------
    path : Path
    most : int
        Rows that are read at most.
    plain : bool
        Whether the program has written it: commas, comments only above the header, texts as they stand.

    Raises
    ------
    InputError
        If the file cannot be read, has no row, too many columns or rows, or a row has more or fewer cells than the
        header.
    """
    comments: list[str] = []
    lines = _lines(path, comments, plain)
    first = next(lines, None)
    if first is None:
        raise InputError(f"{path}: the file has no rows; a header row and rows of numbers are expected.")
    rows = _cells(path, chain((first,), lines), "," if plain else _delimiter(first[1]), plain)
    _, header = next(rows)
    names = header if plain else [cell.strip() for cell in header]
    _check_header(path, names)
    return Rows(names, _checked(path, rows, len(header), most), comments)


def _check_header(path: Path, names: list[str]) -> None:
    """Refuse a header with too many columns or a name that nobody would write."""
    if len(names) > MOST_COLUMNS:
        raise InputError(f"{path}: the header has {len(names)} columns, and at most {MOST_COLUMNS} are read.")
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
            hint = "; the decimal sign must be a point" if len(row) > columns else ""
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


def _lines(path: Path, comments: list[str], plain: bool) -> Iterator[tuple[int, str]]:
    """Lines that count with their numbers; the others join the comments."""
    header = False
    for number, line in enumerate(read_lines(path, LARGEST_FILE), start=1):
        if line.lstrip().startswith("#") and not (plain and header):
            if len(comments) < MOST_COMMENTS:
                comments.append(line.lstrip()[1:].strip())
        elif line.strip():
            header = True
            yield number, line


def _delimiter(header: str) -> str:
    """Semicolon or tab where the header has one outside quotes, else comma."""
    bare = _QUOTED.sub("", header)
    return next((sign for sign in (";", "\t") if sign in bare), ",")
