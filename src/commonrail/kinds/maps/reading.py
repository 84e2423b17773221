"""Reading of quantity maps: chosen rows of a table, one operating point each, and dead times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.validity import check_point
from commonrail.errors import ConfigurationError, InputError
from commonrail.kinds.reading import Columns, Context, DataModel, Place, TableModel, Value, drive_unit, mass_density
from commonrail.units import parse, to_text

__all__ = ["DeadTimesModel", "QuantitiesModel", "ReadMap", "read_map"]

Floats = NDArray[np.float64]

AFTER_ENERGISING = 3e-3  # simulated after the end of energising; it ends early once the needle has closed [s]
MOST_POINTS = 10_000
SAME = 1e-6  # relative difference below which a row is at a pressure or time that was asked for


class DeadTimesModel(TableModel):
    """Energising times at which a small quantity is reached."""

    file: str
    quantity: Value
    rail_pressure_unit: str | None = None
    energising_time_unit: str | None = None


class QuantitiesModel(DataModel):
    """A map of quantities per stroke; rail_pressure and energising_time choose rows of it."""

    selects_rows: ClassVar[bool] = True
    quantity_column: ClassVar[str] = "quantity"

    kind: Literal["quantities"]
    rail_pressure_unit: str | None = None
    energising_time_unit: str | None = None
    quantity_unit: str | None = None
    rail_pressure: list[Value] | None = Field(default=None, min_length=1, max_length=1000)
    energising_time: list[Value] | None = Field(default=None, min_length=1, max_length=1000)
    dead_times: DeadTimesModel | None = None
    cylinder_pressure: Value
    return_pressure: Value
    absolute: Value = "0.15 mm3"
    relative: Value = 0.03

    @property
    def has_dead_times(self) -> bool:
        """True if a second file has dead times."""
        return self.dead_times is not None


class _Row(NamedTuple):
    """One operating point and its measured quantity in `unit` (m3 or kg)."""

    point: OperatingPoint
    quantity: float
    unit: str
    dead_time: bool


class ReadMap(NamedTuple):
    """What files say of a map: points, volumes [m³], tolerances, dead times, density that made volumes of masses."""

    points: tuple[OperatingPoint, ...]
    quantity: Floats
    absolute: float
    relative: float
    dead_time: NDArray[np.bool_]
    mass_density: Floats | float


def read_map(model: QuantitiesModel, context: Context, at: Place) -> ReadMap:
    """Read a quantity map; see `DataSet.read`.

    Parameters
    ----------
    model : QuantitiesModel
    context : Context
    at : Place
        Of the data set in the study file.
    """
    injector = context.injector
    if drive_unit(injector):
        raise ConfigurationError(
            f'{at}: the injector {injector.name} has drive_kind "{injector.variant.drive.value}", '
            "which quantities cannot give; set it to regulated or pwm."
        )
    rows = _map_rows(model, context, at) + _dead_time_rows(model, context, at)
    absolute, relative = _tolerances(model, at)
    density = np.array([mass_density(injector, row.unit, row.point) for row in rows])
    by_volume = np.isnan(density)
    quantity = np.array([row.quantity for row in rows])
    return ReadMap(
        tuple(row.point for row in rows),
        quantity / np.where(by_volume, 1.0, density),
        absolute,
        relative,
        np.array([row.dead_time for row in rows]),
        math.nan if by_volume.all() else density,
    )


def _map_rows(model: QuantitiesModel, context: Context, at: Place) -> list[_Row]:
    column = model.quantity_column
    table = context.columns(
        model.file,
        at,
        {"rail_pressure": "Pa", "energising_time": "s", column: ("m3", "kg")},
        stated={
            "rail_pressure": model.rail_pressure_unit,
            "energising_time": model.energising_time_unit,
            column: model.quantity_unit,
        },
        least=1,
    )
    rails = _wanted(model.rail_pressure, "Pa", at / "rail_pressure")
    times = _wanted(model.energising_time, "s", at / "energising_time")
    chosen = _choose(table, {"rail_pressure": (rails, "Pa"), "energising_time": (times, "s")}, at)
    quantity, unit = table.columns[column], table.units[column]
    below = np.flatnonzero(quantity < 0.0)
    if len(below):
        raise InputError(f"{table.cell(column, int(below[0]))}: the value must be zero or greater.")
    return [_Row(_point(table, i, model, context, at), float(quantity[i]), unit, False) for i in chosen]


def _dead_time_rows(model: QuantitiesModel, context: Context, at: Place) -> list[_Row]:
    dead = model.dead_times
    if dead is None:
        return []
    table = context.columns(
        dead.file,
        at / "dead_times",
        {"rail_pressure": "Pa", "energising_time": "s"},
        stated={
            "rail_pressure": dead.rail_pressure_unit,
            "energising_time": dead.energising_time_unit,
        },
        least=1,
    )
    quantity, unit = _quantity(dead.quantity, at / "dead_times" / "quantity")
    rails = _wanted(model.rail_pressure, "Pa", at / "rail_pressure")
    chosen = _choose(table, {"rail_pressure": (rails, "Pa")}, at / "dead_times")
    return [_Row(_point(table, i, model, context, at), quantity, unit, True) for i in chosen]


def _quantity(text: str | float, at: Place) -> tuple[float, str]:
    """Quantity and its unit, m3 or kg."""
    try:
        value, unit = parse(text, "kg"), "kg"
    except InputError:
        value, unit = parse(text, "m3", str(at)), "m3"
    if not value > 0.0:
        raise at.error(f"the quantity must be greater than zero, not {to_text(value, unit)}")
    return value, unit


def _tolerances(model: QuantitiesModel, at: Place) -> tuple[float, float]:
    absolute = parse(model.absolute, "m3", str(at / "absolute"))
    relative = parse(model.relative, "1", str(at / "relative"))
    if not (absolute > 0.0 and relative >= 0.0):
        raise at.error("absolute must be greater than zero and relative zero or greater")
    return absolute, relative


def _wanted(items: Sequence[str | float] | None, unit: str, at: Place) -> list[float]:
    return [parse(item, unit, str(at[i])) for i, item in enumerate(items or ())]


def _choose(table: Columns, filters: Mapping[str, tuple[list[float], str]], at: Place) -> list[int]:
    """Rows that are at one of the wanted values of every column that has any."""
    keep = np.ones(len(table.lines), bool)
    for column, (wanted, unit) in filters.items():
        values = table.columns[column]
        near = np.array([np.isclose(values, value, rtol=SAME, atol=0.0) for value in wanted])
        for value, hits in zip(wanted, near, strict=True):
            if not hits.any():
                there = ", ".join(to_text(float(v), unit) for v in np.unique(values)[:12])
                raise ConfigurationError(
                    f"{at / column}: {table.path} has no row at {to_text(value, unit)}; it has {there}."
                )
        keep &= near.any(axis=0) if len(wanted) else True
    if not keep.any():
        raise ConfigurationError(
            f"{at}: no row of {table.path} is at a rail pressure and an energising time that were asked for."
        )
    if np.count_nonzero(keep) > MOST_POINTS:
        raise ConfigurationError(
            f"{at}: {np.count_nonzero(keep)} rows of {table.path} would be simulated, and at most {MOST_POINTS} are; "
            "choose some with rail_pressure and energising_time."
        )
    return [int(i) for i in np.flatnonzero(keep)]


def _point(table: Columns, row: int, model: QuantitiesModel, context: Context, at: Place) -> OperatingPoint:
    energising = float(table.columns["energising_time"][row])
    rail = float(table.columns["rail_pressure"][row])
    for column, value in (("energising_time", energising), ("rail_pressure", rail)):
        if not value > 0.0:
            raise InputError(f"{table.cell(column, row)}: the value must be greater than zero.")
    cylinder, low = (
        parse(item, "Pa", str(at / key))
        for key, item in (("cylinder_pressure", model.cylinder_pressure), ("return_pressure", model.return_pressure))
    )
    with context.located(f"{table.path}, line {table.lines[row]}"):
        point = OperatingPoint(rail, energising, cylinder, low, horizon=energising + AFTER_ENERGISING)
        check_point(context.injector, point)
        return point
