"""Axes on the command line: lists and ranges of values with their unit."""

from __future__ import annotations

import re

import numpy as np

from commonrail.arrays import Floats
from commonrail.errors import InputError
from commonrail.units import compatible, parse, parse_difference

__all__ = ["read_axis", "read_quantities"]

MOST_VALUES = 200
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


def read_axis(text: str, unit: str, option: str, *, increasing: bool = False) -> Floats:
    """Values (n,) of an axis in `unit`.

    Parameters
    ----------
    text : str
        ``"20,40,80MPa"``, ``"20MPa, 400bar"`` or a range ``"20:180:10MPa"`` of first value, last value and step. A unit
        at the end holds for the values before it that have none.
    unit : str
        SI unit of the result.
    option : str
        For messages.
    increasing : bool
        Refuse values that do not increase strictly.

    Raises
    ------
    InputError
        If a value cannot be read, there are none or too many, or they have to increase and do not.
    """
    if ":" in text:
        return _range(text, unit, option)
    texts = _with_units(text.split(","), option)
    values = np.array([parse(one, unit, option) for one in texts])
    if len(values) > MOST_VALUES:
        raise InputError(f"{option}: there are {len(values)} values, and at most {MOST_VALUES} are taken.")
    falls = np.flatnonzero(np.diff(values) <= 0.0).tolist() if increasing else []
    if falls:
        before, after = texts[falls[0] : falls[0] + 2]
        raise InputError(
            f"{option}: the values must increase strictly, but {after} follows {before}; sort them and remove repeated "
            "ones."
        )
    return values


def _range(text: str, unit: str, option: str) -> Floats:
    parts = text.split(":")
    if len(parts) != 3:
        raise InputError(f'{option} "{text}": a range is FIRST:LAST:STEP, such as 20:180:10MPa.')
    texts = _with_units(parts, option)
    first, last = (parse(one, unit, option) for one in texts[:2])
    step = parse_difference(texts[2], unit, option)  # of a temperature: 20 degC between two values, not 293 K
    if not (step > 0.0 and last >= first):
        raise InputError(
            f'{option} "{text}": the step of a range must be greater than zero, the last value not smaller.'
        )
    count = int(np.floor((last - first) / step * (1.0 + 1e-9) + 1e-9)) + 1
    if count > MOST_VALUES:
        raise InputError(f'{option} "{text}": the range has {count} values, and at most {MOST_VALUES} are taken.')
    return np.array([float(f"{first + step * i:.12g}") for i in range(count)])


def _with_units(parts: list[str], option: str) -> list[str]:
    """Texts with a unit each, taken from the next one that has one."""
    found: list[str] = []
    unit = ""
    for part in reversed(parts):
        match = _NUMBER.fullmatch(part)
        if match is None:
            raise InputError(
                f'{option}: "{part.strip()}" is not a number with a unit; write a list such as 20,40,80MPa.'
            )
        unit = match[2] or unit
        found.append(f"{match[1]} {unit}")
    return found[::-1]


def read_quantities(text: str, density: float, option: str) -> Floats:
    """Quantities (n,) by volume [m³], which increase strictly; masses are divided by the reference density.

    Parameters
    ----------
    text : str
        As `read_axis` takes it.
    density : float
        [kg/m³].
    option : str
        For messages.

    Raises
    ------
    InputError
        As `read_axis`.
    """
    unit = _NUMBER.fullmatch(re.split("[,:]", text)[-1])
    if unit is not None and unit[2] and _is_mass(unit[2]):
        return read_axis(text, "kg", option, increasing=True) / density
    return read_axis(text, "m3", option, increasing=True)


def _is_mass(unit: str) -> bool:
    try:
        return compatible(unit, "kg")
    except InputError:
        return False
