"""Variables of a MAT file, of version 5 to 7 or of version 7.3, which is HDF5; both are read in a child process.

Fields of structures are named with a point, ``run.rate``, and columns of a matrix ``rate(:,2)``. MATLAB knows no
units: that of ``rate`` is the text ``rate_unit`` or the field ``units.rate`` beside it, or is stated by the reader.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.guarded_child import read_apart
from commonrail.reading.guarded_file import read_plain
from commonrail.reading.sheet import Column, Table, cell_place, find_column
from commonrail.reading.table_limits import MOST_COLUMNS

__all__ = ["MatFile"]

_HDF5 = b"\x89HDF\r\n\x1a\n"


class MatFile:
    """MAT file, a `Sheet`.

    Parameters
    ----------
    path : Path
    form : FileForm
        Without meaning here.

    Raises
    ------
    InputError
        If it cannot be read, is beyond a limit, or h5py is needed and not installed.
    """

    apart = True

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        self.path = path
        data = read_plain(path)
        if _HDF5 in (data[:8], data[512:520]) and find_spec("h5py") is None:
            raise InputError(
                f'{path}: MAT files of version 7.3 need h5py; install commonrail[mat], or save it with "-v7" in MATLAB.'
            )
        about, arrays = read_apart("mat", path, data)
        self.arrays: dict[str, NDArray[Any]] = {name: arrays[str(i)] for i, name in enumerate(about["names"])}
        self._texts: dict[str, str] = about["texts"]
        self._columns = dict(_columns(self.arrays))
        self.names = list(self._columns)
        if not self.names:
            raise InputError(f"{path}: the file has no variable with numbers.")

    def unit(self, name: str) -> str:
        """Unit of a variable, empty if the file has none."""
        room, _, last = name.partition("(")[0].rpartition(".")
        inside = f"{room}." if room else ""
        beside = [f"{inside}{last}_unit", f"{inside}units.{last}", f"units.{last}"]
        beside += [f"{inside}unit"] if last in ("value", "values") else []
        return next((self._texts[text].strip(" []") for text in beside if text in self._texts), "")

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of variables; see `Sheet.take`."""
        names = [self.names[find_column(self.path, self.names, column.name)] for column in columns]
        lengths = {name: len(self._columns[name]) for name in names}
        if len(set(lengths.values())) > 1:
            said = ", ".join(f'"{name}" {length}' for name, length in lengths.items())
            raise InputError(f"{self.path}: the variables have different numbers of values: {said}.")
        numbers = {name: self._columns[name].astype(np.float64) for name in names}
        for column, name in zip(columns, names, strict=True):
            wrong = np.flatnonzero(~np.isfinite(numbers[name]) if column.required else np.isinf(numbers[name]))
            if len(wrong):
                at = cell_place(self.path, int(wrong[0]) + 1, name, "value")
                raise at.error("this is not a finite number")
        rows = np.arange(1, 1 + next(iter(lengths.values()), 0))
        return Table(self.path, numbers, {}, {name: self.unit(name) for name in names}, rows, row="value")


def _columns(arrays: dict[str, NDArray[Any]]) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, array in arrays.items():
        if array.ndim == 1:
            yield name, array
        elif array.ndim == 2 and array.shape[1] <= MOST_COLUMNS:
            yield from ((f"{name}(:,{i + 1})", array[:, i]) for i in range(array.shape[1]))
