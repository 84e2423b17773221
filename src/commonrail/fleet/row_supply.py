"""One table for a whole fleet: every row belongs to an injector and, with a column "data", to one data set of it."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from commonrail.arrays import IndexArray
from commonrail.errors import InputError, nearest
from commonrail.files.atomic import write_text
from commonrail.fleet.supply import DEAD_TIMES, INJECTOR, Layout, check_name, checked_names
from commonrail.fleet.table import Table, find_column, names_of, read_table
from commonrail.reading.csv_file import MOST_ROWS as LONGEST_TABLE
from commonrail.reading.guarded_file import LARGEST_FILE, sha256

__all__ = ["RowSupply"]

DATA = "data"
AT_A_TIME = 10_000  # rows that are texts at a time

Parts = dict[str, dict[str, "_Part"]]


class RowSupply:
    """Injectors and data from a table of samples.

    Parameters
    ----------
    path : Path
    layout : Layout
    dead_times : Path or None
        A second such table, for the rows of dead times.

    Raises
    ------
    InputError
        If a table cannot be read, a column is missing, or a row names no injector or an unknown data set.
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
                self._parts[name] |= {data + DEAD_TIMES: part for data, part in parts.items()}

    def deliver(self, name: str, folder: Path) -> dict[str, Path]:
        """Write an injector's rows to files of its own, one for each part of the table."""
        parts = self._parts[name]
        files = {part: folder / f"rows-{i}.csv" for i, part in enumerate(dict.fromkeys(parts.values()), start=1)}
        for part, file in files.items():
            write_text(file, f"# rows of {part.table.path.name}\n{part.text()}")
        return {source: files[part] for source, part in parts.items()}

    def fingerprints(self, name: str) -> dict[str, str]:
        """SHA-256 of the rows of each data set."""
        return {source: sha256(part.text().encode()) for source, part in self._parts[name].items()}

    def fingerprints_read(self, name: str, read: Mapping[Path, str]) -> dict[str, str]:
        """SHA-256 of the rows: the table is in memory, and the files written from it are compared as they are read."""
        return self.fingerprints(name)


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
    known = [name for one in (table, second) if one for name in names_of(one)]
    for key, column in layout.columns.items():
        if column not in known:
            find_column(table, column, f"which {layout.at / 'columns'} gives for {key}")
    if len(layout.data) > 1 and not all(d.selects_rows for d in layout.data):
        find_column(table, layout.column(DATA), f"which says to which data set of {layout.study} a row belongs")


def _parts(table: Table, layout: Layout, data: Sequence[str]) -> Parts:
    keys = [find_column(table, layout.column(INJECTOR), "the names of the injectors")]
    if layout.column(DATA) in names_of(table):
        keys.append(find_column(table, layout.column(DATA), "the names of the data sets"))
    form = _form(table, keys, layout)
    found: Parts = {}
    for (name, *named), rows in table.groups(keys).items():
        check_name(name, table, int(rows[0]))
        own = found.setdefault(name, {})
        if named and named[0] in layout.left_out:
            continue
        if named and named[0] not in data:
            raise InputError(
                f'{table.place(int(rows[0]))}: {layout.study} has no such data set "{named[0]}"'
                f"{nearest(named[0], data)}; correct or remove the row."
            )
        part = _Part(table, form, rows)
        own |= dict.fromkeys(named or data, part)
    return found


def _form(table: Table, keys: Sequence[int], layout: Layout) -> _Form:
    """All columns but the keys, called as the study knows them."""
    studys = {column: name for name, column in layout.columns.items()}
    columns = tuple(i for i in range(len(table.header)) if i not in keys)
    header, names = [], names_of(table)
    for i in columns:
        cell, name = table.header[i], names[i]
        header.append(studys[name] + cell[len(name) :] if name in studys else cell)
    return _Form(columns, tuple(header))
