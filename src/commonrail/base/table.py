"""Tables as plain data: a title, columns, and rows of cells that tell the size of an error without colour."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

# Sizes of an error, with the sign that says it without colour.
SMALL, MEDIUM, LARGE = "small", "medium", "large"
SIGNS = {SMALL: "○", MEDIUM: "◐", LARGE: "●"}
BEST_SIGN = "★"
BEST_LEGEND = f"{BEST_SIGN} least error of the row."


@dataclass(frozen=True)
class Cell:
    """Text of a cell, the size of the error that it states ("" where it states none), and whether it is the least."""

    text: str
    size: str = ""
    best: bool = False

    @property
    def plain(self) -> str:
        """Text with its sign, for output without colour."""
        # the star is before the number, to keep the digits in line
        marked = f"{BEST_SIGN}\N{NO-BREAK SPACE}{self.text}" if self.best else self.text
        return f"{marked} {SIGNS[self.size]}" if self.size else marked


@dataclass(frozen=True)
class Table:
    """A table; the first `texts` columns are words, the others numbers.

    `inputs`: heads of columns that repeat what was asked for, which a narrow terminal leaves out first.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    texts: int = 1
    inputs: tuple[str, ...] = ()


Column = tuple[str, str | Callable[[Any], str | Cell]]


class Part(NamedTuple):
    """Columns of a table next to one another: their heads, and the cells that a row has in them."""

    heads: Sequence[str]
    cells: Callable[[Any], Iterable[str | Cell]]


OPERATING_POINT = ("rail, MPa", "energising, µs")  # heads of the input columns of rows that also have a name


def table_from_parts(
    title: str,
    rows: Iterable[Any],
    parts: Sequence[Part],
    note: str = "",
    texts: int = 1,
    inputs: tuple[str, ...] = (),
) -> Table:
    """Table of any rows.

    `rows`: objects from which the parts make cells. `texts`: number of columns that are words. `inputs`: see `Table`.
    """
    heads = tuple(head for block in parts for head in block.heads)
    texts_or_cells = ((cell for block in parts for cell in block.cells(row)) for row in rows)
    cells = tuple(tuple(cell if isinstance(cell, Cell) else Cell(cell) for cell in row) for row in texts_or_cells)
    return Table(title, heads, cells, note, texts, inputs)


def table_from_columns(
    title: str,
    rows: Iterable[Any],
    columns: Sequence[Column],
    note: str = "",
    texts: int = 1,
    inputs: tuple[str, ...] = (),
) -> Table:
    """Table of any rows, column by column.

    `rows`: objects that the columns read, such as parts of a record. `columns`: head, and the key in a row or a
    function that returns its text or cell. `texts`: number of columns that are words. `inputs`: see `Table`.
    """

    def cell(row: Any, text: str | Callable[[Any], str | Cell]) -> str | Cell:
        return str(row[text]) if isinstance(text, str) else text(row)

    heads = [head for head, _ in columns]
    all_columns = Part(heads, lambda row: (cell(row, text) for _, text in columns))
    return table_from_parts(title, rows, [all_columns], note, texts, inputs)


def judge_size(error: float | None, steps: Sequence[float]) -> str:
    """Size of an error: small up to the first step, medium up to the second; large for a missing number."""
    return LARGE if error is None else (SMALL, MEDIUM, LARGE)[sum(abs(error) > step for step in steps)]


def mark_least(
    errors: Sequence[float | None], text: Callable[[float | None], str], steps: Sequence[float] = ()
) -> list[Cell]:
    """Cells of a row of errors; the least and equal texts are marked, unless all texts are equal.

    With `steps`, each cell gets the class of its error.
    """
    sizes = [None if error is None else text(abs(error)) for error in errors]
    numbers = [abs(error) for error in errors if error is not None]
    least = text(min(numbers)) if len({size for size in sizes if size is not None}) > 1 else None
    return [
        Cell(text(error), judge_size(error, steps) if steps else "", size is not None and size == least)
        for error, size in zip(errors, sizes, strict=True)
    ]
