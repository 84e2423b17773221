"""Sources of each injector's data: files that a table names, or rows of one table for all."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from commonrail.base.arrays import IndexArray
from commonrail.base.errors import InputError, nearest
from commonrail.base.input import LARGEST_FILE, fingerprint, sha256
from commonrail.base.output import write_text
from commonrail.calibration.study_keys import StudyModel
from commonrail.data.study_block import DataModel
from commonrail.plugins.formats.parquet import ParquetFile
from commonrail.readers import columns as sheet
from commonrail.readers.formats import find_format
from commonrail.readers.grid import read_grid
from commonrail.readers.location import MOST_ROWS, Groups, Place, locate_errors
from commonrail.readers.table_sheet import MOST_ROWS as LONGEST_TABLE
from commonrail.readers.table_sheet import TableSheet
from commonrail.readers.text import read_number
from commonrail.readers.toml import FileModel, Text, Unit, read_model, read_toml

# A table of a fleet, CSV or Parquet, held whole: its header, and its rows by what stands in some of its columns.

LARGEST_FLEET = 1_000_000_000  # [bytes] of the file


def read_table(path: Path) -> Table:
    """Read a table: Parquet, a text or a workbook.

    `InputError` if the file cannot be read, or is Parquet and pyarrow is not installed.
    """
    return ParquetFile(path, largest=LARGEST_FLEET) if find_format(path) == "parquet" else _Cells.of(path)


def names_of(table: Table) -> list[str]:
    """Names of the columns, without their units."""
    return [sheet.name_and_unit(cell)[0] for cell in table.header]


def find_column(table: Table, name: str, what: str) -> int:
    """Index of a column in the header, also by a usual heading; see `commonrail.readers.columns.find_column`."""
    names = names_of(table)
    usual = [] if name in names else [heading for heading in names if sheet.is_heading(heading, name)]
    return sheet.find_column(table.path, names, usual[0] if len(usual) == 1 else name, what)


@dataclass(frozen=True)
class _Cells:
    """Cells of a text or a workbook, held whole."""

    path: Path
    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    word: str

    @classmethod
    def of(cls, path: Path) -> _Cells:
        table = TableSheet(read_grid(path), most=MOST_ROWS)
        comma, width, rows, lines = table.grid.comma, len(table.header), list[list[str]](), list[int]()
        for line, row in table.rows:
            cells = [_text(cell, comma) for cell in row]
            rows.append(cells + [""] * (width - len(cells)))
            lines.append(line)
        return cls(path, table.header, rows, lines, table.grid.word)

    def groups(self, columns: Sequence[int]) -> Groups:
        """Rows, in their order, by the texts in columns; the groups are in the order of their first rows."""
        rows_by_key: dict[tuple[str, ...], list[int]] = {}
        for i, row in enumerate(self.rows):
            rows_by_key.setdefault(tuple(row[column] for column in columns), []).append(i)
        return {key: np.array(places, dtype=np.intp) for key, places in rows_by_key.items()}

    def cells(self, rows: IndexArray) -> list[list[str]]:
        return [self.rows[row] for row in rows]

    def place(self, row: int) -> str:
        return f"{self.path}, {self.word} {self.lines[row]}"


Table = _Cells | ParquetFile


def _text(cell: str | float, comma: bool) -> str:
    """Cell as a CSV file with decimal points has it."""
    if isinstance(cell, str) and comma and isinstance(read_number(cell, comma), float):
        return cell.replace(",", ".")
    return cell if isinstance(cell, str) else repr(int(cell) if cell.is_integer() else cell)


INJECTOR = "injector"
DEAD_TIMES = " dead times"  # behind the name of a data set: its second file

MISSING_FILE = "missing"
FORMULA = "=+-@"


class Layout(NamedTuple):
    """Columns asked of a table: those of the template's data sets `data`, without those `left_out`.

    `columns` says what columns are called in the table, by the names that the study knows; `at` and `study`, the
    locations of fleet and template, are for messages.
    """

    data: tuple[DataModel, ...]
    left_out: tuple[str, ...]
    columns: Mapping[str, str]
    at: Place
    study: Path

    def column(self, name: str) -> str:
        """Name of a column in the table."""
        return self.columns.get(name, name)

    @property
    def with_dead_times(self) -> list[str]:
        """Names of the data sets that have dead times."""
        return [d.name for d in self.data if getattr(d, "dead_times", None)]

    @property
    def sources(self) -> list[str]:
        """Names of all files that an injector may have."""
        return [*(d.name for d in self.data), *(name + DEAD_TIMES for name in self.with_dead_times)]


class FileSupply:
    """A table with a row for each injector, and for each data set a column with the name of a file.

    `InputError` if it cannot be read, a column is missing or unknown, or an injector has no name or stands in it twice.
    """

    def __init__(self, path: Path, layout: Layout) -> None:
        self.path = path
        (layout.at / "columns").refuse_unknown(layout.columns, [INJECTOR, *layout.sources])
        table = read_table(path)
        key = find_column(table, layout.column(INJECTOR), "the names of the injectors")
        places = {s: find_column(table, layout.column(s), f'files of "{s}" of {layout.study}') for s in layout.sources}
        self._files: dict[str, dict[str, Path]] = {}
        for (name,), rows in table.groups([key]).items():
            check_name(name, table, int(rows[0]))
            if len(rows) > 1:
                raise InputError(
                    f'{table.place(int(rows[1]))}: injector "{name}" stands in the table twice; keep one row.'
                )
            cells = table.cells(rows)[0]
            self._files[name] = {s: path.parent / cells[i] for s, i in places.items() if cells[i]}
        self.names = checked_names(self._files, path)

    def deliver(self, name: str, folder: Path) -> dict[str, Path]:
        """Path of each file that an injector has, by the names in `Layout.sources`; nothing is copied."""
        return self._files[name]

    def fingerprints(self, name: str) -> dict[str, str]:
        """SHA-256 of each file."""
        return {source: fingerprint(file) or MISSING_FILE for source, file in self._files[name].items()}

    def fingerprints_read(self, name: str, read: Mapping[Path, str]) -> dict[str, str]:
        """SHA-256 of each file as it was read."""
        places = {source: Path(os.path.abspath(file)) for source, file in self._files[name].items()}
        return {source: read.get(place, MISSING_FILE) for source, place in places.items()}


def check_name(name: str, table: Table, row: int) -> None:
    """Refuse (`InputError`) a row whose injector's name is empty, or begins like a formula."""
    if not name:
        raise InputError(f"{table.place(row)}: the name of the injector is missing; write it or remove the row.")
    if name[0] in FORMULA:
        raise InputError(
            f'{table.place(row)}: the name of the injector, "{name}", begins like a formula, which a spreadsheet would '
            "compute when it opens the results; begin it with a letter or a digit."
        )


def checked_names(names: Collection[str], path: Path) -> tuple[str, ...]:
    """Names of the injectors of a table; `InputError` if it has none."""
    if not names:
        raise InputError(f"{path}: the table has no injectors; a row below the header is expected.")
    return tuple(names)


# One table for a whole fleet: every row belongs to an injector and, with a column "data", to one data set of it.

DATA = "data"
AT_A_TIME = 10_000  # rows that are texts at a time

Parts = dict[str, dict[str, "_Part"]]


class RowSupply:
    """Injectors and data from a table of samples, and a second such table for the rows of dead times.

    `InputError` if a table cannot be read, a column is missing, or a row names no injector or an unknown data set.
    """

    def __init__(self, path: Path, layout: Layout, dead_times: Path | None) -> None:
        self.path = path
        _check_dead_times(layout, dead_times)
        table = read_table(path)
        second = None if dead_times is None else read_table(dead_times)
        _check_columns(table, second, layout)
        self._parts = _parts(table, layout, [d.name for d in layout.data])
        self.names = checked_names(self._parts, path)
        for name, parts in _parts(second, layout, layout.with_dead_times).items() if second else ():
            if name in self._parts:
                self._parts[name] |= {data + DEAD_TIMES: table_part for data, table_part in parts.items()}

    def deliver(self, name: str, folder: Path) -> dict[str, Path]:
        """Write an injector's rows to files of its own, one for each part of the table."""
        parts = self._parts[name]
        files = {
            table_part: folder / f"rows-{i}.csv" for i, table_part in enumerate(dict.fromkeys(parts.values()), start=1)
        }
        for table_part, file in files.items():
            write_text(file, f"# rows of {table_part.table.path.name}\n{table_part.text()}")
        return {source: files[table_part] for source, table_part in parts.items()}

    def fingerprints(self, name: str) -> dict[str, str]:
        """SHA-256 of the rows of each data set."""
        return {source: sha256(table_part.text().encode()) for source, table_part in self._parts[name].items()}

    def fingerprints_read(self, name: str, read: Mapping[Path, str]) -> dict[str, str]:
        """SHA-256 of the rows: the table is in memory, and the files written from it are compared as they are read."""
        return self.fingerprints(name)


Supply = FileSupply | RowSupply  # injectors and their data


class _Form(NamedTuple):
    """Columns that go to an injector's file, and what they are called there."""

    columns: tuple[int, ...]
    header: tuple[str, ...]


class _Part:
    """Rows of one injector and data set; compared by identity."""

    def __init__(self, table: Table, form: _Form, rows: IndexArray) -> None:
        self.table, self.form, self.rows = table, form, rows

    def text(self) -> str:
        """The rows as CSV."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.form.header)
        for start in range(0, len(self.rows), AT_A_TIME):
            cells = self.table.cells(self.rows[start : start + AT_A_TIME])
            writer.writerows([row[i] for i in self.form.columns] for row in cells)
            if start + len(cells) > LONGEST_TABLE or stream.tell() > LARGEST_FILE:
                raise InputError(
                    f"{self.table.place(int(self.rows[0]))}: the rows of this injector are more than the "
                    f"{LONGEST_TABLE} or the {LARGEST_FILE / 1e6:g} MB that are read; keep only what is needed."
                )
        return stream.getvalue()


def _check_dead_times(layout: Layout, path: Path | None) -> None:
    at = layout.at / "dead_times"
    if layout.with_dead_times and path is None:
        raise at.error(
            f'this key is missing: "{layout.with_dead_times[0]}" of {layout.study} has dead times, and the key must '
            "name the table with those of the injectors"
        )
    if path is not None and not layout.with_dead_times:
        raise at.error(f"no data set of {layout.study} that is used has dead_times; remove this key")


def _check_columns(table: Table, second: Table | None, layout: Layout) -> None:
    """Refuse a name in [columns] that no table has, and one table for several curves without the column "data"."""
    column_names = [name for file in (table, second) if file for name in names_of(file)]
    for key, column in layout.columns.items():
        if column not in column_names:
            find_column(table, column, f"which {layout.at / 'columns'} gives for {key}")
    if len(layout.data) > 1 and not all(d.selects_rows for d in layout.data):
        find_column(table, layout.column(DATA), f"which says to which data set of {layout.study} a row belongs")


def _parts(table: Table, layout: Layout, data: Sequence[str]) -> Parts:
    keys = [find_column(table, layout.column(INJECTOR), "the names of the injectors")]
    if layout.column(DATA) in names_of(table):
        keys.append(find_column(table, layout.column(DATA), "the names of the data sets"))
    form = _form(table, keys, layout)
    parts_by_injector: Parts = {}
    for (name, *data_name), rows in table.groups(keys).items():
        check_name(name, table, int(rows[0]))
        injector_parts = parts_by_injector.setdefault(name, {})
        if data_name and data_name[0] in layout.left_out:
            continue
        if data_name and data_name[0] not in data:
            raise InputError(
                f'{table.place(int(rows[0]))}: {layout.study} has no such data set "{data_name[0]}"'
                f"{nearest(data_name[0], data)}; correct or remove the row."
            )
        table_part = _Part(table, form, rows)
        injector_parts |= dict.fromkeys(data_name or data, table_part)
    return parts_by_injector


def _form(table: Table, keys: Sequence[int], layout: Layout) -> _Form:
    """All columns but the keys, called as the study knows them."""
    studys = {column: name for name, column in layout.columns.items()}
    columns = tuple(i for i in range(len(table.header)) if i not in keys)
    header, names = [], names_of(table)
    for i in columns:
        cell, name = table.header[i], names[i]
        header.append(studys[name] + cell[len(name) :] if name in studys else cell)
    return _Form(columns, tuple(header))


# Fleets from TOML: a study that serves as template, and the table of the injectors with their data.


class _FleetModel(FileModel):
    format: Literal["commonrail-fleet/1"]
    title: Text
    note: str = ""
    study: Text
    seed: int = Field(default=1, ge=0)
    files: str | None = None
    rows: str | None = None
    dead_times: str | None = None
    leave_out: list[str] = Field(default=[])
    columns: dict[str, str] = Field(default={})
    attempts: int = Field(default=3, ge=1)
    time_limit: Annotated[float, Unit("s")] = 3600.0


@dataclass(frozen=True)
class Template:
    """The study from which each injector's own is made: its file, its tables as they stand and checked.

    `left_out` are the data sets that are not used.
    """

    path: Path
    text: str
    document: Mapping[str, Any]
    model: StudyModel
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Fleet:
    """Many injectors, each to be calibrated to its own data.

    The seed gives with an injector's name that of its search. An injector whose worker dies or hangs is tried as often
    as `attempts`; a worker hangs after the time limit [s].
    """

    path: Path
    title: str
    note: str
    seed: int
    template: Template
    supply: Supply
    attempts: int
    time_limit: float


def load_fleet(path: str | Path) -> Fleet:
    """Read a fleet with its template and its table; the injectors' own files are read later, one by one.

    Paths in the TOML file are relative to its folder, those in its table to the table's. `InputError` if a file cannot
    be read, a key or column is unknown, missing or of the wrong kind, an injector stands twice in the table, or a data
    set of the template has no source.
    """
    file = Path(path)
    at = Place(str(file))
    model = read_model(_FleetModel, read_toml(file)[0], at)
    if not model.time_limit > 0.0:
        raise (at / "time_limit").error("this must be greater than zero")
    template = _template(file.parent / model.study, model.leave_out, at)
    return Fleet(
        file,
        model.title,
        model.note,
        model.seed,
        template,
        _supply(file.parent, template, model, at),
        model.attempts,
        model.time_limit,
    )


def _template(path: Path, left_out: Sequence[str], at: Place) -> Template:
    with locate_errors(at / "study"):
        tables, text = read_toml(path)
    model = read_model(StudyModel, tables, Place(str(path)))
    if not model.parameter:
        raise Place(str(path), "parameter").error("a template states its free parameters, also where it names a type")
    names = [data.name for data in model.data]
    for name in left_out:
        if name not in names:
            raise (at / "leave_out").error(f'{path} has no data set "{name}"{nearest(name, names)}')
    if not any(data.role == "fit" and data.name not in left_out for data in model.data):
        raise InputError(f"{at}: no data set of {path} with role fit is left; a fleet needs one to fit.")
    return Template(path, text, tables, model, tuple(left_out))


def _supply(folder: Path, template: Template, model: _FleetModel, at: Place) -> Supply:
    if (model.files is None) == (model.rows is None):
        raise at.error(
            'give either files = "injectors.csv", a row for each injector with the names of its files, or '
            'rows = "measurements.csv", in which every row is a sample and names its injector'
        )
    used = [data for data in template.model.data if data.name not in template.left_out]
    layout = Layout(tuple(used), template.left_out, model.columns, at, template.path)
    if model.files is not None:
        if model.dead_times is not None:
            raise (at / "dead_times").error('this key goes with rows; with files the table has a column "… dead times"')
        with locate_errors(at / "files"):
            return FileSupply(folder / model.files, layout)
    with locate_errors(at / "rows"):
        dead_times = None if model.dead_times is None else folder / model.dead_times
        return RowSupply(folder / (model.rows or ""), layout, dead_times)
