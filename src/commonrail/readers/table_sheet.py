"""Named columns of a grid of cells: where its header is, and the numbers and texts below it.

One header row, which may be below other texts; the unit of a column is in it, ``rate [mm3/ms]``, or in the row below.
"""

from __future__ import annotations

import math
import re
import sys
from array import array
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.csv_output import restore, restore_note
from commonrail.base.errors import InputError
from commonrail.base.units import fits, read_decimal
from commonrail.physics.law import Domain
from commonrail.readers.columns import LARGEST, PLAIN, Column, FileForm, Table, cell_place, find_column, name_and_unit
from commonrail.readers.grid import MOST_COMMENTS, Grid, check_width, filled_width, read_grid
from commonrail.readers.location import LONGEST_NAME, check_columns, read_bytes
from commonrail.readers.text import (
    LONGEST_NUMBER,
    Cell,
    NumberedRows,
    has_decimal_comma,
    is_number,
    number_lines,
    split_lines,
)

MOST_ROWS = 1_000_000  # one second at 1 MHz
LARGEST_PLAIN = 1_000_000_000  # file that the program has written, such as the curves of a large study [bytes]
SAMPLE = 300  # rows in which the header of a table is looked for
MOST_HEADS = 3  # rows of names and units
FEWEST = 0.2  # least share of the largest count of numbers below a header, for a header to be accepted

# A row above the numbers in which instruments state the unit of an axis: "Vertical Units,V".
_AXIS_UNIT = re.compile(r"(horizontal|vertical|x|y)[ _-]?units?", re.I)


class TableSheet:
    """Columns of a grid, a `Sheet`.

    At most `most` rows are read. Raises `InputError` if the grid has no header or too many columns. A row with too many
    cells, or one row too many, raises an error when it is read.
    """

    independent_columns = False

    def __init__(self, grid: Grid, most: int = MOST_ROWS) -> None:
        self.path, self.grid, self._most = grid.path, grid, most
        sample = [row for _, row in islice(grid.each(), SAMPLE)]
        self.first, self._start = find_header(sample)
        heads = sample[self.first : self._start] or _columns_after_settings(sample)
        if not heads:
            raise InputError(
                f"{self.path}: the table has no header row with the names of columns above its numbers.",
                code="no-header",
                file=self.path,
            )
        self.header, below = join_heads(heads)
        _check_header(grid.path, self.header)
        names_and_units = [name_and_unit(cell) for cell in self.header]
        self.names = [name for name, _ in names_and_units]
        self._units = (
            [below[i] or unit for i, (_, unit) in enumerate(names_and_units)]
            if below
            else [unit for _, unit in names_and_units]
        )
        if not any(self._units):
            self._units = _axis_units(sample[: self.first], len(self.names))
        self._width = max(map(filled_width, heads))
        above = tuple(cell for row in sample[: self.first] for cell in row if isinstance(cell, str) and cell)
        self.comments: Sequence[str] = (*grid.comments, *above)

    @property
    def rows(self) -> NumberedRows:
        """Lines and cells below the header."""
        for count, (line, row) in enumerate(islice(self.grid.each(), self._start, None), start=1):
            check_width(self.grid, line, row, self._width)
            if count > self._most:
                raise InputError(
                    f"{self.path}, {self.grid.word} {line}: the file has more than the {self._most} rows that are "
                    "read; keep only what is needed.",
                    code="too-many",
                    file=self.path,
                )
            yield line, row

    def unit(self, name: str) -> str:
        """Unit of a column in the header, or empty."""
        return self._units[self.names.index(name)]

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns; see `Sheet.take`."""
        places = [find_column(self.path, self.names, column.name) for column in columns]
        lines = array("q")
        cells: list[Any] = [array("d") if column.unit else [] for column in columns]
        targets = list(zip(columns, places, cells, strict=True))
        for line, row in self.rows:
            lines.append(line)
            for column, i, content in targets:
                cell = row[i] if i < len(row) else ""
                # a text is one of the same few names in every row
                content.append(self._number(cell, column, line) if column.unit else sys.intern(str(cell)))
        content = {column.name: values for column, values in zip(columns, cells, strict=True)}
        return Table(
            self.path,
            {c.name: np.array(content[c.name], np.float64) for c in columns if c.unit},
            {c.name: content[c.name] for c in columns if not c.unit},
            {column.name: self._units[i] for column, i in zip(columns, places, strict=True)},
            np.array(lines, np.intp),
            tuple(self.comments),
            self.grid.word,
        )

    def _number(self, cell: Cell, column: Column, line: int) -> float:
        if not isinstance(cell, str):
            text, value = f"{cell:g}", cell
        else:
            # "nan" pads columns of shorter curves; a missing value of a column with a domain must be an empty cell.
            text = cell.strip()
            if not column.required and (text == "" or (text == "nan" and column.domain is Domain.ANY)):
                return math.nan
            value = _read(text, self.grid.comma)
        if abs(value) <= LARGEST:
            return value
        at = cell_place(self.path, line, column.name, self.grid.word)
        if math.isfinite(value):
            raise at.error(f'"{text}" is larger than any measured value', code="out-of-range")
        if not text:
            raise at.error("the cell is empty, and a number is expected", code="empty-cell")
        if re.fullmatch(r"[+-]?\d{1,3}( \d{3})+\S*", text):
            raise at.error(f'"{text}" has a space; write thousands without one', code="space")
        if has_decimal_comma(text):
            raise at.error(f'"{text}" has a decimal comma; write the decimal sign as a point', code="decimal-comma")
        cure = "; write what follows ± in a column of its own" if "±" in text else ""
        raise at.error(f'"{text[:40]}" is not a finite number{cure}', code="not-a-number")


def _read(text: str, comma: bool) -> float:
    """Number of a text, else NaN."""
    try:
        return read_decimal(text.replace(",", ".") if comma else text) if len(text) <= LONGEST_NUMBER else math.nan
    except ValueError:
        return math.nan


def open_table(path: Path, form: FileForm = PLAIN) -> TableSheet:
    """Columns of a text or of a sheet of a workbook, whose form is detected unless it is stated."""
    return TableSheet(read_grid(path, form))


class WrittenTable(TableSheet):
    """Columns of a CSV file that the program has written: the first row is the header, names and texts are as written.

    Comments are above the header only.
    """

    def __init__(self, path: Path, *, most: int = MOST_ROWS) -> None:
        data = read_bytes(path, LARGEST_PLAIN)
        self._most, comments = most, list[str]()
        begin = 0
        for number, line in number_lines(path, data):
            if line.lstrip()[:1] not in ("#", ""):
                break
            begin = number
            if line.strip() and len(comments) < MOST_COMMENTS:
                comments.append(restore_note(line.lstrip()[1:].strip()))

        def each() -> NumberedRows:
            lines = ((n, line) for n, line in number_lines(path, data) if n > begin and line.strip())
            width = 0
            for line, row in split_lines(path, lines, ",", plain=True):
                width = width or len(row)
                if len(row) != width:
                    raise InputError(
                        f"{path}, line {line}: the row has {len(row)} cells, the header {width}.",
                        code="row-too-long",
                        file=path,
                        place=f"line {line}",
                    )
                yield line, [restore(str(cell)) for cell in row]

        self.path, self.grid, self.comments = path, Grid(path, each, (), False, tuple(comments)), comments
        self.header = [str(cell) for cell in next(each(), (0, []))[1]]
        if not self.header:
            raise InputError(
                f"{path}: the file has no rows; a header row and rows of numbers are expected.", code="empty", file=path
            )
        _check_header(path, self.header)
        self.names, self._units, self._start = self.header, [""] * len(self.header), 1
        self._width = len(self.header)


def find_header(rows: Sequence[Sequence[Cell]]) -> tuple[int, int]:
    """First row of names and units, and first row of numbers; zeros if there are no names.

    The header is the row without numbers above the rows with numbers. Of several such rows, it is the first whose count
    of numbers is not much smaller than the largest. Without numbers, or if only the first cell is a text, it is the
    first row.
    """
    has_number = [any(map(is_number, row)) for row in rows]
    runs: list[tuple[int, int]] = []  # first row of rows with numbers, and how many numbers they have
    for i, row in enumerate(rows):
        if has_number[i]:
            if i == 0 or not has_number[i - 1]:
                runs.append((i, 0))
            runs[-1] = runs[-1][0], runs[-1][1] + sum(map(is_number, row))
    most = max((count for _, count in runs), default=0)
    start = next((i for i, count in runs if count >= FEWEST * most), 1)
    if start == 0:
        head = rows[0][: filled_width(rows[0])]
        return 0, int(not is_number(head[0]) and "" not in head)
    first = start - 1
    while first > 0 and start - first < MOST_HEADS and not has_number[first - 1] and _goes_on(rows[first - 1 : start]):
        first -= 1
    return first, start


def _goes_on(rows: Sequence[Sequence[Cell]]) -> bool:
    """Return whether the first row belongs to the header that the other rows continue."""
    above, below = rows[0], rows[1:]
    if 2 * sum(cell != "" for cell in above) <= filled_width(below[0]):
        return False  # a title
    names = below[:-1] if len(below) > 1 and _are_units(below[-1]) else below
    if _are_units(below[-1]) and len(below) == 1:
        return True
    cells = [cell for cell in names[0] if cell != ""]
    return len({*cells}) < len(cells) or "" in names[0][: filled_width(names[0])]


def _are_units(row: Sequence[Cell]) -> bool:
    cells = [_bare(cell) for cell in row if cell not in ("", "-", "–")]
    return bool(cells) and 2 * sum(fits(cell, cell) for cell in cells) >= len(cells)


def _bare(cell: Cell) -> str:
    """Unit of a cell of a row of units, without brackets."""
    text = str(cell).strip()
    pair = text[:1] + text[-1:]
    return text[1:-1].strip() if pair in ("[]", "()") else "" if text in ("-", "–") else text


def join_heads(rows: Sequence[Sequence[Cell]]) -> tuple[list[str], list[str]]:
    """Names of columns, and their units if a row below the names has units."""
    *heads, last = rows
    units: list[str] = []
    if heads and _are_units(last):
        units = [_bare(cell) for cell in last]
    else:
        heads = list(rows)
    width = max(map(len, rows))
    cells = [[str(row[i]).strip() if i < len(row) else "" for row in heads] for i in range(width)]
    names = [" ".join(dict.fromkeys(cell for cell in column if cell)) for column in cells]
    return names, units + [""] * (width - len(units)) if units else []


def _axis_units(rows: Sequence[Sequence[Cell]], count: int) -> list[str]:
    """Units that the rows above the header state for the axes of an instrument, of the first column and the others."""
    stated = {}
    for row in rows:
        if len(row) > 1 and (match := _AXIS_UNIT.fullmatch(str(row[0]))):
            stated[match[1].lower()[0]] = str(row[1])
    across, down = stated.get("h", stated.get("x", "")), stated.get("v", stated.get("y", ""))
    return [across, *[down] * (count - 1)]


def _columns_after_settings(rows: Sequence[Sequence[Cell]]) -> list[list[str]]:
    """Names and units of a time and a channel in lines with settings of an instrument, "Source,CH1,,-2e-4,5e-3"."""
    settings = {str(row[0]): str(row[1]) for row in rows if len(row) > 1}
    places = [
        i for i in range(2, max(map(len, rows))) if all(is_number(cell) for row in rows for cell in row[i : i + 1])
    ]
    if "" not in settings or len(places) != 2:
        return []
    empty = [""] * places[0]
    return [[*empty, "time", settings.get("Source", "value")], [*empty, "-", settings.get("Vertical Units", "-")]]


def _check_header(path: Path, names: Sequence[str]) -> None:
    """Refuse a header with too many columns or a name that no person would write."""
    check_columns(str(path), len(names))
    for number, name in enumerate(names, start=1):
        if len(name) > LONGEST_NAME or not name.isprintable():
            raise InputError(
                f"{path}: the name of column {number} is longer than {LONGEST_NAME} characters or has one that is not "
                "printed; rename it.",
                code="bad-name",
                file=path,
            )
