"""Columns of a Parquet file; the unit of a column stands in its name, ``rate [mm3/ms]``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.parquet_table import read_parquet
from commonrail.reading.sheet import Column, Table, cell_place, find_column, name_and_unit

__all__ = ["ParquetFile"]


class ParquetFile:
    """Parquet file, a `Sheet`.

    Parameters
    ----------
    path : Path
    form : FileForm
        Without meaning here.

    Raises
    ------
    InputError
        If it cannot be read, is beyond a limit, or pyarrow is not installed.
    """

    apart = True

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        self.path = path
        self._table = read_parquet(path)
        named = [name_and_unit(name) for name in self._table.header]
        self.names = [name for name, _ in named]
        self._units = [unit for _, unit in named]

    def unit(self, name: str) -> str:
        """Unit of a column, empty if its name has none."""
        return self._units[self.names.index(name)]

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns; see `Sheet.take`."""
        places = [find_column(self.path, self.names, column.name) for column in columns]
        numbers, texts = {}, {}
        rows = np.arange(1, self._table.rows + 1)
        for column, i in zip(columns, places, strict=True):
            if not column.unit:
                texts[column.name] = self._table.columns[i].cells(rows - 1)
                continue
            if (values := self._table.numbers(i)) is None:
                raise cell_place(self.path, 1, column.name, "row").error("the column holds no numbers")
            wrong = np.flatnonzero(~np.isfinite(values) if column.required else np.isinf(values))
            if len(wrong):
                at = cell_place(self.path, int(wrong[0]) + 1, column.name, "row")
                raise at.error("there is no finite number, and one is expected")
            numbers[column.name] = values
        given = {column.name: self._units[i] for column, i in zip(columns, places, strict=True)}
        return Table(self.path, numbers, texts, given, rows, row="row")
