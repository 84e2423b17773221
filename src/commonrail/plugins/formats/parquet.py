"""Columns of a Parquet file, read by pyarrow in a child process; the unit of one is in its name, ``rate [mm3/ms]``."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.errors import InputError
from commonrail.base.input import LARGEST_FILE, read_plain
from commonrail.readers.columns import PLAIN, Column, FileForm, Table, cell_place, find_column, finite, name_and_unit
from commonrail.readers.guarded import read_apart
from commonrail.readers.location import Groups


class _Column(NamedTuple):
    """Numbers or indices of texts, and a mask of missing values."""

    values: NDArray[Any]
    none: Bools
    texts: list[str] | None

    def cells(self, rows: IndexArray) -> list[str]:
        """Texts of some rows, empty for missing values."""
        values = self.values[rows].tolist()
        if self.texts is None:
            texts = [repr(value) if isinstance(value, float) else str(value) for value in values]
        else:
            texts = [self.texts[value] for value in values]
        return ["" if none else text for text, none in zip(texts, self.none[rows].tolist(), strict=True)]

    def numbers(self) -> Floats | None:
        """Values, NaN for missing ones; None if one is not a number."""
        values = self.values
        if self.texts is not None:
            try:
                values = np.array([*map(float, self.texts), np.nan])[values]
            except ValueError:
                return None
        return np.where(self.none, np.nan, values.astype(np.float64))


class ParquetFile:
    """Parquet file, a `Sheet` and a table of a fleet.

    The `form` has no meaning here. `largest`: bytes that the file may have. Raises `InputError` if it cannot be read,
    is beyond a limit, or pyarrow is not installed.
    """

    independent_columns = True

    def __init__(self, path: Path, form: FileForm = PLAIN, *, largest: int = LARGEST_FILE) -> None:
        if find_spec("pyarrow") is None:
            raise InputError(
                f"{path}: to read Parquet, pyarrow is needed; install it with pip install "
                '"commonrail[fleet]", or give CSV.'
            )
        about, arrays = read_apart(f"{__name__}_child", path, read_plain(path, largest))
        self.path = path
        self.header: list[str] = about["header"]
        self.names = [name_and_unit(cell)[0] for cell in self.header]
        none = np.zeros(about["rows"], bool)
        self._count = len(none)
        self._columns = [_Column(arrays[f"c{i}"], arrays.get(f"n{i}", none), t) for i, t in enumerate(about["texts"])]

    def unit(self, name: str) -> str:
        """Unit of a column, from its name, or empty."""
        return name_and_unit(self.header[self.names.index(name)])[1]

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns; see `Sheet.take`."""
        places = [find_column(self.path, self.names, column.name) for column in columns]
        numbers, texts = {}, {}
        rows = np.arange(1, self._count + 1)
        for column, i in zip(columns, places, strict=True):
            if not column.unit:
                texts[column.name] = self._columns[i].cells(rows - 1)
                continue
            if (values := self._columns[i].numbers()) is None:
                raise cell_place(self.path, 1, column.name, "row").error("the column holds no numbers")
            numbers[column.name] = values
        written_units = {
            column.name: name_and_unit(self.header[i])[1] for column, i in zip(columns, places, strict=True)
        }
        table = Table(self.path, numbers, texts, written_units, rows, row="row")
        return finite(table, columns, "there is no finite number, and one is expected")

    def groups(self, columns: Sequence[int]) -> Groups:
        """Rows by the texts in columns."""
        codes = np.zeros(self._count, dtype=np.int64)
        for values, none, _ in (self._columns[i] for i in columns):
            distinct, inner = np.unique(values, return_inverse=True)
            codes = codes * (len(distinct) + 1) + np.where(none, len(distinct), inner)
        order = np.argsort(codes, kind="stable")
        starts = np.flatnonzero(np.diff(codes[order], prepend=-1))
        parts = sorted(np.split(order, starts[1:]) if len(order) else [], key=lambda rows: int(rows[0]))
        groups: dict[tuple[str, ...], list[IndexArray]] = {}
        for rows in parts:
            groups.setdefault(tuple(self._columns[i].cells(rows[:1])[0] for i in columns), []).append(rows)
        return {key: np.sort(np.concatenate(same)) for key, same in groups.items()}

    def cells(self, rows: IndexArray) -> list[list[str]]:
        """Texts of some rows."""
        return [list(row) for row in zip(*(column.cells(rows) for column in self._columns), strict=True)]

    def place(self, row: int) -> str:
        """Location of a row."""
        return f"{self.path}, row {row + 1}"
