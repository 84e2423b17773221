"""Limits of tables, checked row by row before anything is built of them."""

from __future__ import annotations

from pathlib import Path

from commonrail.arrays import IndexArray
from commonrail.errors import InputError

__all__ = [
    "LONGEST_NAME",
    "MOST_CELLS",
    "MOST_COLUMNS",
    "MOST_ROWS",
    "MOST_VALUES",
    "Groups",
    "Shape",
    "check_columns",
]

Groups = dict[tuple[str, ...], IndexArray]

MOST_ROWS = 10_000_000  # of a fleet: many injectors, each with a curve
MOST_COLUMNS = 1000
LONGEST_NAME = 200  # of a column [characters]
MOST_CELLS = 2_000_000  # of a grid whose cells stand in memory one by one
LARGEST_RECTANGLE = 20_000_000  # rows × widest row of a grid, which is filled up where it is taken for a matrix
MOST_VALUES = 20_000_000  # of all channels of a text, of a variable


def check_columns(where: str, columns: int) -> None:
    """Refuse too many columns; `where` is the file, with the line if there is one."""
    if columns > MOST_COLUMNS:
        raise InputError(
            f"{where}: there are {columns} columns, and at most {MOST_COLUMNS} are read; keep only those that are "
            "needed."
        )


class Shape:
    """Rows and cells of a grid, counted while it is read.

    Parameters
    ----------
    path : Path
    word : str
        For a row, in messages.
    """

    def __init__(self, path: Path, word: str = "line") -> None:
        self._path, self._word = path, word
        self._rows = self._cells = self._widest = 0

    def add(self, width: int, number: int) -> None:
        """Count a row of `width` cells, the one of that number; InputError if it has too many, or all rows have."""
        check_columns(f"{self._path}, {self._word} {number}", width)
        self._rows, self._cells, self._widest = self._rows + 1, self._cells + width, max(self._widest, width)
        if self._cells > MOST_CELLS or self._rows * self._widest > LARGEST_RECTANGLE:
            raise InputError(
                f"{self._path}: the table has more than the {MOST_CELLS} cells that are read, or more than "
                f"{LARGEST_RECTANGLE} if all rows were as long as the longest; keep only what is needed."
            )
