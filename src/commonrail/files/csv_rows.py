"""Rows of a CSV text with their lines in the file: comments, blank lines and delimiters are dealt with here."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from commonrail.errors import InputError
from commonrail.files.text_file import read_text

__all__ = ["Rows", "read_rows"]

LARGEST_FILE = 100_000_000  # [bytes]; held in memory some ten times over

_QUOTED = re.compile(r'"[^"]*"')


@dataclass(frozen=True)
class Rows:
    """Header and rows of cells with their lines in the file."""

    header: list[str]
    cells: list[list[str]]
    lines: list[int]
    comments: tuple[str, ...]


def read_rows(path: Path) -> Rows:
    """Rows of a CSV file whose first row is its header.

    Raises
    ------
    InputError
        If the file cannot be read, has no row, or a row has more or fewer cells than the header.
    """
    kept, numbers, comments = _lines(read_text(path, LARGEST_FILE))
    if not kept:
        raise InputError(f"{path}: the file has no rows; a header row and rows of numbers are expected.")
    (header, _), *rows = _parsed(path, kept, numbers)
    for row, line in rows:
        if len(row) != len(header):
            hint = "; the decimal sign must be a point" if len(row) > len(header) else ""
            raise InputError(f"{path}, line {line}: the row has {len(row)} cells, the header {len(header)}{hint}.")
    names = [cell.strip() for cell in header]
    return Rows(names, [row for row, _ in rows], [line for _, line in rows], comments)


def _parsed(path: Path, kept: list[str], numbers: list[int]) -> Iterator[tuple[list[str], int]]:
    """Cells of each row, and the line on which it begins."""
    reader = csv.reader(kept, delimiter=_delimiter(kept[0]), strict=True, skipinitialspace=True)
    while reader.line_num < len(kept):
        line = numbers[reader.line_num]
        try:
            yield next(reader), line
        except csv.Error as error:
            raise InputError(f"{path}, line {line}: the row cannot be read ({error}).") from error


def _lines(text: str) -> tuple[list[str], list[int], tuple[str, ...]]:
    """Lines that count, their numbers, and the comments."""
    kept: list[str] = []
    numbers: list[int] = []
    comments: list[str] = []
    for number, line in enumerate(text.split("\n"), start=1):
        if line.lstrip().startswith("#"):
            comments.append(line.lstrip()[1:].strip())
        elif line.strip():
            kept.append(line)
            numbers.append(number)
    return kept, numbers, tuple(comments)


def _delimiter(header: str) -> str:
    """Semicolon or tab where the header has one outside quotes, else comma."""
    bare = _QUOTED.sub("", header)
    return next((sign for sign in (";", "\t") if sign in bare), ",")
