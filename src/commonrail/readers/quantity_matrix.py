"""Measured quantity maps as they come: a row for each point, or a matrix of pressures × energising times, either way.

A duration map, energising times over pressure and quantity as in control units, is read as the same points. Units are
taken from the header, the corner or the lines above the numbers, never from the size of the numbers; which axis of a
matrix is which follows from where the units are, and only if that is open from which way makes sense.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.errors import InputError
from commonrail.base.units import convert, fits, is_everyday, same_scale
from commonrail.readers.columns import (
    BAND,
    ChannelSheet,
    Column,
    Sheet,
    Table,
    find_column,
    find_headings,
    find_unit,
    is_heading,
    name_and_unit,
)
from commonrail.readers.grid import Grid, TooManyCells, read_numbers
from commonrail.readers.table_sheet import SAMPLE, TableSheet, find_header, join_heads

KINDS = {"rail pressure": ("Pa",), "energising time": ("s",), "quantity": ("m3", "kg")}
FORM = "a table with a row for each point"
SENSIBLE = {"rail pressure": (2e6, 400e6), "energising time": (5e-6, 20e-3), "quantity": (-1e-9, 100e-6)}  # SI
LARGEST_FLOW = 1e-3  # quantity over energising time of any injector [m³/s], chosen
_DENSITY = 830.0  # of fuel, to judge masses [kg/m³]
Order = tuple[str, str]  # kinds of a matrix's axes, down and across; its cells are the third one
ORDERS: list[Order] = [
    order for axis in ("energising time", "quantity") for order in (("rail pressure", axis), (axis, "rail pressure"))
]
# Sentence of maps that the product writes: cells from this time on are extrapolated.
LONGEST_SIMULATED = "longest simulated energising time: {:g} us"
_LONGEST = re.compile(LONGEST_SIMULATED.format(0).replace("0", r"(\d[\d.]*)"))
_NOT_SIMULATED = ("unreachable", "as before")  # in a column "state" of such a map
COLUMNS = [Column(kind.replace(" ", "_"), units) for kind, units in KINDS.items()]

_BRACKETED = re.compile(r"[\[(]([^\[\]()]+)[\])]")
_NUMBER = r"-?\d+(?:[.,]\d+)?"
# Place on an axis with its unit, in a cell of the header: "400 bar", "ET 300us".
_PLACE = re.compile(rf"(?<![\w.,])({_NUMBER})\s*([A-Za-zµμ]+(?:\s?\([a-z]+\))?)(?![\w/])")
# Conditions of the bench in lines above a map, by the keys of a study, with their SI units.
_NOTES = {
    "cylinder_pressure": (
        r"gegendruck|back\W?pressure|chamber pressure|kammerdruck|(zylinder|cylinder \W?)druck",
        "Pa",
    ),
    "return_pressure": (r"r(ü|ue)cklauf\W?druck|return (line )?pressure|leak\W?off pressure", "Pa"),
    "fuel_temperature": (r"temperatur|t_?(fuel|kraftstoff)\b", "K"),
}


@dataclass(frozen=True)
class GivenUnits:
    """Units that are stated by whoever reads a file; an empty one is taken from the file."""

    pressure: str = ""
    time: str = ""
    quantity: str = ""

    def by_kind(self) -> dict[str, str]:
        """Units by the kinds of `KINDS`."""
        return dict(zip(KINDS, (self.pressure, self.time, self.quantity), strict=True))


@dataclass
class FoundMap:
    """Map found in a table, in the units of the file: a `Sheet` whose quantity is in the `column` of that name."""

    path: Path
    form: str  # what the table was taken for
    rail_pressure: Floats  # (n,) in `units`, as the next two
    energising_time: Floats
    quantity: Floats
    units: dict[str, str]  # by the names of `KINDS`
    said: tuple[str, ...]  # what else was taken or omitted
    lines: IndexArray  # (n,): line of the file, or row of the sheet, of each point
    notes: Mapping[str, str] = field(default_factory=dict)  # of the bench above the map, by the keys of a study
    column: str = "quantity"
    durations: bool = False  # the file states energising times over quantities

    independent_columns: bool = False

    @property
    def kind(self) -> str:
        """Kind of map, in words."""
        return "a duration map" if self.durations else "a quantity map"

    @property
    def values(self) -> dict[str, Floats]:
        """Values (n,) by the names of `KINDS`."""
        return dict(zip(KINDS, (self.rail_pressure, self.energising_time, self.quantity), strict=True))

    @property
    def names(self) -> tuple[str, str, str]:
        """Names of the columns."""
        return "rail_pressure", "energising_time", self.column

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns; see `Sheet.take`."""
        kinds = dict(zip(self.names, KINDS, strict=True))
        names = [self.names[find_column(self.path, self.names, column.name)] for column in columns]
        numbers, units = ({name: by_kind[kinds[name]] for name in names} for by_kind in (self.values, self.units))
        return Table(self.path, numbers, {}, units, self.lines)  # type: ignore[arg-type]


class NearMap(InputError):
    """Fault of a table that is a quantity map but for what the message says."""


def find_map(grid: Grid, given_units: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of a table.

    `given_units` count before those of the file. Raises `InputError` if none is found, or a unit is missing.
    """
    try:
        sheet = TableSheet(grid)
        has_columns = len(find_headings(sheet, COLUMNS)) == len(COLUMNS)
    except InputError:
        has_columns = False
    if not has_columns:
        return _matrix(grid, given_units)
    try:
        column_map = find_column_map(sheet, given_units)
    except TooManyCells:
        raise
    except InputError as error:
        raise NearMap(str(error), code=error.code, file=error.file, place=error.place) from error
    return replace(column_map, said=(*grid.said, *column_map.said), notes=bench_notes(grid, sheet.first))


def bench_notes(grid: Grid, head: int) -> dict[str, str]:
    """Conditions of the bench that comments, and the rows above a head, state with their units."""
    rows = [" ".join(map(str, row)) for row in grid.rows[:head]]
    notes: dict[str, str] = {}
    for text in (*grid.comments, *rows):
        for key, (words, kind) in _NOTES.items():
            if key not in notes and (match := re.search(words, text, re.I)):
                rest = text[match.end() :]
                number = re.search(_NUMBER, rest)
                units = [*_BRACKETED.findall(rest), *re.split(r"[;,]", rest[number.end() if number else 0 :])]
                unit = next((unit for unit in units if is_everyday(unit) and fits(unit, kind)), "").strip()
                if number and unit:
                    notes[key] = f"{number[0].replace(',', '.')} {plain_unit(unit)}"
    return notes


def unit_in(text: str) -> list[str]:
    """Units that a text names, in its order."""
    units = [unit for unit in _BRACKETED.findall(text) if find_kind(unit)]
    units = units or [unit for unit in (name_and_unit(text)[1], text) if find_kind(unit)][:1]
    return units or [unit for piece in text.split("\\") if find_kind(unit := piece.strip())]


def find_kind(unit: str) -> str:
    """Kind of a map's quantity that a unit measures, empty if none."""
    return next(
        (kind for kind, si_units in KINDS.items() if any(fits(plain_unit(unit), si_unit) for si_unit in si_units)), ""
    )


def plain_unit(unit: str) -> str:
    """Name of a unit with signs that stand on every keyboard: us for µs."""
    return unit.strip().replace("µ", "u").replace("³", "3")


class _Axis(NamedTuple):
    """Places across a matrix and their columns, first rows of head and body, and texts: the corner's, then others."""

    places: Sequence[float]
    columns: Sequence[int]
    head: int
    start: int
    texts: list[str]
    unit: str = ""  # of places with their units
    said: str = ""


def _axis(grid: Grid) -> _Axis:
    """Axis across a matrix: a row of numbers above the others, or a header whose cells have a number and its unit."""
    first, start = find_header(grid.rows[:SAMPLE])
    names, units = join_heads(grid.rows[first:start]) if start else ([""], [])
    if heads := _heads(names[1:]):
        labels = [_PLACE.sub("", name).strip(" ,;:=@") for name in names[1:]]
        indices, said = _quantity_columns(grid, labels)
        corner = f"{names[0]} [{units[0]}]" if units and units[0] else names[0]
        texts = [corner, *(units[i + 1] for i in indices if units), *(labels[i] for i in indices)]
        places, above = [heads[0][i] for i in indices], _texts(grid.rows[:first])
        return _Axis(places, [i + 1 for i in indices], first, start, texts + above, heads[1], said)
    if _heads(names[2:]):
        raise NearMap(
            f'{grid.path}: the column "{names[0]}" is before that of the axis; remove columns of labels.',
            code="labels",
            file=grid.path,
        )
    numbers = (read_numbers(row[1:]) or [] for row in grid.rows)
    start = next((i for i, numbers_of_row in enumerate(numbers) if int(np.isfinite(numbers_of_row).sum()) >= 2), -1)
    if start < 0:
        raise InputError(f"{grid.path}: there are no rows of numbers.", code="empty", file=grid.path)
    above_axis = [str(cell) for cell in grid.rows[start - 1][1:] if cell != ""] if start else []
    if len({*above_axis}) > 1 and 2 * len(above_axis) > len(grid.rows[start]) - 1:
        fault = NearMap if all(re.search(r"(?<!\w)\d", name_and_unit(head)[0]) for head in above_axis) else InputError
        raise fault(
            f"{grid.path}, {grid.word} {grid.lines[start - 1]}: no map is found: "
            f'"{above_axis[0]}" and "{above_axis[1]}" are not places on an axis with units, such as "400 bar".',
            code="no-axis",
        )
    across = read_numbers(grid.rows[start][1:]) or []
    if not np.all(np.isfinite(across)):
        raise InputError(
            f"{grid.path}: no map is found: neither columns of pressure, time and quantity nor a matrix.",
            code="no-map",
            file=grid.path,
        )
    corner = str(grid.rows[start][0])
    return _Axis(across, range(1, len(across) + 1), start, start + 1, [corner, *_texts(grid.rows[:start])])


def _quantity_columns(grid: Grid, labels: Sequence[str]) -> tuple[list[int], str]:
    """Columns of the injected quantity among those of a matrix, and words on the others."""
    kinds = list(dict.fromkeys(labels))
    usual = [label for label in kinds if is_heading(name_and_unit(label)[0], "quantity")]
    if len(kinds) > 1 and len(usual) != 1:
        shown = " and ".join(f'"{label}"' for label in kinds[:4])
        raise NearMap(
            f"{grid.path}: the columns hold {shown} at each place; keep those of the injected quantity.",
            code="other-quantity",
            file=grid.path,
        )
    others = [label for label in kinds if len(kinds) > 1 and label != usual[0]]
    indices = [i for i, label in enumerate(labels) if label not in others]
    return indices, f"not read: {', '.join(others)}" if others else ""


def _texts(rows: Sequence[Sequence[str | float]]) -> list[str]:
    """Texts above a matrix, without the notes on the bench."""
    lines = [row for row in rows if not any(re.search(words, str(row), re.I) for words, _ in _NOTES.values())]
    return [cell for row in lines for cell in row if isinstance(cell, str)]


def _matrix(grid: Grid, given_units: GivenUnits) -> FoundMap:
    """Matrix whose first row and first column are its axes."""
    axis = _axis(grid)
    body = list(zip(grid.lines[axis.start :], grid.rows[axis.start :], strict=True))
    last, cells = max(axis.columns, default=0), np.full((len(body), len(axis.columns)), np.nan)
    down = np.full(len(body), np.nan)
    heads = _heads([str(row[0]) for _, row in body])
    head_units = {find_kind(unit): unit for unit in (heads and heads[1], axis.unit) if unit}
    fault = NearMap if head_units else InputError
    for i, (line, row) in enumerate(body):
        numbers = read_numbers((heads[0][i], *row[1:]) if heads else row)
        if numbers is None or (not axis.unit and len(numbers) > last + 1) or not np.isfinite(numbers[0]):
            text = next((f', and "{cell[:40]}" is none' for cell in row if isinstance(cell, str) and cell), "")
            raise fault(
                f"{grid.path}, {grid.word} {line}: a row of a map is expected, its place on the axis first and then "
                f"numbers{text}; remove rows of means and columns of labels.",
                code="not-a-number",
            )
        down[i] = numbers[0]
        filled = [column for column in axis.columns if column < len(numbers)]
        cells[i, : len(filled)] = [numbers[column] for column in filled]
    if not cells.size:
        raise InputError(
            f"{grid.path}: no map is found: neither columns of pressure, time and quantity nor a matrix.",
            code="no-map",
            file=grid.path,
        )
    units, orders, likely = _units(grid, axis, given_units, head_units)
    lines = np.repeat([line for line, _ in body], len(axis.columns))
    said = (*grid.said, axis.said) if axis.said else grid.said
    matrix = Matrix(down, np.array(axis.places), cells, lines)
    quantity_map = map_of_matrix(grid.path, matrix, units, orders, said, (*axis.texts, *grid.comments), likely)
    return replace(quantity_map, notes=bench_notes(grid, axis.head))


class Matrix(NamedTuple):
    """Axes down (n,) and across (m,), cells (n, m), and the line or number of each cell (n m,)."""

    down: Floats
    across: Floats
    cells: Floats
    lines: IndexArray


def map_of_matrix(
    path: Path,
    matrix: Matrix,
    units: dict[str, str],
    orders: Sequence[Order],
    said: Sequence[str] = (),
    texts: Iterable[str] = (),
    likely: Sequence[Order] = (),
) -> FoundMap:
    """Map of a matrix of quantities or of energising times.

    `units` are by the names of `KINDS`. `orders`: those of `ORDERS` that the file admits; of several, the numbers must
    make sense of one alone, else the `likely` one is taken. `said`: what was detected of the file, whose `texts` may
    state the longest simulated energising time. Raises `InputError` if it is open which axis is which, or no cell has
    a number; `path` is for messages.
    """
    if len(orders) > 1:
        sensible = [order for order in orders if _is_sensible(matrix, units, order)]
        orders = sensible if len(sensible) == 1 else likely
    if len(orders) != 1:
        raise InputError(
            f"{path}: it is open which axis is the rail pressure; write both names with their units into the "
            'corner, that of the rows first, as in "rail pressure [MPa] \\ energising time [us]".',
            code="open-axis",
            file=path,
        )
    kinds = orders[0]
    way = ("down", "across") if kinds[0] == "rail pressure" else ("across", "down")
    durations = "quantity" in kinds
    form = f"a matrix with rail pressures {way[0]} and {'quantities' if durations else 'energising times'} {way[1]}"
    return drop_empty_points(path, form, _by_kind(matrix, kinds), matrix.lines, units, said, durations, texts)


def _by_kind(matrix: Matrix, order: Order) -> dict[str, Floats]:
    """Values (n m,) of the cells by the names of `KINDS`."""
    down, across = np.repeat(matrix.down, len(matrix.across)), np.tile(matrix.across, len(matrix.down))
    values = {order[0]: down, order[1]: across}
    return {kind: values.get(kind, matrix.cells.ravel()) for kind in KINDS}


def _is_sensible(matrix: Matrix, units: dict[str, str], order: Order) -> bool:
    """Return whether pressures, times, quantities and the mean flows are of the size that injectors have."""
    si = {}
    for kind, values in _by_kind(matrix, order).items():
        unit = next(si for si in KINDS[kind] if fits(units[kind], si))
        with np.errstate(over="ignore"):
            si[kind] = convert(values, units[kind], unit) / (_DENSITY if unit == "kg" else 1.0)
    filled = np.isfinite(si["quantity"]) & (si["energising time"] > 0.0)
    pressure, time, quantity = (values[filled] for values in si.values())
    ranges = zip(SENSIBLE.values(), (pressure, time, quantity), strict=True)
    if not filled.any() or not all(np.all((low <= values) & (values <= high)) for (low, high), values in ranges):
        return False
    # of a duration map: the higher the pressure, the shorter the time of a quantity
    falls = "quantity" not in order or np.sum((pressure - pressure.mean()) * time) <= 0.0
    return bool(falls and np.all(quantity <= LARGEST_FLOW * time))


def drop_empty_points(
    path: Path,
    form: str,
    values: dict[str, Floats],
    lines: IndexArray,
    units: dict[str, str],
    said: Sequence[str],
    durations: bool = False,
    texts: Iterable[str] = (),
) -> FoundMap:
    """Map of the points that hold numbers; `InputError` if all are empty.

    `values` (n,) in `units` are by the names of `KINDS`, with the line of each. Of `durations`, cells without pressure,
    quantity or time are omitted, those whose time is that of another quantity at their pressure, and those from the
    longest simulated time on that the `texts` of the product's own maps state.
    """
    pressure, time, quantity = values.values()
    filled = np.isfinite(quantity) & np.isfinite(time)
    said = [*said]

    def omit(which: Bools, reason: str) -> None:
        nonlocal filled
        if count := np.count_nonzero(filled & which):
            said.append(f"{count} {reason} omitted")
        filled = filled & ~which

    if empty := np.count_nonzero(~filled):
        said.append(f"{empty} without a {'energising time' if durations else 'quantity'} omitted")
    if durations:
        omit((pressure <= 0.0) | (time <= 0.0) | (quantity <= 0.0), "of zero pressure, quantity or energising time")
        longest = min((float(match[1]) for text in texts if (match := _LONGEST.search(text))), default=np.inf)
        omit(convert(time, units["energising time"], "us") >= longest * (1.0 - 1e-9), "extrapolated")
        pairs = np.stack([pressure, time])[:, filled]
        places, counts = np.unique(pairs, axis=1, return_inverse=True, return_counts=True)[1:]
        repeated = np.zeros(len(filled), bool)
        repeated[filled] = counts[places.ravel()] > 1
        omit(repeated, "with the energising time of another quantity at their pressure")
    if not filled.any():
        raise InputError(f"{path}: the map holds no quantity; all its cells are empty.", code="empty", file=path)
    points = (pressure[filled], time[filled], quantity[filled])
    return FoundMap(path, form, *points, units, tuple(said), lines[filled], durations=durations)


def _heads(cells: Sequence[str]) -> tuple[list[float], str] | None:
    """Places on an axis that cells state with their unit, "400 bar", in the unit of the first; None for other cells."""
    places = [_PLACE.search(cell) for cell in cells]
    kinds = {find_kind(place[2]) if place else "" for place in places}
    if len(places) < 2 or len(kinds) > 1 or "" in kinds:
        return None
    texts = [(place[1].replace(",", "."), place[2]) for place in places if place]
    return [convert(float(number), unit, texts[0][1]) for number, unit in texts], texts[0][1]


def _units(
    grid: Grid, axis: _Axis, given_units: GivenUnits, head_units: Mapping[str, str]
) -> tuple[dict[str, str], list[Order], list[Order]]:
    """Units by kind, admitted orders of the axes, and the likely one of them; `head_units`: units of heads by kind."""
    units = {kind: unit for kind, unit in given_units.by_kind().items() if unit} | dict(head_units)
    stated = set(units)
    for text in (*axis.texts, *grid.comments):
        for unit in unit_in(text):
            kind = find_kind(unit)
            is_free = kind not in stated and text not in grid.comments
            if is_free and not same_scale(units.get(kind, unit), unit):
                raise InputError(
                    f'{grid.path}: the units "{units[kind]}" and "{unit}" of the {kind} contradict each other in the '
                    "corner or above the numbers; keep the right one, or state it.",
                    code="conflict",
                    file=grid.path,
                )
            units.setdefault(kind, unit)
    kinds = list(dict.fromkeys(find_kind(unit) for unit in unit_in(axis.texts[0])))
    missing = [kind for kind in KINDS if kind not in units]
    if missing:
        bracketed = [unit for text in axis.texts for unit in _BRACKETED.findall(text)]
        unknown = [unit for unit in bracketed if not fits(plain := plain_unit(unit), plain)]
        among = f' ("{unknown[0]}" is not a known unit)' if unknown else ""
        raise (NearMap if head_units or len(kinds) > 1 else InputError)(
            f"{grid.path}: no unit of the {' and the '.join(missing)} is in the header or the corner{among}; write "
            'them as in "rail pressure [MPa] \\ energising time [us]" and "quantity [mm3]" above, or state them.'
        )
    if len(kinds) > 2 or (head_units and "energising time" in kinds):  # the unit of the cells is there too
        kinds = [kind for kind in kinds if kind != "quantity"]
    orders = [order for order in ORDERS if list(order) == kinds] or ORDERS
    if head_units:  # in one or both directions
        ends = [(i, kind) for kind in head_units for i in (0, 1) if (kind == find_kind(axis.unit)) == bool(i)]
        orders = [order for order in ORDERS if all(order[i] == kind for i, kind in ends)]
        if "energising time" in kinds and "energising time" not in head_units:
            orders = [order for order in orders if "energising time" in order]
    # a corner with one unit names the rows, unless the numbers tell
    by_name = [order for order in orders if kinds == [order[0]] and order[0] != "quantity"]
    return (
        {kind: plain_unit(unit) for kind, unit in units.items()},
        orders,
        (by_name or (orders if head_units else []))[:1],
    )


# Quantity map in the columns of a file with named and typed columns, found by their units whatever their names.


@runtime_checkable
class HoldsMap(Protocol):
    """File that finds a map in itself, where rows and columns do not tell, as in the variables of MATLAB."""

    def quantity_map(self, given_units: GivenUnits) -> FoundMap:
        """Quantity map of the file; `InputError` if it has no map."""


@runtime_checkable
class HoldsOnlyMaps(HoldsMap, Protocol):
    """File with maps and no columns: its kind in words, each map by its label, and comments."""

    taken_for: str
    facts: dict[str, str]
    comments: Sequence[str]


def map_in(sheet: Sheet, given_units: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of a file with named columns or variables; `given_units` count before those of the file.

    Raises `InputError` if none is found, or the columns have times of their own.
    """
    if isinstance(sheet, ChannelSheet):
        raise InputError(
            f"{sheet.path}: each channel of this record has its own times, so that it holds no map.",
            code="several-times",
            file=sheet.path,
        )
    return sheet.quantity_map(given_units) if isinstance(sheet, HoldsMap) else find_column_map(sheet, given_units)


def find_column_map(file: Sheet, given_units: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of a file with a row for each point, its columns by usual headings or by their units.

    `given_units` count before those of the file. Raises `InputError` if a column is missing or may be one of
    several, or a cell of it holds no number.
    """
    names = find_headings(file, COLUMNS)
    for column, kind in zip(COLUMNS, KINDS, strict=True):
        if column.name not in names:
            fitting = [name for name in file.names if BAND not in name and find_kind(find_unit(file, name)) == kind]
            quoted = " and ".join(f'"{name}"' for name in fitting[:4])
            those = f"the columns {quoted} have" if fitting else "no column has"
            raise InputError(
                f"{file.path}: {those} the unit of a {kind}, and one column must have it; name columns as in "
                '"rail_pressure [MPa]", "energising_time [us]" and "quantity [mm3]".',
                code="open-column",
                file=file.path,
            )
    stated = given_units.by_kind().values()
    units = {
        kind: unit or find_unit(file, name) for kind, unit, name in zip(KINDS, stated, names.values(), strict=True)
    }
    if lacking := [kind for kind, unit in units.items() if find_kind(unit) != kind]:
        raise NearMap(
            f"{file.path}: no unit of the {' and the '.join(lacking)} is in the header; write or state it.",
            code="no-unit",
            file=file.path,
        )
    columns = [Column(name, "1", required=i == 0) for i, name in enumerate(names.values())]
    states = [Column("state")] if "state" in file.names else []  # of a map that the product has written
    table = file.take([*columns, *states])
    values = {kind: table.columns[name] for kind, name in zip(KINDS, names.values(), strict=True)}
    durations = _is_grid_of_quantities(values)
    if not durations and np.isnan(time := values["energising time"]).any():
        raise table.place(names["energising_time"], int(np.argmax(np.isnan(time)))).error(
            "the cell is empty, and a number is expected", code="empty-cell"
        )
    said = ["columns " + ", ".join(f'"{name}"' for name in names.values())]
    others = [f'"{name}"' for name in file.names if name not in names.values() and name and BAND not in name]
    said += [f"not used: {', '.join(others[:12])}"] if others else []
    simulated = np.array([text not in _NOT_SIMULATED for text in table.texts.get("state", [""] * len(table.rows))])
    if not simulated.all():
        said.append(f"{np.count_nonzero(~simulated)} not simulated omitted")
        values = {kind: column[simulated] for kind, column in values.items()}
    plain = {kind: plain_unit(unit) for kind, unit in units.items()}
    return drop_empty_points(file.path, FORM, values, table.rows[simulated], plain, said, durations, table.comments)


def _is_grid_of_quantities(values: dict[str, Floats]) -> bool:
    """Return whether rows hold each of several quantities once at each of several pressures, as a duration map does."""

    def is_product(kind: str) -> bool:
        pairs = np.stack([values["rail pressure"], values[kind]])
        sizes = [len(np.unique(axis)) for axis in pairs]
        return min(sizes) > 1 and len(np.unique(pairs, axis=1).T) == pairs.shape[1] == sizes[0] * sizes[1]

    return is_product("quantity") and not is_product("energising time")
