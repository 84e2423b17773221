"""Quantity map of a MAT file: two vectors, rail pressures and energising times, and a matrix of quantities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.base.text import count_noun
from commonrail.readers.columns import PLAIN, Column, FileForm, Table, find_column, finite
from commonrail.readers.guarded import read_apart
from commonrail.readers.location import MOST_COLUMNS, check_columns
from commonrail.readers.quantity_matrix import (
    KINDS,
    FoundMap,
    GivenUnits,
    Matrix,
    find_kind,
    map_of_matrix,
    plain_unit,
)

# Variables of a MAT file, of version 5 to 7 or of version 7.3, which is HDF5; both are read in a child process.
#
# Fields of structures are named with a point, ``run.rate``, and columns of a matrix ``rate(:,2)``. MATLAB knows no
# units: the unit of ``rate`` is the text ``rate_unit`` or the field ``units.rate`` next to it, or stated by the reader.

MOST_NAMES = 10_000  # vectors and columns of matrices
_HDF5 = b"\x89HDF\r\n\x1a\n"


class MatFile:
    """MAT file, a `Sheet`.

    The `form` has no meaning here. Raises `InputError` if it cannot be read, is beyond a limit, or h5py is needed and
    not installed.
    """

    independent_columns = True

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        self.path = path
        data = read_plain(path)
        if _HDF5 in (data[:8], data[512:520]) and find_spec("h5py") is None:
            raise InputError(
                f'{path}: MAT files of version 7.3 need h5py; install commonrail[mat], or save it with "-v7" in MATLAB.'
            )
        about, arrays = read_apart(f"{__name__}_child", path, data)
        self.arrays: dict[str, NDArray[Any]] = {name: arrays[str(i)] for i, name in enumerate(about["names"])}
        self._texts: dict[str, str] = about["texts"]
        self.unread: dict[str, str] = {name: f"not read: {reason}" for name, reason in about["unread"].items()}
        count = sum(array.shape[1] if array.ndim == 2 else 1 for array in self.arrays.values())
        check_columns(str(path), count, MOST_NAMES)
        self._columns = dict(_columns(self.arrays))
        self.names = list(self._columns)
        if not self.names:
            reasons = [f'; "{name}": {reason}' for name, reason in list(about["unread"].items())[:4]]
            raise InputError(f"{path}: the file has no variable with numbers{''.join(reasons)}.")

    def unit(self, name: str) -> str:
        """Unit of a variable, or empty."""
        structure, _, last = name.partition("(")[0].rpartition(".")
        inside = f"{structure}." if structure else ""
        beside = [f"{inside}{last}_unit", f"{inside}units.{last}", f"units.{last}"]
        beside += [f"{inside}unit"] if last in ("value", "values") else []
        return next((self._texts[text].strip(" []") for text in beside if text in self._texts), "")

    def quantity_map(self, given_units: GivenUnits) -> FoundMap:
        """Quantity map of the variables, by their units and names; see `HoldsMap`.

        `given_units` override the units of the file. Raises `InputError` if the file has no map or several maps, or a
        unit is missing.
        """
        stated = given_units.by_kind()
        is_inverse = _fitting(self, "energising time", 2) and not _fitting(self, "quantity", 2)
        cells, axis = ("energising time", "quantity")[:: 1 if is_inverse else -1]
        names = {kind: _variable(self, kind, 2 if kind == cells else 1) for kind in KINDS}
        units = {kind: stated[kind] or plain_unit(self.unit(name)) for kind, name in names.items()}
        missing = [f'{kind} ("{names[kind]}")' for kind in KINDS if not units[kind]]
        if missing:
            raise InputError(
                f"{self.path}: no unit of the {' and the '.join(missing)} is in the file; state it, or add a text such "
                f'as {names["quantity"]}_unit = "mm3".'
            )
        rail, other, values = (
            np.asarray(self.arrays[names[kind]], np.float64) for kind in ("rail pressure", axis, cells)
        )
        if values.shape == (len(other), len(rail)) != (len(rail), len(other)):
            values = values.T
        if values.shape != (len(rail), len(other)):
            raise InputError(
                f'{self.path}: "{names[cells]}" is {values.shape[0]} × {values.shape[1]}, and there are '
                f"{count_noun(len(rail), 'rail pressure')} and {count_noun(len(other), axis)}."
            )
        said = ["variables " + ", ".join(f'"{name}"' for name in names.values())]
        matrix = Matrix(rail, other, values, np.arange(1, values.size + 1))
        return map_of_matrix(self.path, matrix, units, [("rail pressure", axis)], said)

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of variables; see `Sheet.take`."""
        names = [column.name for column in columns]
        for name in set(names).difference(self._columns):
            find_column(self.path, self.names, name)  # its message lists the variables
        lengths = {name: len(self._columns[name]) for name in names}
        if len(set(lengths.values())) > 1:
            said = ", ".join(f'"{name}" {length}' for name, length in lengths.items())
            raise InputError(f"{self.path}: the variables have different numbers of values: {said}.")
        numbers = {name: self._columns[name].astype(np.float64) for name in names}
        rows = np.arange(1, 1 + next(iter(lengths.values()), 0))
        table = Table(self.path, numbers, {}, {name: self.unit(name) for name in names}, rows, row="value")
        return finite(table, columns, "this is not a finite number")


def _columns(arrays: dict[str, NDArray[Any]]) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, array in arrays.items():
        if array.ndim == 1:
            yield name, array
        elif array.ndim == 2 and array.shape[1] <= MOST_COLUMNS:
            yield from ((f"{name}(:,{i + 1})", array[:, i]) for i in range(array.shape[1]))


# Last parts of names, used if not exactly one variable has a unit of the kind.
_NAMES = {
    "rail pressure": ("rail_pressure", "p_rail", "prail", "rail", "p"),
    "energising time": ("energising_time", "et", "ti"),
    "quantity": ("quantity", "q"),
}


def _variable(file: MatFile, kind: str, dimensions: int) -> str:
    """The variable that holds a kind: the only one with such a unit, else the one with a usual name."""
    candidates = _fitting(file, kind, dimensions)
    if len(candidates) == 1:
        return candidates[0]
    fitting = [name for name, array in file.arrays.items() if array.ndim == dimensions]
    shown = ", ".join(f'"{name}"' for name in (candidates or fitting)[:12]) or "none"
    word = "matrices" if dimensions == 2 else "vectors"
    raise InputError(
        f"{file.path}: it is open which variable holds the {kind}; of the {word} {shown}, name one "
        f'"{_NAMES[kind][0]}" or give it the unit of one.'
    )


def _fitting(file: MatFile, kind: str, dimensions: int) -> list[str]:
    """Variables that hold a kind by their unit, else by their name."""
    fitting = [name for name, array in file.arrays.items() if array.ndim == dimensions]
    of_kind = [name for name in fitting if (unit := file.unit(name)) and find_kind(unit) == kind]
    return of_kind if len(of_kind) == 1 else _find_named(of_kind or fitting, kind)


def _find_named(names: Sequence[str], kind: str) -> list[str]:
    """Variables with the first usual name that occurs."""
    for usual in _NAMES[kind]:
        matches = [name for name in names if name.rpartition(".")[2].lower() == usual]
        if matches:
            return matches
    return []
