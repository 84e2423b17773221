"""Variables of a MAT file, of version 5 to 7 by SciPy and of version 7.3, which is HDF5, by h5py.

Fields of structures are named with a point, ``run.rate``, and columns of a matrix ``rate(:,2)``. MATLAB knows no
units: that of ``rate`` is the text ``rate_unit`` or the field ``units.rate`` beside it, or is stated by the reader.
"""

from __future__ import annotations

import zlib
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
from commonrail.reading.sheet import Column, Table, cell_place, find_column

__all__ = ["MatFile"]

LARGEST_CONTENT = 1_000_000_000  # of a compressed file when it is unpacked [bytes]
MOST_NUMBERS = 20_000_000  # of a variable
MOST_VARIABLES = 10_000
MOST_COLUMNS = 1000  # of a matrix that is taken for columns
DEEPEST = 4  # structures in structures

_HDF5 = b"\x89HDF\r\n\x1a\n"
_HEAD = 128  # bytes before the first variable
_COMPRESSED = 15  # type of an element

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
        except Exception as error:  # both libraries raise a dozen types for damaged files
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
    from scipy import io

    _check_packed(path, data)
    content = io.loadmat(BytesIO(data), struct_as_record=False, squeeze_me=True)
    for name, value in content.items():
        if not name.startswith("__"):
            yield from _flat(path, name, value, 0)


def _flat(path: Path, name: str, value: Any, depth: int) -> Iterator[tuple[str, NDArray[Any] | str]]:
    fields = getattr(value, "_fieldnames", None)
    if fields is not None:
        for field in fields if depth < DEEPEST else ():
            yield from _flat(path, f"{name}.{field}", getattr(value, field), depth + 1)
    elif isinstance(value, str):
        yield name, value
    else:
        array = np.asarray(value)
        if array.dtype.kind in "biuf" and array.size:
            yield name, _checked(path, name, array)


def _of_hdf5(path: Path, data: bytes) -> Iterator[tuple[str, NDArray[Any] | str]]:
    if find_spec("h5py") is None:
        raise InputError(
            f'{path}: MAT files of version 7.3 need h5py; install commonrail[mat], or save it with "-v7" in MATLAB.'
        )
    import h5py

    with h5py.File(BytesIO(data), "r") as file:
        yield from _flat_hdf5(path, file, "", 0)


def _flat_hdf5(path: Path, group: Any, inside: str, depth: int) -> Iterator[tuple[str, NDArray[Any] | str]]:
    import h5py

    if len(group) > MOST_VARIABLES:
        raise InputError(f"{path}: there are {len(group)} variables, and at most {MOST_VARIABLES} are read.")
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # MATLAB's own, and links, which may lead to other files
        item, whole = group[name], f"{inside}{name}"
        if isinstance(item, h5py.Group):
            if depth < DEEPEST:
                yield from _flat_hdf5(path, item, f"{whole}.", depth + 1)
            continue
        if item.size is None or item.external or item.is_virtual or not item.size or item.dtype.kind not in "biuf":
            continue
        if item.size > MOST_NUMBERS:
            raise InputError(f'{path}: "{whole}" has {item.size} numbers, and at most {MOST_NUMBERS} are read.')
        array = np.asarray(item[()]).T  # MATLAB keeps columns together
        if item.attrs.get("MATLAB_class") == b"char":
            yield whole, "".join(map(chr, array.reshape(-1, order="F").tolist()))
        else:
            yield whole, _checked(path, whole, array)


def _check_packed(path: Path, data: bytes) -> None:
    """Refuse a file of version 7 whose compressed variables are more than is read."""
    order = "little" if data[126:128] == b"IM" else "big"
    total, start = 0, _HEAD
    while start + 8 <= len(data):
        kind, length = (int.from_bytes(data[start + i : start + i + 4], order) for i in (0, 4))  # type: ignore[arg-type]
        if kind == _COMPRESSED:
            total += _unpacked(data[start + 8 : start + 8 + length], LARGEST_CONTENT - total)
            if total > LARGEST_CONTENT:
                raise InputError(f"{path}: unpacked the file has more than the {LARGEST_CONTENT / 1e6:g} MB read.")
        start += 8 + length


def _unpacked(packed: bytes, most: int) -> int:
    """Bytes of a compressed element, counted to one more than `most`."""
    unpack, size = zlib.decompressobj(), 0
    try:
        piece = unpack.decompress(packed, 1 << 20)
        while piece and size <= most:
            size += len(piece)
            piece = unpack.decompress(unpack.unconsumed_tail, 1 << 20)
    except zlib.error:
        return size  # damaged: told when it is read
    return size
