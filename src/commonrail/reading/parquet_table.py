"""Parquet tables, read by pyarrow in a child process: numbers as arrays, texts as codes of the few that differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.reading.guarded_child import read_apart
from commonrail.reading.guarded_file import LARGEST_FILE, read_plain
from commonrail.reading.table_limits import Groups, Indices

__all__ = ["LARGEST_FLEET", "ParquetTable", "read_parquet"]

LARGEST_FLEET = 1_000_000_000  # [bytes] of the file


class _Column(NamedTuple):
    """Numbers, or places in the texts, and where there is no value."""

    values: NDArray[Any]
    none: NDArray[np.bool_]
    texts: list[str] | None

    def cells(self, rows: Indices) -> list[str]:
        """Texts of some rows, empty where there is no value."""
        values = self.values[rows].tolist()
        if self.texts is None:
            found = [repr(value) if isinstance(value, float) else str(value) for value in values]
        else:
            found = [self.texts[value] for value in values]
        return ["" if none else text for text, none in zip(found, self.none[rows].tolist(), strict=True)]

    def groups(self) -> tuple[NDArray[np.intp], list[str]]:
        """Code of each row and the text of each code."""
        _, first, codes = np.unique(np.where(self.none, -1, self.values), return_index=True, return_inverse=True)
        return codes, self.cells(first)


@dataclass(frozen=True)
class ParquetTable:
    """Table: ten times smaller than its texts."""

    path: Path
    header: list[str]
    rows: int
    columns: tuple[_Column, ...]

    def numbers(self, column: int) -> NDArray[np.float64] | None:
        """Values of a column, NaN where there is none; None if one is no number."""
        values, none, texts = self.columns[column]
        if texts is not None:
            try:
                values = np.array([*map(float, texts), np.nan])[values]
            except ValueError:
                return None
        return np.where(none, np.nan, values.astype(np.float64))

    def groups(self, columns: Sequence[int]) -> Groups:
        """Rows by the texts in columns."""
        codes = np.zeros(self.rows, dtype=np.int64)
        texts = []
        for column in columns:
            inner, known = self.columns[column].groups()
            codes = codes * len(known) + inner
            texts.append(known)
        order = np.argsort(codes, kind="stable")
        starts = np.flatnonzero(np.diff(codes[order], prepend=-1))
        parts = sorted(np.split(order, starts[1:]) if len(order) else [], key=lambda part: int(part[0]))
        found: dict[tuple[str, ...], list[Indices]] = {}
        for part in parts:
            found.setdefault(tuple(self.columns[c].cells(part[:1])[0] for c in columns), []).append(part)
        return {key: np.sort(np.concatenate(same)) for key, same in found.items()}

    def cells(self, rows: Indices) -> list[list[str]]:
        """Texts of some rows."""
        return [list(row) for row in zip(*(column.cells(rows) for column in self.columns), strict=True)]

    def place(self, row: int) -> str:
        """Location of a row."""
        return f"{self.path}, row {row + 1}"


def read_parquet(path: Path, largest: int = LARGEST_FILE) -> ParquetTable:
    """Read a table.

    Parameters
    ----------
    path : Path
    largest : int
        Bytes that the file may have.

    Raises
    ------
    InputError
        If pyarrow is not installed, the file cannot be read, or it is beyond a limit.
    """
    if find_spec("pyarrow") is None:
        raise InputError(
            f'{path}: to read Parquet, pyarrow is needed; install it with pip install "commonrail[fleet]", or give CSV.'
        )
    about, arrays = read_apart("parquet", path, read_plain(path, largest))
    none = np.zeros(about["rows"], bool)
    columns = (_Column(arrays[f"c{i}"], arrays.get(f"n{i}", none), t) for i, t in enumerate(about["texts"]))
    return ParquetTable(path, about["header"], about["rows"], tuple(columns))
