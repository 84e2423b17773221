"""Named arrays in the units that engineers use."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.units import convert

__all__ = ["Array", "Arrays", "edge", "in_edge_units"]

# SI unit of a kind of value, and the unit at the edge.
_EDGE = {"Pa": "MPa", "s": "us", "m3": "mm3", "kg": "mg", "m": "um", "K": "degC", "m3/s": "mm3/ms"}


class Array(NamedTuple):
    """Named values over named axes.

    Attributes
    ----------
    axes : tuple of str
    values : array
        One dimension for each axis.
    unit : str
        Empty for what has none.
    """

    axes: tuple[str, ...]
    values: NDArray[Any]
    unit: str = ""


class Arrays(NamedTuple):
    """Axes by name, arrays over them by name, and the title."""

    axes: dict[str, Array]
    values: dict[str, Array]
    title: str


def edge(unit: str) -> str:
    """Unit in which a value of an SI unit leaves the program."""
    return _EDGE.get(unit, unit)


def in_edge_units(axes: tuple[str, ...], values: Any, unit: str) -> Array:
    """Array in the unit at the edge, from SI values.

    Parameters
    ----------
    axes : tuple of str
    values : array
    unit : str
        SI unit.
    """
    found = np.asarray(values)
    return Array(axes, convert(found, unit, edge(unit)) if unit in _EDGE else found, edge(unit).removesuffix("1"))
