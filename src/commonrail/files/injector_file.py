"""Injectors from TOML: a file of the user, or the catalogue that ships with the package.

One table per room, whose keys are the room's parameters. A value is a text with its unit, or an inline
table that adds mark and source; what a file leaves out takes the default of the room.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from commonrail.arguments import source_of
from commonrail.errors import InputError, nearest
from commonrail.files.injector_values import (
    Given,
    read_drawing,
    read_origin,
    read_room,
    read_value,
)
from commonrail.files.injector_writer import FORMAT, dump_injector
from commonrail.files.place import Place, located
from commonrail.files.reach import ALLOW, Reach, read_allowed
from commonrail.files.toml_file import parse_toml, read_toml
from commonrail.fuel.catalogue import load_fuel, parse_fuel
from commonrail.fuel.fuel import Fuel
from commonrail.injector.definition import (
    FUEL_TEMPERATURE,
    Injector,
    Source,
    parameter_quantities,
)
from commonrail.injector.model import Parameters
from commonrail.injector.variants import Body, Boundary, Drive, Variant
from commonrail.parts.furniture import Q

__all__ = ["FORMAT", "dump_injector", "injector_catalogue", "load_injector"]

DRAWN_ROOM = "plunger_needle"

_FOLDER = resources.files("commonrail.injector") / "catalogue"
_FUEL_FORMS = ("name", "file", "definition")
_VARIANT = ("variant", "rail_boundary", "drive_kind")
_Choice = TypeVar("_Choice", bound=Enum)


def injector_catalogue() -> list[str]:
    """Names that `load_injector` knows, sorted."""
    files = (entry.name for entry in _FOLDER.iterdir())
    return sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml"))


def load_injector(source: str | Path, reach: Reach | None = None) -> Injector:
    """Read an injector.

    Parameters
    ----------
    source : str or Path
        Path of a ``.toml`` file, or a name of `injector_catalogue`.
    reach : Reach, optional
        Where the file of its fuel may lie; by default in the injector's folder or below, unless the injector's file
        says ``allow_outside = true``.

    Returns
    -------
    Injector
        Every value in SI, with mark and source.

    Raises
    ------
    InputError
        If the file cannot be read or something in it is unknown, missing, of the wrong kind or outside
        its domain; the message has file and key.
    ConfigurationError
        If `source` is neither a name nor a path.
    """
    source = source_of(source, "source of an injector")
    if isinstance(source, Path):
        path = source
        data, at = read_toml(path)[0], Place(str(path))
        return _injector(data, at, path.stem, reach or Reach(path, read_allowed(data, at)))
    known = injector_catalogue()
    if source not in known:
        raise InputError(
            f'There is no injector "{source}" in the catalogue{_similar(source, known, reach)}: choose one of '
            f"{', '.join(known)}, or give the path of a .toml file."
        )
    file = f"{source}.toml"
    data = parse_toml((_FOLDER / file).read_text(encoding="utf-8"), file)
    return _injector(data, Place(file), source, Reach(Path(file), False))


def _similar(source: str, known: list[str], reach: Reach | None) -> str:
    """Suggestion of a file of that name, else of the nearest name of the catalogue."""
    file = f"{source}.toml"
    try:
        there = ((reach.file.parent if reach else Path()) / file).is_file()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    return f' (did you mean the file "{file}"?)' if there else nearest(source, known)


def _injector(data: Mapping[str, Any], at: Place, stem: str, reach: Reach) -> Injector:
    rooms = tuple(get_type_hints(Parameters))
    at.check_format(data, FORMAT)
    at.refuse_unknown(data, ("format", "name", "title", "synthetic", ALLOW, "fuel", *_VARIANT, *rooms))
    given: dict[str, Given] = {}
    for room in rooms:
        given |= _room(room, _table(data, room, at), at / room)
    fuel_table = _table(data, "fuel", at)
    given[FUEL_TEMPERATURE] = _temperature(fuel_table, at / "fuel")
    name = _text(data, "name", at, stem)
    title, synthetic = _text(data, "title", at, name), _text(data, "synthetic", at, "")
    fuel = _fuel(fuel_table, given[FUEL_TEMPERATURE].value, at / "fuel", reach)
    variant = Variant(
        _choice(data, _VARIANT[0], Body, at),
        _choice(data, _VARIANT[1], Boundary, at),
        _choice(data, _VARIANT[2], Drive, at),
    )
    values = {path: given[path].value for path in parameter_quantities()}
    with located(at):  # a drawing may lead to a stiffness without bounds
        return Injector(
            name,
            title,
            values,
            fuel,
            variant,
            {path: item.source for path, item in given.items()},
            synthetic=synthetic,
        )


def _room(room: str, table: Mapping[str, Any], at: Place) -> dict[str, Given]:
    """Values of a room by dotted name: as given, else from the drawing, else the default."""
    own = {path: q for path, q in parameter_quantities().items() if path.startswith(f"{room}.")}
    quantities = {path.removeprefix(f"{room}."): q for path, q in own.items()}
    drawn: dict[str, Given] = {}
    if room == DRAWN_ROOM and "drawing" in table:
        drawn = read_drawing(table["drawing"], at / "drawing")
        table = {key: value for key, value in table.items() if key != "drawing"}
    values = drawn | read_room(table, quantities, at)
    missing = [name for name, q in quantities.items() if name not in values and q.default is None]
    if missing:
        raise at.error(_missing(missing, quantities))
    return {f"{room}.{name}": values.get(name) or _default(q) for name, q in quantities.items()}


def _missing(names: list[str], quantities: Mapping[str, Q]) -> str:
    first, *others = names
    more = f", nor for {', '.join(others)}" if others else ""
    return f"there is no value for {first}, the {quantities[first].meaning}{more}; add it"


def _default(q: Q) -> Given:
    assert q.default is not None  # the caller has refused what has none
    return Given(q.default, Source("E", "default of commonrail"))


def _temperature(table: Mapping[str, Any], at: Place) -> Given:
    at.refuse_unknown(table, (*_FUEL_FORMS, "temperature", "mark", "source"))
    if "temperature" not in table:
        raise at.error('there is no temperature; add temperature = "80 degC"')
    origin = read_origin(table, Source("E", "no source stated"), at)
    quantity = parameter_quantities()[FUEL_TEMPERATURE]
    return read_value(table["temperature"], quantity, origin, at / "temperature")


def _fuel(table: Mapping[str, Any], temperature: float, at: Place, reach: Reach) -> Fuel:
    forms = [key for key in _FUEL_FORMS if key in table]
    if len(forms) != 1:
        raise at.error('give either name = "iso4113" (a fuel of the catalogue) or file = "my-fuel.toml"')
    fuel = _read_fuel(table, forms[0], at, reach)
    low, high = fuel.temperature_range
    if not low - 1e-6 <= temperature <= high + 1e-6:  # rounding of a conversion from °C
        raise (at / "temperature").error(
            f"{temperature:g} K lies outside the range of {fuel.name}, {low:g} K to {high:g} K"
        )
    return fuel


def _read_fuel(table: Mapping[str, Any], form: str, at: Place, reach: Reach) -> Fuel:
    if form == "definition":
        definition = _table(table, "definition", at)
        inner = at / "definition"
        laws = {key: value for key, value in definition.items() if key != "name"}
        return parse_fuel(laws, _text(definition, "name", inner, "fuel"), str(inner))
    text = _text(table, form, at, "")
    if form == "file":
        path = reach.path(Path(at.file).parent, text, at / form)
        return parse_fuel(read_toml(path)[0], path.stem, str(path))
    try:
        return load_fuel(text)
    except InputError as error:
        raise InputError(f"{at / 'name'}: {error}") from error


def _table(data: Mapping[str, Any], key: str, at: Place) -> Mapping[str, Any]:
    found = data.get(key, {})
    if not isinstance(found, dict):
        raise (at / key).error(f"this must be a table, written [{key}]")
    return found


def _text(data: Mapping[str, Any], key: str, at: Place, default: str) -> str:
    found = data.get(key, default)
    if not isinstance(found, str):
        raise (at / key).error("this must be a text in quotes")
    return found


def _choice(data: Mapping[str, Any], key: str, kind: type[_Choice], at: Place) -> _Choice:
    known = [str(member.value) for member in kind]
    found = data.get(key, known[0])
    if found not in known:
        hint = nearest(str(found), known)
        raise (at / key).error(f'"{found}" is not known{hint}; write one of {", ".join(known)}')
    return kind(found)
