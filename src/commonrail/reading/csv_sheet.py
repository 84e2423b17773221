"""Columns of a CSV text: every fault with its line and column.

A file may begin with comment lines (``#``), then has one header row. The unit of a column stands in the header,
``rate [mm3/ms]``, or in a row of units below it; it is never guessed from a name.
"""

from __future__ import annotations

import math
import re
import sys
from array import array
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.errors import InputError
from commonrail.reading.csv_rows import read_rows
from commonrail.reading.sheet import Column, Table, cell_place, find_column, name_and_unit
from commonrail.units import compatible

__all__ = ["CsvSheet"]

LONGEST_NUMBER = 100  # [characters]


class CsvSheet:
    """Columns of a CSV file.

    Parameters
    ----------
    path : Path
        Text in UTF-8; cells separated by commas, semicolons or tabs; decimal points.
    plain : bool
        Whether the program has written it: commas, comments only above the header, names and texts as they stand.

    Raises
    ------
    InputError
        If the file cannot be read or has no header.
    """

    def __init__(self, path: Path, *, plain: bool = False) -> None:
        self.path = path
        self._rows = read_rows(path, plain=plain)
        header = [(cell, "") if plain else name_and_unit(cell) for cell in self._rows.header]
        self.names, self._units = (list(parts) for parts in zip(*header, strict=True))

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns; the other cells are let go at once."""
        places = [find_column(self.path, self.names, column.name) for column in columns]
        body = self._rows.rows
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
            tuple(self._rows.comments),
        )

    def _number(self, cell: str, column: Column, line: int) -> float:
        text = cell.strip()
        if not column.required and text in ("", "nan"):
            return math.nan
        try:
            value = float(text) if len(text) <= LONGEST_NUMBER else math.nan
        except ValueError:
            value = math.nan
        if math.isfinite(value) and "_" not in text:
            return value
        at = cell_place(self.path, line, column.name)
        if not text:
            raise at.error("the cell is empty, and a number is expected")
        if re.fullmatch(r"[+-]?\d+,\d+", text):
            raise at.error(f'"{text}" has a decimal comma; write the decimal sign as a point')
        raise at.error(f'"{text[:40]}" is not a finite number')


def _units_row(first: tuple[int, list[str]] | None, places: Sequence[int]) -> list[str] | None:
    """Units of the row below the header, if that row holds units: text all over, a unit where it counts."""
    if first is None:
        return None
    row = [cell.strip().removeprefix("[").removesuffix("]").strip() for cell in first[1]]
    if any(_is_number(cell) for cell in row) or not any(_is_unit(row[place]) for place in places):
        return None
    return row


def _is_unit(text: str) -> bool:
    try:
        return bool(text) and compatible(text, text)
    except InputError:
        return False


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
