"""Quantity maps of a study: chosen rows of a table, one operating point each, and dead times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.study import QuantityData, Role
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.validity import check_point
from commonrail.errors import ConfigurationError, InputError
from commonrail.files.place import Place, located
from commonrail.files.study_context import Context
from commonrail.files.study_models import QuantitiesModel
from commonrail.files.tables import Table, read_columns
from commonrail.units import parse, to_text

__all__ = ["read_quantities"]

Floats = NDArray[np.float64]

AFTER_ENERGISING = 3e-3  # simulated after the end of energising; it ends early once the needle has closed [s]
MOST_POINTS = 10_000
SAME = 1e-6  # relative difference below which a row is at a pressure or time that was asked for


class _Row(NamedTuple):
    """One operating point and its measured quantity in `unit` (m3 or kg)."""

    point: OperatingPoint
    quantity: float
    unit: str
    dead_time: bool


def read_quantities(model: QuantitiesModel, context: Context, at: Place) -> QuantityData:
    """Read a quantity map.

    Parameters
    ----------
    model : QuantitiesModel
    context : Context
    at : Place
        Of the data set in the study file.

    Raises
    ------
    InputError
        If a file or a value cannot be read, or a row makes no sense.
    ConfigurationError
        If no row is at a pressure or energising time that was asked for, or the injector needs a trace.
    """
    if context.drive_unit:
        raise ConfigurationError(
            f'{at}: the injector {context.injector.name} has drive_kind "{context.injector.variant.drive.value}", '
            "which quantities cannot give; set it to regulated or pwm."
        )
    rows = _map_rows(model, context, at) + _dead_time_rows(model, context, at)
    absolute, relative = _tolerances(model, at)
    density = np.array([context.mass_density(row.unit, row.point) for row in rows])
    by_volume = np.isnan(density)
    quantity = np.array([row.quantity for row in rows])
    return QuantityData(
        model.name,
        Role(model.role),
        tuple(row.point for row in rows),
        quantity / np.where(by_volume, 1.0, density),
        absolute,
        relative,
        np.array([row.dead_time for row in rows]),
        model.weight,
        model.source,
        model.synthetic,
        math.nan if by_volume.all() else density,
    )


def _map_rows(model: QuantitiesModel, context: Context, at: Place) -> list[_Row]:
    table = read_columns(
        context.path(model.file, at / "file"),
        {"rail_pressure": "Pa", "energising_time": "s", "quantity": ("m3", "kg")},
        stated={
            "rail_pressure": model.rail_pressure_unit,
            "energising_time": model.energising_time_unit,
            "quantity": model.quantity_unit,
        },
        least=1,
    )
    rails = _wanted(model.rail_pressure, "Pa", at / "rail_pressure")
    times = _wanted(model.energising_time, "s", at / "energising_time")
    chosen = _choose(table, {"rail_pressure": (rails, "Pa"), "energising_time": (times, "s")}, at)
    _refuse_negative(table, "quantity")
    quantity, unit = table.columns["quantity"], table.units["quantity"]
    return [_Row(_point(table, i, model, context, at), float(quantity[i]), unit, False) for i in chosen]


def _dead_time_rows(model: QuantitiesModel, context: Context, at: Place) -> list[_Row]:
    dead = model.dead_times
    if dead is None:
        return []
    table = read_columns(
        context.path(dead.file, at / "dead_times" / "file"),
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


def _choose(table: Table, filters: Mapping[str, tuple[list[float], str]], at: Place) -> list[int]:
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


def _refuse_negative(table: Table, column: str) -> None:
    below = np.flatnonzero(table.columns[column] < 0.0)
    if len(below):
        raise Place(table.cell(column, int(below[0]))).error("the value must be zero or greater")


def _point(table: Table, row: int, model: QuantitiesModel, context: Context, at: Place) -> OperatingPoint:
    energising = float(table.columns["energising_time"][row])
    rail = float(table.columns["rail_pressure"][row])
    for column, value in (("energising_time", energising), ("rail_pressure", rail)):
        if not value > 0.0:
            raise Place(table.cell(column, row)).error("the value must be greater than zero")
    cylinder, low = (
        parse(item, "Pa", str(at / key))
        for key, item in (("cylinder_pressure", model.cylinder_pressure), ("return_pressure", model.return_pressure))
    )
    with located(Place(f"{table.path}, line {table.lines[row]}")):
        point = OperatingPoint(rail, energising, cylinder, low, horizon=energising + AFTER_ENERGISING)
        check_point(context.injector, point)
        return point
