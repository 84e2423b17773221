"""Fleets from TOML, and the data of each injector: files named in a table, or rows of a common table."""

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

# Table of a fleet, CSV or Parquet, in memory.

LARGEST_FLEET = 1_000_000_000  # [bytes] of the file


def read_table(path: Path) -> Table:
    """Read a table: Parquet, a text or a workbook.

    Raises `InputError` if the file cannot be read, or is Parquet and pyarrow is not installed.
    """
    return ParquetFile(path, largest=LARGEST_FLEET) if find_format(path) == "parquet" else _Cells.of(path)


def header_names(table: Table) -> list[str]:
    """Names of the columns, without units."""
    return [sheet.name_and_unit(cell)[0] for cell in table.header]


def find_column(table: Table, name: str, what: str) -> int:
    """Find the index of a column, also by a usual heading; see `commonrail.readers.columns.find_column`."""
    names = header_names(table)
    usual = [] if name in names else [heading for heading in names if sheet.is_heading(heading, name)]
    return sheet.find_column(table.path, names, usual[0] if len(usual) == 1 else name, what)


@dataclass(frozen=True)
class _Cells:
    """Cells of a text or a workbook, in memory."""

    path: Path
    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    word: str

    @classmethod
    def of(cls, path: Path) -> _Cells:
        table = TableSheet(read_grid(path), most=MOST_ROWS)
        rows: list[list[str]] = []
        lines: list[int] = []
        for line, row in table.rows:
            cells = [_text(cell, table.grid.comma) for cell in row]
            rows.append(cells + [""] * (len(table.header) - len(cells)))
            lines.append(line)
        return cls(path, table.header, rows, lines, table.grid.word)

    def groups(self, columns: Sequence[int]) -> Groups:
        """Group rows by the texts in columns; groups are in the order of their first rows."""
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
    """Write a cell as in a CSV file with decimal points."""
    if isinstance(cell, str) and comma and isinstance(read_number(cell, comma), float):
        return cell.replace(",", ".")
    return cell if isinstance(cell, str) else repr(int(cell) if cell.is_integer() else cell)


INJECTOR = "injector"
DEAD_TIMES = " dead times"  # suffix of the column for a data set's second file

MISSING_FILE = "missing"
FORMULA = "=+-@"


class Layout(NamedTuple):
    """Columns that a table must have.

    `data`: data sets of the template in use; `left_out`: names of the other data sets; `columns`: column names of the
    table by column names of the study; `at`, `study`: locations of fleet and template, for messages.
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
        """Names of all possible files of an injector."""
        return [*(d.name for d in self.data), *(name + DEAD_TIMES for name in self.with_dead_times)]


class FileSupply:
    """A table with a row for each injector, and a column of file names for each data set.

    Raises `InputError` if it cannot be read, a column is missing or unknown, or an injector has no name or two rows.
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
                raise InputError(f'{table.place(int(rows[1]))}: injector "{name}" has a second row; keep one.')
            cells = table.cells(rows)[0]
            self._files[name] = {s: path.parent / cells[i] for s, i in places.items() if cells[i]}
        self.names = check_names(self._files, path)

    def deliver(self, name: str, folder: Path) -> dict[str, Path]:
        """Return the path of each file of an injector, by the names in `Layout.sources`; nothing is copied."""
        return self._files[name]

    def fingerprints(self, name: str) -> dict[str, str]:
        """SHA-256 of each file."""
        return {source: fingerprint(file) or MISSING_FILE for source, file in self._files[name].items()}

    def fingerprints_read(self, name: str, read: Mapping[Path, str]) -> dict[str, str]:
        """SHA-256 of each file as it was read."""
        places = {source: Path(os.path.abspath(file)) for source, file in self._files[name].items()}
        return {source: read.get(place, MISSING_FILE) for source, place in places.items()}


def check_name(name: str, table: Table, row: int) -> None:
    """Refuse (`InputError`) a row with an empty injector's name, or a name that begins like a formula."""
    if not name:
        raise InputError(f"{table.place(row)}: the name of the injector is missing; write it or remove the row.")
    if name[0] in FORMULA:
        raise InputError(
            f'{table.place(row)}: the name of the injector, "{name}", begins like a formula, which a spreadsheet would '
            "evaluate in the results; begin it with a letter or a digit."
        )


def check_names(names: Collection[str], path: Path) -> tuple[str, ...]:
    """Return the names of a table's injectors; raises `InputError` without any."""
    if not names:
        raise InputError(f"{path}: the table has no injectors; a row below the header is expected.")
    return tuple(names)


# One table for all injectors: each row belongs to an injector and, with a column "data", to a data set.

DATA = "data"
AT_A_TIME = 10_000  # rows converted to text at a time

Parts = dict[str, dict[str, "_Part"]]


class RowSupply:
    """Injectors and data from a table of samples, and a second table for dead times.

    Raises `InputError` if a table cannot be read, a column is missing, an injector's name is missing, or a data set is
    unknown.
    """

    def __init__(self, path: Path, layout: Layout, dead_times: Path | None) -> None:
        self.path = path
        _check_dead_times(layout, dead_times)
        table = read_table(path)
        second = None if dead_times is None else read_table(dead_times)
        _check_columns(table, second, layout)
        self._parts = _split_table(table, layout, [d.name for d in layout.data])
        self.names = check_names(self._parts, path)
        for name, parts in _split_table(second, layout, layout.with_dead_times).items() if second else ():
            if name in self._parts:
                self._parts[name] |= {data + DEAD_TIMES: table_part for data, table_part in parts.items()}

    def deliver(self, name: str, folder: Path) -> dict[str, Path]:
        """Write an injector's rows to files, one for each part of the table."""
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
        """SHA-256 of the rows in memory; the files written from them are checked when they are read."""
        return self.fingerprints(name)


Supply = FileSupply | RowSupply  # injectors and their data


class _Form(NamedTuple):
    """Columns of an injector's file: indices in the table, and headings in the file."""

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
                    f"{self.table.place(int(self.rows[0]))}: this injector has more than {LONGEST_TABLE} rows or "
                    f"{LARGEST_FILE / 1e6:g} MB, the limits; remove rows that are not needed."
                )
        return stream.getvalue()


def _check_dead_times(layout: Layout, path: Path | None) -> None:
    at = layout.at / "dead_times"
    if layout.with_dead_times and path is None:
        raise at.error(
            f'this key is missing: "{layout.with_dead_times[0]}" of {layout.study} has dead times, and the key must '
            "name their table"
        )
    if path is not None and not layout.with_dead_times:
        raise at.error(f"no data set of {layout.study} that is used has dead_times; remove this key")


def _check_columns(table: Table, second: Table | None, layout: Layout) -> None:
    """Refuse a name in [columns] that is in no table, and a table for several curves without the column "data"."""
    column_names = [name for file in (table, second) if file for name in header_names(file)]
    for key, column in layout.columns.items():
        if column not in column_names:
            find_column(table, column, f"which {layout.at / 'columns'} gives for {key}")
    if len(layout.data) > 1 and not all(d.selects_rows for d in layout.data):
        find_column(table, layout.column(DATA), f"which says to which data set of {layout.study} a row belongs")


def _split_table(table: Table, layout: Layout, data: Sequence[str]) -> Parts:
    keys = [find_column(table, layout.column(INJECTOR), "the names of the injectors")]
    if layout.column(DATA) in header_names(table):
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
                f'{table.place(int(rows[0]))}: {layout.study} has no data set "{data_name[0]}"'
                f"{nearest(data_name[0], data)}; correct or remove the row."
            )
        table_part = _Part(table, form, rows)
        injector_parts |= dict.fromkeys(data_name or data, table_part)
    return parts_by_injector


def _form(table: Table, keys: Sequence[int], layout: Layout) -> _Form:
    """All columns except the keys, with the study's names."""
    study_names = {column: name for name, column in layout.columns.items()}
    columns = tuple(i for i in range(len(table.header)) if i not in keys)
    header, names = [], header_names(table)
    for i in columns:
        cell, name = table.header[i], names[i]
        header.append(study_names[name] + cell[len(name) :] if name in study_names else cell)
    return _Form(columns, tuple(header))


# Fleets from TOML: a template study, and the table of the injectors.


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
    """Template of all studies: file, text, TOML tables and checked model; `left_out`: data sets that are not used."""

    path: Path
    text: str
    document: Mapping[str, Any]
    model: StudyModel
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Fleet:
    """Many injectors, each to be calibrated to its own data.

    `seed`: gives, with an injector's name, the seed of its search; `attempts`: tries of an injector whose worker dies
    or exceeds `time_limit` [s].
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
    """Read a fleet with its template and its table; the data files of the injectors are read later.

    Paths in the TOML file are relative to its folder, paths in the table to the folder of the table. Raises
    `InputError` if a file cannot be read, a key or column is unknown, missing or of the wrong type, an injector has two
    rows, or a data set of the template has no source.
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
        raise Place(str(path), "parameter").error("a template must state its free parameters, even if it names a type")
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
            'give either files = "injectors.csv", a table with the file names of each injector, or '
            'rows = "measurements.csv", a table with the samples of all injectors'
        )
    used = [data for data in template.model.data if data.name not in template.left_out]
    layout = Layout(tuple(used), template.left_out, model.columns, at, template.path)
    if model.files is not None:
        if model.dead_times is not None:
            raise (at / "dead_times").error('this key needs rows; with files, use a column "… dead times" of the table')
        with locate_errors(at / "files"):
            return FileSupply(folder / model.files, layout)
    with locate_errors(at / "rows"):
        dead_times = None if model.dead_times is None else folder / model.dead_times
        return RowSupply(folder / (model.rows or ""), layout, dead_times)
