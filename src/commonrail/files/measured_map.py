"""Measured quantity maps as a model is compared with them, in SI units."""

from __future__ import annotations

from pathlib import Path

from commonrail.maps.difference import MeasuredMap
from commonrail.reading.grid import read_grid
from commonrail.reading.map_table import FoundMap, find_map
from commonrail.units import convert

__all__ = ["in_si", "read_measured_map"]


def read_measured_map(path: Path, density: float) -> MeasuredMap:
    """Measured quantities of a file.

    Parameters
    ----------
    path : Path
        CSV or workbook.
    density : float
        Density that makes volumes of masses [kg/m³].

    Raises
    ------
    InputError
        If it cannot be read or no map is found in it.
    """
    return in_si(find_map(read_grid(path)), density)


def in_si(found: FoundMap, density: float) -> MeasuredMap:
    """Map in SI units; masses are divided by a density [kg/m³]."""
    units = found.units
    rail = convert(found.rail_pressure, units["rail pressure"], "Pa")
    time = convert(found.energising_time, units["energising time"], "s")
    if found.by_mass:
        return MeasuredMap(rail, time, convert(found.quantity, units["quantity"], "kg") / density)
    return MeasuredMap(rail, time, convert(found.quantity, units["quantity"], "m3"))
