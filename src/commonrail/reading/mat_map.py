"""Quantity map of a MAT file: two vectors, rail pressures and energising times, and a matrix of quantities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.display.text import counted
from commonrail.errors import InputError
from commonrail.reading.map_table import KINDS, FoundMap, GivenUnits, kind_of
from commonrail.reading.mat_file import MatFile

__all__ = ["find_mat_map"]


# Last parts of names, where several variables have a unit of the kind or none has.
_NAMES = {
    "rail pressure": ("rail_pressure", "p_rail", "prail", "rail", "p"),
    "energising time": ("energising_time", "et", "ti"),
    "quantity": ("quantity", "q"),
}


def find_mat_map(file: MatFile, given: GivenUnits = GivenUnits()) -> FoundMap:
    """Quantity map of the variables of a MAT file, by their units and names.

    Parameters
    ----------
    file : MatFile
    given : GivenUnits
        They count before those of the file.

    Raises
    ------
    InputError
        If none is found, several are, or a unit is missing.
    """
    stated = given.by_kind()
    names = {kind: _variable(file, kind, 2 if kind == "quantity" else 1) for kind in KINDS}
    units = {kind: stated[kind] or _plain(file.unit(name)) for kind, name in names.items()}
    missing = [f'{kind} ("{names[kind]}")' for kind, unit in units.items() if not unit]
    if missing:
        raise InputError(
            f"{file.path}: no unit of the {' and the '.join(missing)} is in the file; state it, or add a text such as "
            f'{names["quantity"]}_unit = "mm3".'
        )
    rail, time, cells = (np.asarray(file.arrays[names[kind]], np.float64) for kind in KINDS)
    if cells.shape == (len(rail), len(time)):
        way = "down"
    elif cells.shape == (len(time), len(rail)):
        way, cells = "across", cells.T
    else:
        raise InputError(
            f'{file.path}: "{names["quantity"]}" is {cells.shape[0]} × {cells.shape[1]}, and there are '
            f"{counted(len(rail), 'rail pressure')} and {counted(len(time), 'energising time')}."
        )
    pressure, moments = np.repeat(rail, len(time)), np.tile(time, len(rail))
    filled = np.isfinite(cells).ravel()
    if not filled.any():
        raise InputError(f'{file.path}: the map holds no quantity; "{names["quantity"]}" has no finite number.')
    other = "across" if way == "down" else "down"
    said = [f'variables "{names["rail pressure"]}", "{names["energising time"]}" and "{names["quantity"]}"']
    if empty := int(cells.size - filled.sum()):
        said.append(f"{empty} without a quantity omitted")
    return FoundMap(
        f"a matrix with rail pressures {way} and energising times {other}",
        pressure[filled],
        moments[filled],
        cells.ravel()[filled],
        units,
        tuple(said),
        np.flatnonzero(filled) + 1,
    )


def _variable(file: MatFile, kind: str, dimensions: int) -> str:
    """The variable that holds a kind: the only one with such a unit, else the one with a usual name."""
    fitting = [name for name, array in file.arrays.items() if array.ndim == dimensions]
    found = [name for name in fitting if _kind(file.unit(name)) == kind]
    if len(found) != 1:
        found = _named(found or fitting, kind)
    if len(found) == 1:
        return found[0]
    shown = ", ".join(f'"{name}"' for name in (found or fitting)[:12]) or "none"
    word = "matrices" if dimensions == 2 else "vectors"
    raise InputError(
        f"{file.path}: it is open which variable holds the {kind}; of the {word} {shown}, name one "
        f'"{_NAMES[kind][0]}" or give it the unit of one.'
    )


def _named(names: Sequence[str], kind: str) -> list[str]:
    """Variables by the first of the usual names that any of them has."""
    for usual in _NAMES[kind]:
        found = [name for name in names if name.rpartition(".")[2].lower() == usual]
        if found:
            return found
    return []


def _kind(unit: str) -> str:
    return kind_of(unit) if unit else ""


def _plain(unit: str) -> str:
    return unit.replace("µ", "u").replace("³", "3")
