"""Reading fuels from TOML: the catalogue that ships with the package, and files of the same form.

Every table of such a file carries its unit, mark, source and error, and none may be left out.
"""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Mapping
from importlib import resources
from typing import Any

from commonrail.arguments import plain_text
from commonrail.errors import InputError, nearest
from commonrail.fuel.fuel import Fuel, Law, Origin, Polynomial

__all__ = ["catalogue", "load_fuel", "parse_fuel"]

_FOLDER = resources.files("commonrail.fuel") / "catalogue"
_MARKS = "MCFE"  # from the strongest to the weakest
_EQ2 = ("k1", "k2", "k3", "k4")
_DENSITY_KEYS = {"eq2": _EQ2, "integrated": ("at_zero_pressure",)}


def catalogue() -> list[str]:
    """Return the names that `load_fuel` knows, sorted."""
    files = (entry.name for entry in _FOLDER.iterdir())
    return sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml"))


def load_fuel(name: str) -> Fuel:
    """Return a fuel of the catalogue.

    Parameters
    ----------
    name : str
        One of `catalogue()`, such as ``"iso4113"``.

    Raises
    ------
    InputError
        If there is no such fuel; the message proposes the nearest name.
    ConfigurationError
        If it is no text.
    """
    known = catalogue()
    if plain_text(name, "name of a fuel") not in known:
        hint = nearest(name, known)
        raise InputError(f'There is no fuel "{name}"{hint}: choose one of {", ".join(known)}.')
    return _of_catalogue(name)


@functools.cache
def _of_catalogue(name: str) -> Fuel:
    text = (_FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    return parse_fuel(tomllib.loads(text), name, f"catalogue/{name}.toml")


def parse_fuel(data: Mapping[str, Any], name: str, where: str) -> Fuel:
    """Return the fuel that a parsed TOML document describes.

    Parameters
    ----------
    data : mapping
        The document: title, source, [range], [density], [bulk_modulus],
        [isentropic_bulk_modulus], [kinematic_viscosity], [vapour_pressure].
    name : str
        Name to give the fuel.
    where : str
        What to call the document in messages.

    Raises
    ------
    InputError
        If something is missing, of the wrong type, in another unit, or contradicts the rest.
    """
    kind = _entry(_table(data, "density", where), "kind", str, f"{where}, [density]")
    if kind not in _DENSITY_KEYS:
        raise InputError(f'{where}, [density]: kind is "{kind}", write "eq2" or "integrated".')
    if (kind == "integrated") != ("bulk_modulus" in data):
        raise InputError(
            f"{where}: write a table [bulk_modulus] if, and only if, [density] has "
            f'kind = "integrated", because an explicit density law already fixes the modulus.'
        )
    density = _law(data, "density", "kg/m3", _DENSITY_KEYS[kind], where)
    isothermal = _law(data, "bulk_modulus", "MPa", _EQ2, where) if kind == "integrated" else None
    own_isentropic = kind == "eq2" or "isentropic_bulk_modulus" in data
    isentropic = _law(data, "isentropic_bulk_modulus", "MPa", _EQ2, where) if own_isentropic else None
    viscosity = _law(data, "kinematic_viscosity", "mm2/s", _EQ2[:3], where)
    vapour = _law(data, "vapour_pressure", "ln(Pa)", ("ln_pressure",), where)
    used = [law for law in (density, isothermal, isentropic, viscosity, vapour) if law is not None]
    pressure, temperature = (_range(data, key, where) for key in ("pressure_MPa", "temperature_K"))
    return Fuel(
        name=name,
        title=_entry(data, "title", str, where),
        density_law=density,
        bulk_modulus_law=isothermal,
        isentropic_law=isentropic,
        viscosity_law=viscosity,
        vapour_law=vapour,
        pressure_range=(pressure[0] * 1e6, pressure[1] * 1e6),
        temperature_range=temperature,
        mark=max((law.origin.mark for law in used), key=_MARKS.index),
        source=_entry(data, "source", str, where),
    )


def _law(data: Mapping[str, Any], key: str, unit: str, names: tuple[str, ...], where: str) -> Law:
    table = _table(data, key, where)
    place = f"{where}, [{key}]"
    if (given := _entry(table, "unit", str, place)) != unit:
        raise InputError(f'{place}: unit is "{given}", convert the coefficients to "{unit}".')
    return Law(tuple(_polynomial(table, name, place) for name in names), _origin(table, place))


def _origin(table: Mapping[str, Any], place: str) -> Origin:
    mark = _entry(table, "mark", str, place)
    if mark not in tuple(_MARKS):
        raise InputError(f'{place}: mark is "{mark}", write one of M, C, F, E.')
    error = _entry(table, "error", float, place)
    if not (math.isfinite(error) and error >= 0.0):
        raise InputError(f"{place}: error is {error:g}, write a relative error of at least 0.")
    return Origin(mark, _entry(table, "source", str, place), error)


def _polynomial(table: Mapping[str, Any], key: str, place: str) -> Polynomial:
    values = _entry(table, key, list, place)
    if not values or not all(_is_number(value) and math.isfinite(value) for value in values):
        raise InputError(f"{place}: {key} must be a list of numbers, ascending in temperature.")
    return tuple(float(value) for value in values)


def _range(data: Mapping[str, Any], key: str, where: str) -> tuple[float, float]:
    place = f"{where}, [range]"
    ends = _polynomial(_table(data, "range", where), key, place)
    if len(ends) != 2 or not 0.0 <= ends[0] < ends[1]:
        raise InputError(f"{place}: {key} must be [lower, upper] with 0 <= lower < upper.")
    return ends[0], ends[1]


def _table(data: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    table: Mapping[str, Any] = _entry(data, key, dict, where)
    return table


def _entry(table: Mapping[str, Any], key: str, kind: type, place: str) -> Any:
    value = table.get(key)
    if kind is float and _is_number(value):
        return float(value)  # type: ignore[arg-type]
    if not isinstance(value, kind):
        what = {str: "a text", float: "a number", list: "a list", dict: "a table"}[kind]
        raise InputError(f'{place}: "{key}" is missing or not {what}, add it.')
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
