"""Measured columns from CSV text: every number with its unit, every fault with its line and column.

A file may begin with comment lines (``#``), then has one header row. The unit of a column stands in the
header, ``rate [mm3/ms]``, in a row of units below it, or is stated by whoever reads the file; it is
never guessed from a name.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError, nearest
from commonrail.files.csv_rows import read_rows
from commonrail.kinds.reading import LEAST_SAMPLES
from commonrail.unit_table import NAMES
from commonrail.units import compatible, convert

__all__ = ["Table", "read_columns"]

Floats = NDArray[np.float64]
Units = str | tuple[str, ...]

LONGEST_NUMBER = 100  # [characters]
_BINARY = {".mf4": "MDF4", ".mdf": "MDF", ".mat": "MATLAB", ".nc": "NetCDF", ".xlsx": "Excel", ".xls": "Excel"}


@dataclass(frozen=True)
class Table:
    """Columns of a file.

    Attributes
    ----------
    path : Path
    columns : dict of str to (rows,) array
        SI values.
    units : dict of str to str
        SI unit of each column, where several kinds were allowed.
    given : dict of str to str
        Unit of each column as the file or whoever reads it states it.
    lines : (rows,) array of int
        Line in the file of each row.
    comments : tuple of str
        Comment lines without their sign.
    """

    path: Path
    columns: dict[str, Floats]
    units: dict[str, str]
    given: dict[str, str]
    lines: NDArray[np.intp]
    comments: tuple[str, ...]

    def cell(self, column: str, row: int) -> str:
        """Where a value stands, for a message."""
        return _cell(self.path, int(self.lines[row]), column)


def read_columns(
    path: Path,
    wanted: Mapping[str, Units],
    *,
    stated: Mapping[str, str | None] | None = None,
    increasing: str = "",
    least: int = LEAST_SAMPLES,
) -> Table:
    """Read named columns of a CSV file.

    Parameters
    ----------
    path : Path
        Text in UTF-8; cells separated by commas, semicolons or tabs; decimal points.
    wanted : mapping of str to str or tuple of str
        Name of each column, and the SI unit it is wanted in; of several the one of its kind is taken.
    stated : mapping of str to str or None, optional
        Units of columns whose file gives none.
    increasing : str
        Column that must increase from row to row: a time.
    least : int
        Rows that the file must have.

    Returns
    -------
    Table

    Raises
    ------
    InputError
        If the file cannot be read, a column or unit is missing, or a cell is not a finite number.
    """
    if path.suffix.lower() in _BINARY:
        raise InputError(
            f"{path}: {_BINARY[path.suffix.lower()]} files are not read; export the columns to a CSV file."
        )
    rows = read_rows(path)
    names, in_header = (list(parts) for parts in zip(*map(_name_and_unit, rows.header), strict=True))
    places = {column: _find(path, column, names) for column in wanted}
    first = next(rows.rows, None)
    units = _units_row(first, [i for i in places.values() if not in_header[i]])
    body = rows.rows if first is None or units else chain((first,), rows.rows)
    lines, numbers = _numbers(path, body, places)
    if len(lines) < least:
        raise InputError(f"{path}: the file has {len(lines)} rows of numbers, and at least {least} are needed.")
    columns: dict[str, Floats] = {}
    kinds: dict[str, str] = {}
    own: dict[str, str] = {}
    for column, place in places.items():
        written, said = (units or in_header)[place], (stated or {}).get(column)
        given = own[column] = _unit(path, column, (written, said), wanted[column])
        kinds[column] = _kind(path, column, given, wanted[column])
        with np.errstate(over="ignore"):  # _check_finite names the line
            columns[column] = convert(numbers[column], given, kinds[column], f'{path}, column "{column}"')
    table = Table(path, columns, kinds, own, lines, tuple(rows.comments))
    for column in columns:
        _check_finite(table, column)
    if increasing:
        _check_increasing(table, increasing)
    return table


def _numbers(
    path: Path, rows: Iterator[tuple[int, list[str]]], places: Mapping[str, int]
) -> tuple[NDArray[np.intp], dict[str, Floats]]:
    """Lines of the rows, and the numbers of the columns at the places; the other cells are let go at once."""
    lines = array("q")
    numbers = {column: array("d") for column in places}
    for line, row in rows:
        lines.append(line)
        for column, place in places.items():
            numbers[column].append(_number(path, line, column, row[place]))
    return np.array(lines, np.intp), {column: np.array(values) for column, values in numbers.items()}


def _name_and_unit(cell: str) -> tuple[str, str]:
    """``rate [mm3/ms]`` as name and unit, the unit empty if there is none."""
    if not cell.endswith("]") or "[" not in cell:
        return cell, ""
    name, _, unit = cell[:-1].rpartition("[")
    return name.strip(), unit.strip()


def _find(path: Path, column: str, names: Sequence[str]) -> int:
    count = names.count(column)
    if count == 0:
        known = ", ".join(f'"{name}"' for name in names[:12]) + (", …" if len(names) > 12 else "")
        round_ = next((name for name in names if name.endswith(")") and name.partition("(")[0].strip() == column), "")
        cure = f'; write the unit of "{round_}" in square brackets' if round_ else ""
        raise InputError(
            f'{path}: there is no column "{column}"{nearest(column, names)}; the header has {known}{cure}.'
        )
    if count > 1:
        raise InputError(f'{path}: the column "{column}" stands {count} times in the header; rename one.')
    return names.index(column)


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


def _example(wanted: Units) -> str:
    """Units that people write for what is wanted, "mm3/ms or mg/ms"."""
    choices = (wanted,) if isinstance(wanted, str) else wanted
    return " or ".join(NAMES[choice][1].partition(" ")[2] if choice in NAMES else choice for choice in choices)


def _unit(path: Path, column: str, found: tuple[str, str | None], wanted: Units) -> str:
    """Unit of a column, of what is written in the file and what is stated elsewhere."""
    written, stated = found
    if written and stated and written != stated:
        raise InputError(
            f'{path}, column "{column}": the file gives the unit "{written}", the study "{stated}"; keep one of them.'
        )
    if not (written or stated):
        raise InputError(
            f'{path}, column "{column}": there is no unit; write it in the header, as in '
            f'"{column} [{_example(wanted).split()[0]}]", or state it in the study.'
        )
    return written or stated or ""


def _kind(path: Path, column: str, unit: str, wanted: Units) -> str:
    """The wanted unit that measures the same kind of quantity as the column's own."""
    choices = (wanted,) if isinstance(wanted, str) else wanted
    where = f'{path}, column "{column}"'
    try:
        fitting = [choice for choice in choices if compatible(unit, choice)]
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    if not fitting:
        raise InputError(f'{where}: a unit like {_example(wanted)} is expected, not "{unit}".')
    return fitting[0]


def _number(path: Path, line: int, column: str, cell: str) -> float:
    text = cell.strip()
    try:
        value = float(text) if len(text) <= LONGEST_NUMBER else math.nan
    except ValueError:
        value = math.nan
    if math.isfinite(value) and "_" not in text:
        return value
    where = _cell(path, line, column)
    if not text:
        raise InputError(f"{where}: the cell is empty, and a number is expected.")
    if re.fullmatch(r"[+-]?\d+,\d+", text):
        raise InputError(f'{where}: "{text}" has a decimal comma; write the decimal sign as a point.')
    raise InputError(f'{where}: "{text[:40]}" is not a finite number.')


def _check_finite(table: Table, column: str) -> None:
    """Refuse what has grown too large for a number when it became SI."""
    beyond = np.flatnonzero(~np.isfinite(table.columns[column]))
    if len(beyond):
        raise InputError(f"{table.cell(column, int(beyond[0]))}: the number is too large for its unit.")


def _check_increasing(table: Table, column: str) -> None:
    steps = np.diff(table.columns[column])
    if np.all(steps > 0.0):
        return
    row = int(np.argmax(steps <= 0.0)) + 1
    what = "repeats" if steps[row - 1] == 0.0 else "runs back behind"
    raise InputError(
        f"{table.cell(column, row)}: this {column} {what} the one on line {table.lines[row - 1]}; it must "
        f"increase from row to row{_exchanged(table, column)}."
    )


def _exchanged(table: Table, column: str) -> str:
    """Cure where another column increases as this one should."""
    others = (name for name, values in table.columns.items() if name != column and np.all(np.diff(values) > 0.0))
    other = next(others, "")
    return f', as the column "{other}" does: the two may be exchanged in the header' if other else ""


def _cell(path: Path, line: int, column: str) -> str:
    return f'{path}, line {line}, column "{column}"'
