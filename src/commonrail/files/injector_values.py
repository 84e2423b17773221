"""Single values of an injector file: number with unit, mark and source; and the plunger–needle's drawing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from commonrail.files.place import Place
from commonrail.injector.definition import Source
from commonrail.parts.furniture import Q
from commonrail.parts.plunger_needle import cylinder_mass, cylinder_stiffness
from commonrail.units import parse, to_text

__all__ = ["MARKS", "Given", "read_drawing", "read_origin", "read_room", "read_value"]

MARKS = ("M", "C", "F", "E")
CYLINDERS = 7  # five of the plunger, two of the needle

_UNSTATED = Source("E", "no source stated")
_DRAWN = Source("F", "Eq. (8) from the drawing")
_MODULUS = Q("Pa", "elastic modulus")
_DENSITY = Q("kg/m3", "density")
_LENGTH = Q("m", "length")


class Given(NamedTuple):
    """A value [SI] and its source."""

    value: float
    source: Source


def read_room(table: Mapping[str, Any], quantities: Mapping[str, Q], at: Place) -> dict[str, Given]:
    """Values that a room's table gives, by name; its keys mark and source are defaults for them."""
    at.refuse_unknown(table, (*quantities, "mark", "source"))
    origin = read_origin(table, _UNSTATED, at)
    return {name: read_value(table[name], q, origin, at / name) for name, q in quantities.items() if name in table}


def read_origin(table: Mapping[str, Any], default: Source, at: Place) -> Source:
    """Mark and source that a table states."""
    mark, text = table.get("mark", default.mark), table.get("source", default.text)
    if mark not in MARKS:
        raise (at / "mark").error(f'"{mark}" is no mark; write one of {", ".join(MARKS)}')
    if not isinstance(text, str):
        raise (at / "source").error("this must be a text in quotes")
    return Source(mark, text)


def read_value(item: object, q: Q, origin: Source, at: Place) -> Given:
    """Value of one key: ``"1.22e8 N/m"`` or ``{ value = "1.22e8 N/m", mark = "E", source = "…" }``."""
    if isinstance(item, dict):
        at.refuse_unknown(item, ("value", "mark", "source"))
        origin = read_origin(item, origin, at)
        if "value" not in item:
            raise at.error("the inline table has no value")
        item = item["value"]
    value = parse(item, q.unit, str(at))  # type: ignore[arg-type]  # parse refuses other types
    if not q.domain.admits(value):
        raise at.error(f"the {q.meaning} must be {q.domain.value}, not {to_text(value, q.unit)}")
    return Given(value, origin)


def read_drawing(item: object, at: Place) -> dict[str, Given]:
    """k1…k7 and m1…m7 of the cylinders of a drawing, Eq. (8)."""
    if not isinstance(item, dict):
        raise at.error("this must be a table, written [plunger_needle.drawing]")
    at.refuse_unknown(item, ("elastic_modulus", "density", "cylinders", "mark", "source"))
    origin = read_origin(item, _DRAWN, at)
    modulus = _drawn(item, "elastic_modulus", _MODULUS, at)
    density = _drawn(item, "density", _DENSITY, at)
    found: dict[str, Given] = {}
    for i, (diameter, length) in enumerate(_cylinders(item, at / "cylinders"), start=1):
        found[f"k{i}"] = Given(cylinder_stiffness(modulus, diameter, length), origin)
        found[f"m{i}"] = Given(cylinder_mass(density, diameter, length), origin)
    return found


def _cylinders(item: Mapping[str, Any], at: Place) -> list[tuple[float, float]]:
    """Diameter and length of each cylinder [m]."""
    cylinders = item.get("cylinders")
    if not isinstance(cylinders, list) or len(cylinders) != CYLINDERS:
        raise at.error(
            f'give {CYLINDERS} cylinders {{ diameter = "4.3 mm", length = "20 mm" }}, five of the '
            "plunger and two of the needle"
        )
    return [_cylinder(cylinder, at[i]) for i, cylinder in enumerate(cylinders)]


def _cylinder(item: object, at: Place) -> tuple[float, float]:
    """Diameter and length [m]."""
    if not isinstance(item, dict):
        raise at.error('write the cylinder as { diameter = "4.3 mm", length = "20 mm" }')
    at.refuse_unknown(item, ("diameter", "length"))
    return _drawn(item, "diameter", _LENGTH, at), _drawn(item, "length", _LENGTH, at)


def _drawn(item: Mapping[str, Any], key: str, q: Q, at: Place) -> float:
    if key not in item:
        raise at.error(f"there is no {key}; add it")
    return read_value(item[key], q, _DRAWN, at / key).value
