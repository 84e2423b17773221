"""Tables from column specifications: each column is its head and the text of a row."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from commonrail.report.tables import Cell, Table

__all__ = ["Column", "tabulated"]

Column = tuple[str, str | Callable[[Any], str | Cell]]


def tabulated(title: str, rows: Iterable[Any], columns: Sequence[Column], note: str = "", texts: int = 1) -> Table:
    """Table with a line for each row.

    Parameters
    ----------
    title : str
    rows : iterable
        Whatever the columns read, such as parts of a record.
    columns : sequence of (str, str or function)
        Head, and the key of a row or what makes its text or cell.
    note : str
        Below the table.
    texts : int
        Number of first columns that hold words.
    """

    def cell(row: Any, text: str | Callable[[Any], str | Cell]) -> Cell:
        made = str(row[text]) if isinstance(text, str) else text(row)
        return made if isinstance(made, Cell) else Cell(made)

    lines = tuple(tuple(cell(row, text) for _, text in columns) for row in rows)
    return Table(title, tuple(head for head, _ in columns), lines, note, texts)
