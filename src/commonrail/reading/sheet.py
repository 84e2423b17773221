"""Columns as they stand in a file, of whatever format, before their units are known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError, nearest
from commonrail.parts.furniture import Domain

__all__ = ["Cells", "Column", "Sheet", "find_column", "name_and_unit"]

MOST_SHOWN = 12  # names of a header


class Column(NamedTuple):
    """Column that is asked of a file.

    Attributes
    ----------
    name : str
    unit : str or tuple of str
        SI unit of the values; of several the one of the column's kind is taken. Empty: the cells are texts.
    stated : str or None
        Unit of a column for which the file gives none.
    increasing : bool
        Whether the values must increase from row to row, as a time does.
    domain : Domain
        Values outside are refused.
    required : bool
        Whether every cell must hold a number; if not, an empty one is NaN.
    """

    name: str
    unit: str | tuple[str, ...] = ""
    stated: str | None = None
    increasing: bool = False
    domain: Domain = Domain.ANY
    required: bool = True

    @property
    def units(self) -> tuple[str, ...]:
        """SI units that are accepted, none of texts."""
        return (self.unit,) if isinstance(self.unit, str) and self.unit else tuple(self.unit)


class Cells(NamedTuple):
    """Content of some columns by name.

    Attributes
    ----------
    units : dict of str to str
        Unit that the file gives, empty if it gives none.
    numbers : dict of str to (rows,) array
        In those units.
    texts : dict of str to list of str
        Columns without a unit.
    rows : (rows,) array of int
        Number of each row in the file.
    row : str
        Word for a row in messages.
    comments : tuple of str
    """

    units: dict[str, str]
    numbers: dict[str, NDArray[np.float64]]
    texts: dict[str, list[str]]
    rows: NDArray[np.intp]
    row: str = "line"
    comments: tuple[str, ...] = ()


class Sheet(Protocol):
    """File with named columns."""

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def names(self) -> Sequence[str]:
        """Names of its columns, without their units."""

    def take(self, columns: Sequence[Column]) -> Cells:
        """Content of columns; may be called once.

        Raises
        ------
        InputError
            If a column is missing or there twice, or a cell is no number.
        """


def name_and_unit(cell: str) -> tuple[str, str]:
    """Name and unit of a cell of a header, ``rate [mm3/ms]``; the unit is empty if there is none."""
    if not cell.endswith("]") or "[" not in cell:
        return cell, ""
    name, _, unit = cell[:-1].rpartition("[")
    return name.strip(), unit.strip()


def find_column(path: Path, names: Sequence[str], column: str, what: str = "") -> int:
    """Index of a column among the names of a file.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Names of the columns, without their units.
    column : str
    what : str
        What the column is for, said where it is missing.

    Raises
    ------
    InputError
        If it is not there, or there twice.
    """
    count = names.count(column)
    if count == 1:
        return names.index(column)
    if count > 1:
        raise InputError(f'{path}: the column "{column}" stands {count} times in the header; rename one.')
    known = ", ".join(f'"{name}"' for name in names[:MOST_SHOWN]) + (", …" if len(names) > MOST_SHOWN else "")
    round_ = next((name for name in names if name.endswith(")") and name.partition("(")[0].strip() == column), "")
    cure = f'; write the unit of "{round_}" in square brackets' if round_ else ""
    raise InputError(
        f'{path}: there is no column "{column}"{what and f", {what}"}{nearest(column, names)}; '
        f"the header has {known}{cure}."
    )
