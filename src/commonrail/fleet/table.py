"""A table of a fleet, CSV or Parquet, held whole: its header, and its rows by what stands in some of its columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from commonrail.arrays import IndexArray
from commonrail.reading import sheet
from commonrail.reading.csv_file import CsvFile
from commonrail.reading.parquet_file import LARGEST_FLEET, ParquetFile
from commonrail.reading.table_limits import MOST_ROWS, Groups

__all__ = ["Table", "find_column", "names_of", "read_table"]

PARQUET = (".parquet", ".pq")


class Table(Protocol):
    """Header and rows."""

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def header(self) -> list[str]:
        """Cells of the header, with their units if they have any."""

    def groups(self, columns: Sequence[int]) -> Groups:
        """Rows, in their order, by the texts in columns; the groups are in the order of their first rows."""

    def cells(self, rows: IndexArray) -> list[list[str]]:
        """Texts of some rows, empty where there is no value."""

    def place(self, row: int) -> str:
        """Location of a row, for messages."""


def read_table(path: Path) -> Table:
    """Read a table; what ends in .parquet or .pq is Parquet, all else CSV.

    Raises
    ------
    InputError
        If the file cannot be read, or is Parquet and pyarrow is not installed.
    """
    return ParquetFile(path, largest=LARGEST_FLEET) if path.suffix.lower() in PARQUET else _read_csv(path)


def names_of(table: Table) -> list[str]:
    """Names of the columns, without their units."""
    return [sheet.name_and_unit(cell)[0] for cell in table.header]


def find_column(table: Table, name: str, what: str) -> int:
    """Index of a column in the header; see `commonrail.reading.sheet.find_column`."""
    return sheet.find_column(table.path, names_of(table), name, what)


@dataclass(frozen=True)
class _Csv:
    path: Path
    header: list[str]
    rows: list[list[str]]
    lines: list[int]

    def groups(self, columns: Sequence[int]) -> Groups:
        found: dict[tuple[str, ...], list[int]] = {}
        for i, row in enumerate(self.rows):
            found.setdefault(tuple(row[column].strip() for column in columns), []).append(i)
        return {key: np.array(places, dtype=np.intp) for key, places in found.items()}

    def cells(self, rows: IndexArray) -> list[list[str]]:
        return [[cell.strip() for cell in self.rows[row]] for row in rows]

    def place(self, row: int) -> str:
        return f"{self.path}, line {self.lines[row]}"


def _read_csv(path: Path) -> _Csv:
    found = CsvFile(path, most=MOST_ROWS)
    lines, rows = [], []
    for line, row in found.rows:
        lines.append(line)
        rows.append(row)
    return _Csv(path, found.header, rows, lines)
