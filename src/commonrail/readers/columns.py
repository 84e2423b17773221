"""Columns as they stand in a file, of whatever format, before their units are known."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import AfterValidator, Field

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.errors import InputError, nearest
from commonrail.physics.law import Domain
from commonrail.readers.location import Place
from commonrail.readers.toml import FileModel, fault

# Form of a data file where its bytes do not tell it: encoding and decimal sign of a text, sheet of a workbook.


class FileForm(NamedTuple):
    """Form of a file, as stated by whoever reads it.

    The encoding and the decimal sign, "." or ",", are those of a text, the sheet that of a workbook; empty ones
    stand for UTF-8 and for the first sheet that is not empty.
    """

    encoding: str = ""
    decimal: str = "."
    sheet: str = ""


PLAIN = FileForm()

# Encodings of Python for names of hosts and for literals: no file of measurements has them.
_NOT_OF_FILES = ("idna", "punycode", "raw-unicode-escape", "undefined", "unicode-escape", "unicode_escape")


def check_encoding(name: str, at: str) -> str:
    """Return the name of an encoding of texts.

    Raises `InputError` if there is none of that name; `at` is the place where it was stated.
    """
    if reason := _refusal(name):
        raise InputError(f"{at}: {reason}.")
    return name


def _refusal(name: str) -> str:
    """Reason why a name is none of an encoding of texts, empty if it is one."""
    try:
        found = codecs.lookup(name)
    except (LookupError, ValueError):  # a null character
        return f'there is no encoding "{name}"; write utf-8, utf-16 or cp1252'
    if not getattr(found, "_is_text_encoding", True) or found.name in _NOT_OF_FILES:
        return f'"{name}" is no encoding of texts; write utf-8, utf-16 or cp1252'
    return ""


def _encoding(name: str) -> str:
    if reason := _refusal(name):
        raise fault(reason)
    return name


class FormModel(FileModel):
    """Keys that state the form of the table's file."""

    encoding: Annotated[str, Field(max_length=40), AfterValidator(_encoding)] | None = None
    decimal: Literal[".", ","] = "."
    sheet: str | None = None

    @property
    def form(self) -> FileForm:
        """The form that the keys state."""
        return FileForm(self.encoding or "", self.decimal, self.sheet or "")


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
    otherwise : str
        Unit of a column that has none and for which none is stated; empty refuses it.
    """

    name: str
    unit: str | tuple[str, ...] = ""
    stated: str | None = None
    increasing: bool = False
    domain: Domain = Domain.ANY
    required: bool = True
    otherwise: str = ""

    @property
    def units(self) -> tuple[str, ...]:
        """SI units that are accepted, none of texts."""
        return (self.unit,) if isinstance(self.unit, str) and self.unit else tuple(self.unit)


@dataclass(frozen=True)
class Table:
    """Columns of a file.

    Attributes
    ----------
    path : Path
    columns : dict of str to (rows,) array
        Numbers: in the units of the file from a `Sheet`, SI values from `read_columns`.
    texts : dict of str to list of str
        Columns without a unit.
    given : dict of str to str
        Unit of each column as the file or whoever reads it states it, empty if nobody does.
    rows : (rows,) array of int
        Line in the file of each row.
    comments : tuple of str
        Comment lines without their sign.
    row : str
        Word for a row in messages.
    units : dict of str to str
        SI unit of each column, where several kinds were allowed.
    """

    path: Path
    columns: dict[str, Floats]
    texts: dict[str, list[str]]
    given: dict[str, str]
    rows: IndexArray
    comments: tuple[str, ...] = ()
    row: str = "line"
    units: dict[str, str] = field(default_factory=dict)

    def place(self, column: str, row: int) -> Place:
        """Place of a value, for a message."""
        return cell_place(self.path, int(self.rows[row]), column, self.row)


class Sheet(Protocol):
    """File with named columns, of whatever format.

    Attributes
    ----------
    path : Path
    apart : bool
        Whether columns have times of their own: then each is taken with the time alone, any number of times.
    """

    path: Path
    apart: bool

    @property
    def names(self) -> Sequence[str]:
        """Names of the columns, without their units."""

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns in the units of the file; once only, unless `apart`."""


def unit_of(sheet: Sheet, name: str) -> str:
    """Unit of a column as the file states it; empty if it does not, or the format has no `unit`."""
    unit = getattr(sheet, "unit", None)
    return "" if unit is None else str(unit(name))


def cell_place(path: Path, row: int, column: str, word: str = "line") -> Place:
    """Place of a cell."""
    return Place(str(path), f'{word} {row}, column "{column}"')


LARGEST = 1e100  # number that is read from a file; the squares of larger numbers overflow


def finite(table: Table, wanted: Sequence[Column], sentence: str) -> Table:
    """The table, refused with a sentence at the first number that is not finite or beyond `LARGEST`.

    NaN passes where no number is required.
    """
    for column in wanted:
        if column.unit:
            values = table.columns[column.name]
            sound = np.abs(values) <= LARGEST
            wrong = np.flatnonzero(~sound if column.required else ~(sound | np.isnan(values)))
            if len(wrong):
                raise table.place(column.name, int(wrong[0])).error(sentence)
    return table


def name_and_unit(cell: str) -> tuple[str, str]:
    """Name and unit of a cell of a header, ``rate [mm3/ms]``; the unit is empty if there is none."""
    if not cell.endswith("]") or "[" not in cell:
        return cell, ""
    name, _, unit = cell[:-1].rpartition("[")
    return name.strip(), unit.strip()


def find_column(path: Path, names: Sequence[str], column: str, what: str = "") -> int:
    """Index of a column among the names of a file.

    `names`: names of the columns, without their units. `what`: what the column is for, said where it is missing. Raises
    `InputError` if it is not there, or there twice.
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
