"""Variables of a MAT file, of version 5 to 7 or of version 7.3, which is HDF5 and read by h5py.

Fields of structures are named with a point, ``run.rate``, and columns of a matrix ``rate(:,2)``. MATLAB knows no
units: that of ``rate`` is the text ``rate_unit`` or the field ``units.rate`` beside it, or is stated by the reader.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.guarded_file import read_plain
from commonrail.reading.mat5 import DEEPEST, TooLarge, is_mat5, most_content, variables_of_mat5
from commonrail.reading.sheet import Column, Table, cell_place, find_column

__all__ = ["MatFile"]

MOST_NUMBERS = 20_000_000  # of a variable
MOST_VARIABLES = 10_000
MOST_COLUMNS = 1000  # of a matrix that is taken for columns

_HDF5 = b"\x89HDF\r\n\x1a\n"

Content = dict[str, "NDArray[Any] | str"]


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
        is_hdf5 = _HDF5 in (data[:8], data[512:520])
        try:
            found = dict(_of_hdf5(path, data) if is_hdf5 else _of_mat5(path, data))
        except InputError:
            raise
        except TooLarge as error:
            raise InputError(
                f"{path}: unpacked the file has more than the {most_content(len(data)) / 1e6:.0f} MB that are read of "
                "one of its size; save only the variables that are needed."
            ) from error
        except Exception as error:  # h5py raises a dozen types for damaged files
            raise InputError(f"{path}: this is no MAT file that can be read ({type(error).__name__}).") from error
        self.arrays = {name: value for name, value in found.items() if not isinstance(value, str)}
        self._texts = {name: value for name, value in found.items() if isinstance(value, str)}
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


def _checked(path: Path, name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Vector or matrix of real numbers without its dimensions of length one."""
    if array.size > MOST_NUMBERS:
        raise InputError(f'{path}: "{name}" has {array.size} numbers, and at most {MOST_NUMBERS} are read.')
    return np.squeeze(array) if array.size > 1 else array.reshape(-1)


def _of_mat5(path: Path, data: bytes) -> Iterator[tuple[str, NDArray[Any] | str]]:
    if not is_mat5(data):
        raise InputError(f"{path}: this is no MAT file of version 5 or later; save it with -v7 in MATLAB.")
    for count, (name, value) in enumerate(variables_of_mat5(data), start=1):
        if count > MOST_VARIABLES:
            raise InputError(f"{path}: there are more than the {MOST_VARIABLES} variables that are read.")
        if isinstance(value, str):
            yield name, value
        elif value.size:
            yield name, _checked(path, name, value)


def _of_hdf5(path: Path, data: bytes) -> Iterator[tuple[str, NDArray[Any] | str]]:
    if find_spec("h5py") is None:
        raise InputError(
            f'{path}: MAT files of version 7.3 need h5py; install commonrail[mat], or save it with "-v7" in MATLAB.'
        )
    import h5py

    with h5py.File(BytesIO(data), "r") as file:
        left = most_content(len(data))
        for number, (whole, item) in enumerate(_flat_hdf5(file, "", 0), start=1):
            if number > MOST_VARIABLES:
                raise InputError(f"{path}: there are more than the {MOST_VARIABLES} variables that are read.")
            if isinstance(item, h5py.Group):
                continue
            if item.size is None or item.external or item.is_virtual or not item.size or item.dtype.kind not in "biuf":
                continue
            if item.size > MOST_NUMBERS:
                raise InputError(f'{path}: "{whole}" has {item.size} numbers, and at most {MOST_NUMBERS} are read.')
            left -= item.size * item.dtype.itemsize
            if left < 0:
                raise TooLarge
            array = np.asarray(item[()]).T  # MATLAB keeps columns together
            if item.attrs.get("MATLAB_class") == b"char":
                yield whole, "".join(map(chr, array.reshape(-1, order="F").tolist()))
            else:
                yield whole, _checked(path, whole, array)


def _flat_hdf5(group: Any, inside: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Data sets and groups by their names; where links lead in circles, more than the file holds."""
    import h5py

    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # MATLAB's own, and links, which may lead to other files
        item, whole = group[name], f"{inside}{name}"
        yield whole, item
        if isinstance(item, h5py.Group) and depth < DEEPEST:
            yield from _flat_hdf5(item, f"{whole}.", depth + 1)
