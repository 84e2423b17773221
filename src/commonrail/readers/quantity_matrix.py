"""Measured quantity maps as they come: a row for each point, or a matrix of pressures × energising times, either way.

Units are taken from the header, the corner or the lines above the numbers, never from the size of the numbers; which
axis of a matrix is which follows from where the units stand, and only if that is open from which way makes sense.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.errors import InputError
from commonrail.base.units import compatible, convert, fits
from commonrail.readers.columns import ChannelSheet, Column, Sheet, unit_of
from commonrail.readers.grid import Grid, numbers_of, refuse_longer_rows

MOST_HEADER = 30  # rows in which the header of a table is looked for
BAND = "_band_"  # in the names of columns that hold an edge of a band beside the quantity

KINDS = {"rail pressure": ("Pa",), "energising time": ("s",), "quantity": ("m3", "kg")}
FORM = "a table with a row for each point"
SENSIBLE = {"rail pressure": (2e6, 400e6), "energising time": (5e-6, 20e-3)}  # SI

# A unit in brackets, or after "in" or "/" at the end of a text.
_BRACKETED = re.compile(r"[\[(]([^\[\]()]+)[\])]")
_TRAILING = re.compile(r"(?:\bin|/|,)\s*([^\s/,]+(?:/\w+)?)\s*$")


@dataclass(frozen=True)
class GivenUnits:
    """Units that are stated by whoever reads a file; an empty one is taken from the file."""

    pressure: str = ""
    time: str = ""
    quantity: str = ""

    def by_kind(self) -> dict[str, str]:
        """Units by the kinds of `KINDS`."""
        return dict(zip(KINDS, (self.pressure, self.time, self.quantity), strict=True))


@dataclass(frozen=True)
class FoundMap:
    """Map found in a table, in the units of the file."""

    form: str  # what the table was taken for
    rail_pressure: Floats  # (n,) in `units`, as the next two
    energising_time: Floats
    quantity: Floats
    units: dict[str, str]  # by the names of `KINDS`
    said: tuple[str, ...]  # what else was taken or omitted
    lines: IndexArray  # (n,): line of the file, or row of the sheet, of each point

    @property
    def values(self) -> dict[str, Floats]:
        """Values (n,) by the names of `KINDS`."""
        return dict(zip(KINDS, (self.rail_pressure, self.energising_time, self.quantity), strict=True))

    @property
    def by_mass(self) -> bool:
        """True if the quantities are masses."""
        return compatible(self.units["quantity"], "kg")


def find_map(grid: Grid, given: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of a table.

    Units that are `given` count before those of the file. Raises `InputError` if none is found, or a unit is missing.
    """
    for i, header in enumerate(grid.rows[:MOST_HEADER]):
        columns = _columns(header, given)
        if columns is not None:
            units = [plain_unit(str(cell)) for cell in header if cell != ""]
            names = i - 1 if i and all(fits(unit, unit) for unit in units) else i
            refuse_longer_rows(grid, names, i + 1)
            return _long(grid, i + 1, columns)
    start = next((i for i, row in enumerate(grid.rows) if _is_numeric(row)), None)
    if start is None:
        raise InputError(f"{grid.path}: there are no rows of numbers.")
    return _matrix(grid, start, given)


def _is_numeric(row: Sequence[str | float]) -> bool:
    """At least two numbers and no text behind the first cell."""
    numbers = numbers_of(row[1:])
    return numbers is not None and int(np.isfinite(numbers).sum()) >= 2


def unit_in(text: str) -> list[str]:
    """Units that a text names, in its order."""
    found = [unit for unit in _BRACKETED.findall(text) if kind_of(unit)]
    if not found and (match := _TRAILING.search(text)) and kind_of(match[1]):
        found = [match[1]]
    return found or ([text] if kind_of(text) else [])


def kind_of(unit: str) -> str:
    """Kind of a map's quantity that a unit measures, empty if none."""
    return next((kind for kind, wanted in KINDS.items() if any(fits(plain_unit(unit), one) for one in wanted)), "")


def plain_unit(unit: str) -> str:
    """Name of a unit with signs that stand on every keyboard: us for µs."""
    return unit.strip().replace("µ", "u").replace("³", "3")


def _columns(header: Sequence[str | float], given: GivenUnits) -> dict[str, tuple[int, str]] | None:
    """Columns by kind with their units, if a row is the header or the row of units of a table of points."""
    stated = given.by_kind()
    found: dict[str, list[tuple[int, str]]] = {kind: [] for kind in KINDS}
    for i, cell in enumerate(header):
        if BAND in str(cell):
            continue
        for unit in unit_in(str(cell))[:1]:
            found[kind_of(unit)].append((i, stated[kind_of(unit)] or plain_unit(unit)))
    if all(len(places) == 1 for places in found.values()):
        return {kind: places[0] for kind, places in found.items()}
    return None


def _long(grid: Grid, start: int, columns: dict[str, tuple[int, str]]) -> FoundMap:
    rows: list[list[str | float]] = []
    lines: list[int] = []
    empty = 0
    for line, row in zip(grid.lines[start:], grid.rows[start:], strict=True):
        cells = [row[i] if i < len(row) else "" for i, _ in columns.values()]
        if line == grid.lines[start] and all(isinstance(cell, str) for cell in cells):
            continue  # units below the names
        if cells[2] == "" and all(isinstance(cell, float) for cell in cells[:2]):
            empty += 1
            continue
        if not all(isinstance(cell, float) for cell in cells):
            raise InputError(f"{grid.path}, line {line}: a number is expected in each of the columns that are used.")
        rows.append(cells)
        lines.append(line)
    if not rows:
        raise InputError(f"{grid.path}: there are no rows of numbers below the header.")
    pressure, time, quantity = np.array(rows, float).T
    units = {kind: unit for kind, (_, unit) in columns.items()}
    said = (*grid.said, *_omitted(empty))
    return FoundMap(FORM, pressure, time, quantity, units, said, np.array(lines))


def _omitted(empty: int) -> list[str]:
    return [f"{empty} without a quantity omitted"] if empty else []


def _matrix(grid: Grid, start: int, given: GivenUnits) -> FoundMap:
    """Matrix whose first row and first column are its axes."""
    across = numbers_of(grid.rows[start][1:])
    body = [(line, numbers_of(row)) for line, row in zip(grid.lines[start + 1 :], grid.rows[start + 1 :], strict=True)]
    for line, numbers in body:
        if numbers is None or len(numbers) > len(across or []) + 1 or not np.isfinite(numbers[0]):
            row = grid.rows[grid.lines.index(line)]
            text = next((f', and "{cell[:40]}" is none' for cell in row if isinstance(cell, str) and cell), "")
            raise InputError(
                f"{grid.path}, line {line}: a row of a map is expected, its place on the axis first and then "
                f"numbers{text}."
            )
    width = len(across or [])
    cells = np.array([(numbers or [])[1:] + [np.nan] * (width + 1 - len(numbers or [])) for _, numbers in body])
    if cells.size == 0 or not np.all(np.isfinite(across or [np.nan])):
        raise InputError(f"{grid.path}: no map is found: neither columns of pressure, time and quantity nor a matrix.")
    axes = np.array([(numbers or [np.nan])[0] for _, numbers in body]), np.array(across)
    units, order = _units(grid, start, given)
    turned = _pressures_across(grid, axes, units, order)
    down, right = (np.repeat(axes[0], width), np.tile(axes[1], len(axes[0])))
    pressure, time = (right, down) if turned else (down, right)
    lines = np.repeat([line for line, _ in body], width)
    points = pressure, time, cells.ravel(), lines
    return filled_points(grid.path, matrix_form("across" if turned else "down"), points, units, grid.said)


def matrix_form(way: str) -> str:
    """Form of a matrix whose rail pressures run `way`, "down" or "across"."""
    return f"a matrix with rail pressures {way} and energising times {'across' if way == 'down' else 'down'}"


def filled_points(
    path: Path,
    form: str,
    points: tuple[Floats, Floats, Floats, IndexArray],
    units: dict[str, str],
    said: Sequence[str],
) -> FoundMap:
    """Map of the points whose quantity is not NaN; `InputError` if there is none.

    `points` are rail pressures, energising times and quantities (n,) in `units`, and the line of each.
    """
    pressure, time, quantity, lines = points
    filled = np.isfinite(quantity)
    if not filled.any():
        raise InputError(f"{path}: the map holds no quantity; all its cells are empty.")
    said = (*said, *_omitted(int(np.count_nonzero(~filled))))
    return FoundMap(form, pressure[filled], time[filled], quantity[filled], units, said, lines[filled])


def _units(grid: Grid, start: int, given: GivenUnits) -> tuple[dict[str, str], list[str]]:
    """Units by kind, and the kinds in the order in which the corner names them."""
    corner = str(grid.rows[start][0])
    texts = [corner] + [str(c) for row in grid.rows[:start] for c in row if isinstance(c, str)] + list(grid.comments)
    units = {kind: unit for kind, unit in given.by_kind().items() if unit}
    stated = set(units)
    for text in texts:
        for unit in unit_in(text):
            kind = kind_of(unit)
            if kind not in stated and text not in grid.comments and not _alike(units.get(kind, unit), unit):
                raise InputError(
                    f'{grid.path}: the units "{units[kind]}" and "{unit}" of the {kind} contradict each other in the '
                    "corner or above the numbers; keep the right one, or state it."
                )
            units.setdefault(kind, unit)
    missing = [kind for kind in KINDS if kind not in units]
    if missing:
        named = [unit for text in texts for unit in _BRACKETED.findall(text)]
        unknown = [unit for unit in named if not fits(plain := plain_unit(unit), plain)]
        among = f' ("{unknown[0]}" is not a known unit)' if unknown else ""
        raise InputError(
            f"{grid.path}: no unit of the {' and the '.join(missing)} is in the header or the corner{among}; write "
            'them as in "rail pressure [MPa] \\ energising time [us]" and "quantity [mm3]" above, or state them.'
        )
    return {kind: plain_unit(unit) for kind, unit in units.items()}, [
        kind_of(unit) for unit in unit_in(corner) if kind_of(unit) != "quantity"
    ]


def _alike(first: str, second: str) -> bool:
    """Return whether two units are the same under different names."""
    one, other = plain_unit(first), plain_unit(second)
    return compatible(one, other) and math.isclose(float(convert(np.array(1.0), one, other)), 1.0, rel_tol=1e-9)


def _pressures_across(grid: Grid, axes: tuple[Floats, Floats], units: dict[str, str], order: list[str]) -> bool:
    """True if the rail pressures are in the first row: by the corner (down, then across), else by what makes sense."""
    if len(order) == 2:
        return order == ["energising time", "rail pressure"]
    sensible = [
        all(
            SENSIBLE[kind][0] <= value <= SENSIBLE[kind][1]
            for kind, axis, si in (("rail pressure", pressures, "Pa"), ("energising time", times, "s"))
            for value in convert(axis, units[kind], si).tolist()
        )
        for pressures, times in (axes, axes[::-1])
    ]
    if sensible[0] == sensible[1]:
        raise InputError(
            f"{grid.path}: it is open which axis is the rail pressure; write both names with their units into the "
            'corner, that of the rows first, as in "rail pressure [MPa] \\ energising time [us]".'
        )
    return sensible[1]


# Quantity map in the columns of a file with named and typed columns, found by their units whatever their names.


@runtime_checkable
class HoldsMap(Protocol):
    """File that finds a map in itself, where rows and columns do not tell, as in the variables of MATLAB."""

    def quantity_map(self, given: GivenUnits) -> FoundMap:
        """Quantity map of the file; `InputError` if it has none."""


def map_in(sheet: Sheet, given: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of a file with named columns or variables; units that are `given` count before those of the file.

    Raises `InputError` if none is found, or the columns have times of their own.
    """
    if isinstance(sheet, ChannelSheet):
        raise InputError(f"{sheet.path}: each channel of this record has its own times, so that it holds no map.")
    return sheet.quantity_map(given) if isinstance(sheet, HoldsMap) else find_column_map(sheet, given)


def find_column_map(file: Sheet, given: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of a file whose columns state their units.

    Units that are `given` count before those of the file. Raises `InputError` if not exactly one column has a unit of
    each kind, or a cell of them holds no number.
    """
    names = {kind: _column(file, kind) for kind in KINDS}
    stated = given.by_kind()
    units = {kind: stated[kind] or unit_of(file, name) for kind, name in names.items()}
    wanted = [Column(name, "1", required=kind != "quantity") for kind, name in names.items()]
    table = file.take(wanted)
    pressure, time, quantity = (table.columns[name] for name in names.values())
    said = ["columns " + ", ".join(f'"{name}"' for name in names.values())]
    return filled_points(file.path, FORM, (pressure, time, quantity, table.rows), units, said)


def _column(file: Sheet, kind: str) -> str:
    """Name of the only column with a unit of a kind."""
    found = [
        name for name in file.names if BAND not in name and (unit := unit_of(file, name)) and kind_of(unit) == kind
    ]
    if len(found) == 1:
        return found[0]
    raise InputError(
        f"{file.path}: {_shown(found)} the unit of a {kind}, and one column must have it; name columns as in "
        '"rail_pressure [MPa]", "energising_time [us]" and "quantity [mm3]".'
    )


def _shown(names: Sequence[str]) -> str:
    if not names:
        return "no column has"
    return "the columns " + " and ".join(f'"{name}"' for name in names[:4]) + " have"
