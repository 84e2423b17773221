"""Sources of each injector's data: files that a table names, or rows of one table for all."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

from commonrail.errors import InputError
from commonrail.fleet.table import Table, find_column, read_table
from commonrail.kinds.reading import DataModel
from commonrail.reading.guarded_file import fingerprint
from commonrail.reading.place import Place

__all__ = ["DEAD_TIMES", "INJECTOR", "FileSupply", "Layout", "Supply", "check_name", "checked_names"]

INJECTOR = "injector"
DEAD_TIMES = " dead times"  # behind the name of a data set: its second file

MISSING_FILE = "missing"
FORMULA = "=+-@"


class Layout(NamedTuple):
    """Columns asked of a table.

    Attributes
    ----------
    data : tuple of DataModel
        Data sets of the template that are used.
    left_out : tuple of str
        Names of those that are not.
    columns : mapping of str to str
        What columns are called in the table, by the names that the study knows.
    at : Place
        Of the fleet's file, for messages.
    study : Path
        The template, for messages.
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
        return [d.name for d in self.data if d.has_dead_times]

    @property
    def sources(self) -> list[str]:
        """Names of all files that an injector may have."""
        return [*(d.name for d in self.data), *(name + DEAD_TIMES for name in self.with_dead_times)]


class Supply(Protocol):
    """Injectors and their data."""

    @property
    def path(self) -> Path:
        """The table."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the injectors, in the table's order."""

    def deliver(self, name: str, folder: Path) -> dict[str, Path]:
        """Path of each file that an injector has, by the names in `Layout.sources`; may write them to the folder."""

    def fingerprints(self, name: str) -> dict[str, str]:
        """Fingerprints of an injector's files, by the same names."""

    def fingerprints_read(self, name: str, read: Mapping[Path, str]) -> dict[str, str]:
        """Fingerprints of an injector's files as they were `read`, by the same names."""


class FileSupply:
    """A table with a row for each injector, and for each data set a column with the name of a file.

    Parameters
    ----------
    path : Path
    layout : Layout

    Raises
    ------
    InputError
        If the table cannot be read, a column is missing or unknown, or an injector has no name or stands in it twice.
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
        """Paths of the files as the table names them; nothing is copied."""
        return self._files[name]

    def fingerprints(self, name: str) -> dict[str, str]:
        """SHA-256 of each file."""
        return {source: fingerprint(file) or MISSING_FILE for source, file in self._files[name].items()}

    def fingerprints_read(self, name: str, read: Mapping[Path, str]) -> dict[str, str]:
        """SHA-256 of each file as it was read."""
        places = {source: Path(os.path.abspath(file)) for source, file in self._files[name].items()}
        return {source: read.get(place, MISSING_FILE) for source, place in places.items()}


def check_name(name: str, table: Table, row: int) -> None:
    """Refuse a row that names no injector.

    Parameters
    ----------
    name : str
    table : Table
    row : int
        Of the injector, for the message.

    Raises
    ------
    InputError
        If the name is empty, or begins like a formula.
    """
    if not name:
        raise InputError(f"{table.place(row)}: the name of the injector is missing; write it or remove the row.")
    if name[0] in FORMULA:
        raise InputError(
            f'{table.place(row)}: the name of the injector, "{name}", begins like a formula, which a spreadsheet would '
            "compute when it opens the results; begin it with a letter or a digit."
        )


def checked_names(names: Collection[str], path: Path) -> tuple[str, ...]:
    """Names of the injectors of a table that has some.

    Raises
    ------
    InputError
        If there is none.
    """
    if not names:
        raise InputError(f"{path}: the table has no injectors; a row below the header is expected.")
    return tuple(names)
