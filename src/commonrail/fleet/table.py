"""A table of a fleet, CSV or Parquet, held whole: its header, and its rows by what stands in some of its columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.reading import sheet
from commonrail.reading.csv_file import CsvFile

__all__ = ["Table", "find_column", "names_of", "read_table"]

Indices = NDArray[np.intp]
Groups = dict[tuple[str, ...], Indices]

MOST_ROWS = 10_000_000  # many injectors, each with a curve
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

    def cells(self, rows: Indices) -> list[list[str]]:
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
    return _read_parquet(path) if path.suffix.lower() in PARQUET else _read_csv(path)


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

    def cells(self, rows: Indices) -> list[list[str]]:
        return [[cell.strip() for cell in self.rows[row]] for row in rows]

    def place(self, row: int) -> str:
        return f"{self.path}, line {self.lines[row]}"


@dataclass(frozen=True)
class _Parquet:
    path: Path
    table: Any  # a table of pyarrow: ten times smaller than its texts

    @property
    def header(self) -> list[str]:
        return [str(name) for name in self.table.column_names]

    def groups(self, columns: Sequence[int]) -> Groups:
        codes = np.zeros(self.table.num_rows, dtype=np.int64)
        texts = []
        for column in columns:
            encoded = self._encoded(column)
            known = [_text(value) for value in encoded.dictionary.to_pylist()]
            codes = codes * max(len(known), 1) + encoded.indices.to_numpy(zero_copy_only=False)
            texts.append(known)
        order = np.argsort(codes, kind="stable")
        starts = np.flatnonzero(np.diff(codes[order], prepend=-1))
        parts = sorted(np.split(order, starts[1:]) if len(order) else [], key=lambda part: int(part[0]))
        found: dict[tuple[str, ...], list[Indices]] = {}
        for part in parts:
            found.setdefault(_decoded(int(codes[part[0]]), texts), []).append(part)
        return {key: np.sort(np.concatenate(same)) for key, same in found.items()}

    def _encoded(self, column: int) -> Any:
        from pyarrow import ArrowException

        cells = self.table.column(column)
        try:
            return cells.combine_chunks().dictionary_encode(null_encoding="encode")
        except ArrowException:
            raise InputError(
                f'{self.path}: the column "{self.header[column]}" holds values of type {cells.type}, and texts or '
                "numbers are expected; write one text or number in each row."
            ) from None

    def cells(self, rows: Indices) -> list[list[str]]:
        taken = self.table.take(rows)
        columns = [[_text(value) for value in column.to_pylist()] for column in taken.columns]
        return [list(row) for row in zip(*columns, strict=True)]

    def place(self, row: int) -> str:
        return f"{self.path}, row {row + 1}"


def _decoded(code: int, texts: Sequence[Sequence[str]]) -> tuple[str, ...]:
    found = []
    for known in reversed(texts):
        code, place = divmod(code, max(len(known), 1))
        found.append(known[place])
    return tuple(reversed(found))


def _read_csv(path: Path) -> _Csv:
    found = CsvFile(path, most=MOST_ROWS)
    lines, rows = [], []
    for line, row in found.rows:
        lines.append(line)
        rows.append(row)
    return _Csv(path, found.header, rows, lines)


def _text(value: Any) -> str:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value).strip()


def _read_parquet(path: Path) -> _Parquet:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise InputError(
            f'{path}: to read Parquet, pyarrow is needed; install it with pip install "commonrail[fleet]", or give CSV.'
        ) from None
    if not path.is_file():
        raise InputError(f"{path}: there is no such file.")
    try:
        table = parquet.read_table(path, partitioning=None)
        _ = table.column_names  # those that are no text are found out here
        return _Parquet(path, table)
    except (ArrowException, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:200].rstrip(".")
        raise InputError(f"{path}: the file cannot be read as Parquet ({reason}).") from error
