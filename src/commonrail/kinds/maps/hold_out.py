"""Rows of a quantity map that are held out of the fit: its key in a study file, and the two parts of the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from commonrail.errors import ConfigurationError
from commonrail.kinds.base import Role
from commonrail.kinds.maps.baselines import places_of
from commonrail.reading.fields import FileModel, Unit
from commonrail.reading.place import Place
from commonrail.units import to_text

if TYPE_CHECKING:
    from commonrail.kinds.maps.data import QuantityData

__all__ = ["HoldOutModel", "chosen_rows", "divide", "held_out_name", "rows_of"]

Bools = NDArray[np.bool_]

SAME = 1e-6  # relative difference below which a row is at a pressure or time that was asked for


class HoldOutModel(FileModel):
    """Rail pressures and energising times whose rows are kept for validation."""

    rail_pressure: list[Annotated[float, Unit("Pa")]] = Field(default=[], max_length=1000)
    energising_time: list[Annotated[float, Unit("s")]] = Field(default=[], max_length=1000)


def held_out_name(name: str) -> str:
    """Name of the part of a data set that is held out."""
    return f"{name}, held out"


def divide(data: QuantityData, model: HoldOutModel, at: Place) -> tuple[QuantityData, QuantityData]:
    """Part of a map that is fitted, and the part that is held out for validation.

    Held out are the quantities at one of the rail pressures or at one of the energising times, and the dead times at
    one of the rail pressures.

    Parameters
    ----------
    data : QuantityData
        The whole map.
    model : HoldOutModel
    at : Place
        Of the key `hold_out`.

    Raises
    ------
    ConfigurationError
        If the map is no data of the fit, no row is at a pressure or time that is named, or none remains on one side.
    """
    if data.role is not Role.FIT:
        raise at.error('only data with role = "fit" can hold rows out; remove hold_out')
    if not (model.rail_pressure or model.energising_time):
        raise at.error('name rail pressures or energising times, as in { rail_pressure = ["120 MPa"] }')
    held = _rows(data, 0, model.rail_pressure, "Pa", at / "rail_pressure")
    held |= _rows(data, 1, model.energising_time, "s", at / "energising_time") & data.judged
    if not (data.judged & ~held).any():
        raise ConfigurationError(f"{at}: every quantity of {data.name} would be held out; leave some for the fit.")
    return chosen_rows(data, ~held), chosen_rows(data, held, held_out_name(data.name), Role.VALIDATION)


def rows_of(data: QuantityData, column: int, value: float) -> Bools:
    """Rows (n,) at a rail pressure [Pa] (column 0) or an energising time [s] (column 1).

    Parameters
    ----------
    data : QuantityData
    column : int
    value : float
    """
    return np.isclose(places_of(data)[:, column], value, rtol=SAME, atol=0.0)


def chosen_rows(data: QuantityData, rows: Bools, name: str = "", role: Role | None = None) -> QuantityData:
    """Some rows of a map.

    Parameters
    ----------
    data : QuantityData
    rows : (n,) bool
    name : str
        Its own if empty.
    role : Role, optional
        Its own by default.
    """
    density = np.asarray(data.mass_density)
    return replace(
        data,
        name=name or data.name,
        role=role or data.role,
        points=tuple(point for point, keep in zip(data.points, rows.tolist(), strict=True) if keep),
        quantity=data.quantity[rows],
        dead_time=data.dead_time[rows],
        mass_density=density[rows] if density.ndim else data.mass_density,
    )


def _rows(data: QuantityData, column: int, wanted: Sequence[float], unit: str, at: Place) -> Bools:
    """Rows at one of the wanted values."""
    held = np.zeros(len(data.points), bool)
    own = places_of(data)[data.judged, column]
    for value in wanted:
        if not np.isclose(own, value, rtol=SAME, atol=0.0).any():
            there = ", ".join(to_text(float(v), unit) for v in np.unique(own)[:12])
            raise ConfigurationError(f"{at}: {data.name} has no quantity at {to_text(value, unit)}; it has {there}.")
        held |= rows_of(data, column, value)
    return held
