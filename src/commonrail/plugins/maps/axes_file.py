"""Axes of a map from a file of a control unit."""

from __future__ import annotations

from pathlib import Path

from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.units import compatible, convert
from commonrail.plugins.maps.dcm import read_dcm
from commonrail.plugins.maps.table import Axis
from commonrail.readers.location import Place, located


def axes_of_dcm(path: Path, density: float) -> tuple[Floats, Floats]:
    """Rail pressures [Pa] and quantities [m³] of the first map of a DCM file that has such axes.

    InputError if none has. Quantities by mass are divided by the reference density [kg/m³].
    """
    for table in read_dcm(path):
        for pressure, quantity in ((table.x, table.y), (table.y, table.x)):
            with located(Place(str(path), table.label)):
                if not (_is(pressure, "Pa") and (_is(quantity, "m3") or _is(quantity, "kg"))):
                    continue
                volumes = (
                    convert(quantity.values, quantity.unit, "m3")
                    if _is(quantity, "m3")
                    else convert(quantity.values, quantity.unit, "kg") / density
                )
                return convert(pressure.values, pressure.unit, "Pa"), volumes
    raise InputError(f"{path}: no map in it has an axis of pressure and one of quantity, with their units.")


def _is(axis: Axis, unit: str) -> bool:
    try:
        return bool(axis.unit) and compatible(axis.unit, unit)
    except InputError:
        return False
