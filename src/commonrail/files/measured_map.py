"""Measured quantity maps from files, as a table of points or as a matrix."""

from __future__ import annotations

from pathlib import Path

from commonrail.maps.difference import MeasuredMap
from commonrail.parts.furniture import Domain
from commonrail.reading.tables import Column, read_columns

__all__ = ["read_measured_map"]


def read_measured_map(path: Path, density: float) -> MeasuredMap:
    """Measured quantities of a file.

    Parameters
    ----------
    path : Path
        Columns rail_pressure, energising_time and quantity with their units.
    density : float
        Density that makes volumes of masses [kg/m³].

    Raises
    ------
    InputError
        If it cannot be read.
    """
    wanted = [
        Column("rail_pressure", "Pa", domain=Domain.POSITIVE),
        Column("energising_time", "s", domain=Domain.POSITIVE),
        Column("quantity", ("m3", "kg"), domain=Domain.NON_NEGATIVE),
    ]
    table = read_columns(path, wanted, 1)
    quantity = table.columns["quantity"] / (density if table.units["quantity"] == "kg" else 1.0)
    return MeasuredMap(table.columns["rail_pressure"], table.columns["energising_time"], quantity)
