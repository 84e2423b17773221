"""Drawing of plunger and needle in an injector's file: seven cylinders, from which Eq. (8) gives stiffness and mass."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator

from commonrail.injector.definition import Source
from commonrail.parts.furniture import Q
from commonrail.parts.plunger_needle import cylinder_mass, cylinder_stiffness
from commonrail.reading.fields import FileModel, Given, Number, Room, Sourced, Stated, Values, fault

__all__ = ["DrawnRoom"]

CYLINDERS = 7  # five of the plunger, two of the needle

_DRAWN = Source("F", "Eq. (8) from the drawing")
_Length = Annotated[Number, Stated(Q("m", "length"))]


def _table(item: Any) -> Any:
    if not isinstance(item, dict):
        raise fault('write the cylinder as { diameter = "4.3 mm", length = "20 mm" }')
    return item


def _seven(items: Any) -> Any:
    if not isinstance(items, list) or len(items) != CYLINDERS:
        raise fault(
            f'give {CYLINDERS} cylinders {{ diameter = "4.3 mm", length = "20 mm" }}, five of the plunger and two of '
            "the needle"
        )
    return items


class _Cylinder(FileModel):
    diameter: _Length
    length: _Length


class Drawing(Sourced):
    """Sizes of the cylinders and their material."""

    elastic_modulus: Annotated[Number, Stated(Q("Pa", "elastic modulus"))]
    density: Annotated[Number, Stated(Q("kg/m3", "density"))]
    cylinders: Annotated[list[Annotated[_Cylinder, BeforeValidator(_table)]], BeforeValidator(_seven)]

    def values(self) -> Values:
        """k1…k7 and m1…m7, Eq. (8)."""
        origin, modulus, density = self.origin(_DRAWN), self.elastic_modulus.value, self.density.value
        found: Values = {}
        for i, cylinder in enumerate(self.cylinders, start=1):
            size = cylinder.diameter.value, cylinder.length.value
            found[f"k{i}"] = Given(cylinder_stiffness(modulus, *size), origin)
            found[f"m{i}"] = Given(cylinder_mass(density, *size), origin)
        return found


class DrawnRoom(Room):
    """Room of plunger and needle: a number of its own goes before that of the drawing."""

    drawing: Drawing | None = None

    def values(self) -> Values:
        """Numbers of the drawing, and those that are given."""
        return (self.drawing.values() if self.drawing else {}) | super().values()
