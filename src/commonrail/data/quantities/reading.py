"""Reading of quantity maps: chosen rows of a table, one operating point each, and dead times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, PlainValidator

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.hooks import note
from commonrail.base.units import parse, to_text
from commonrail.data.quantities.baselines import SisterModel
from commonrail.data.study_block import Context, DataModel, drive_unit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.status import check_point
from commonrail.physics.law import Domain
from commonrail.readers.columns import PLAIN, Column, FileForm, FormModel, Table
from commonrail.readers.location import Place, locate_errors
from commonrail.readers.quantity_matrix import COLUMNS, GivenUnits
from commonrail.readers.tables import has_columns, open_sheet, read_found_map, take_columns
from commonrail.readers.toml import FileModel, Unit, fault

# Quantity map found in a file, a matrix or a table with other names, as the columns that a map is read from.


def found_table(path: Path, form: FileForm, units: GivenUnits, quantity: str, *, matrix: bool) -> Table:
    """Columns rail_pressure, energising_time and quantity in SI units, a row for each point.

    `units` count before those of the file, and `quantity` names the column of the quantities; with
    `matrix` only a matrix is taken. Raises `InputError` if the file cannot be read, no map is found in it, or a
    number makes no sense.
    """
    located_map = replace(read_found_map(path, form, units), column=quantity)
    if matrix and not located_map.form.startswith("a matrix"):
        raise InputError(
            f'{path}: this is {located_map.form} and no matrix; state layout = "found".', code="no-matrix", file=path
        )
    note(f"{path}: read as {located_map.form}; {'; '.join(located_map.said)}.")
    return take_columns(located_map, [*COLUMNS[:2], Column(quantity, ("m3", "kg"), domain=Domain.NON_NEGATIVE)], 1)


def map_columns(
    path: Path, columns: Sequence[Column], form: FileForm = PLAIN, units: GivenUnits = GivenUnits(), least: int = 1
) -> Table:
    """Columns of operating points, perhaps with a quantity; of a file without them the points of its map.

    Raises `InputError` as `read_columns`.
    """
    fault: InputError | None = None
    try:
        sheet = open_sheet(path, form)
        has_all = len(has_columns(sheet, columns)) == len(columns)
    except InputError as error:
        has_all, fault = False, error
    if not has_all:
        quantity = columns[2].name if len(columns) > 2 else "quantity"
        with suppress(InputError):
            return found_table(path, form, units, quantity, matrix=False)
    if fault:
        raise fault
    return take_columns(sheet, columns, least)


Pressure = Annotated[float, Unit("Pa")]
Time = Annotated[float, Unit("s")]

AFTER_ENERGISING = 3e-3  # simulated after the end of energising; it ends early once the needle has closed [s]
MOST_POINTS = 10_000
SAME = 1e-6  # relative difference below which a row is at a pressure or time that was asked for


def _quantity(item: Any) -> tuple[float, str]:
    """Quantity and its unit, m3 or kg."""
    try:
        value, unit = parse(item, "kg"), "kg"
    except InputError:
        value, unit = Unit("m3").read(item), "m3"
    if not value > 0.0:
        raise fault(f"the quantity must be greater than zero, not {to_text(value, unit)}", code="out-of-range")
    return value, unit


class DeadTimesModel(FormModel):
    """Energising times at which a small quantity is reached."""

    file: str
    quantity: Annotated[tuple[float, str], PlainValidator(_quantity)]
    tolerance: Annotated[float, Unit("s")] | None = None
    rail_pressure_unit: str | None = None
    energising_time_unit: str | None = None


class HoldOutModel(FileModel):
    """Rail pressures and energising times whose rows are kept for validation."""

    rail_pressure: list[Pressure] = Field(default=[], max_length=1000)
    energising_time: list[Time] = Field(default=[], max_length=1000)


class MapModel(DataModel):
    """Keys of all maps of a quantity per stroke; rail_pressure and energising_time choose rows of a map."""

    selects_rows: ClassVar[bool] = True
    quantity_column: ClassVar[str]

    layout: Literal["rows", "matrix", "found"] = "rows"
    repeated: Literal["each", "mean"] = "each"
    rail_pressure_unit: str | None = None
    energising_time_unit: str | None = None
    quantity_unit: str | None = None
    rail_pressure: list[Pressure] | None = Field(default=None, min_length=1, max_length=1000)
    energising_time: list[Time] | None = Field(default=None, min_length=1, max_length=1000)
    hold_out: HoldOutModel | None = None
    cylinder_pressure: Pressure
    return_pressure: Pressure
    absolute: Annotated[float, Unit("m3")] = 0.15e-9
    relative: Annotated[float, Unit("1")] = 0.03


class QuantitiesModel(MapModel):
    """A map of injected quantities."""

    quantity_column: ClassVar[str] = "quantity"

    kind: Literal["quantities"]
    dead_times: DeadTimesModel | None = None
    sister: SisterModel | None = None


class MapRow(NamedTuple):
    """One operating point and its measured quantity in `unit` (m3 or kg)."""

    point: OperatingPoint
    quantity: float
    unit: str
    dead_time: bool


def read_rows(model: MapModel, context: Context) -> list[MapRow]:
    """Read the rows of a quantity map, those of its dead times last; see `DataSet.read_all`."""
    injector, at = context.injector, context.at
    if drive_unit(injector):
        raise ConfigurationError(
            f'{at}: the injector {injector.name} has drive_kind "{injector.variant.drive.value}", '
            "which quantities cannot give; set it to regulated or pwm.",
            code="drive-kind",
            file=at.file,
            place=at.key,
        )
    rows = _map_rows(model, context, at) + _dead_time_rows(model, context, at)
    if not (model.absolute > 0.0 and model.relative >= 0.0):
        raise at.error("absolute must be greater than zero and relative zero or greater", code="out-of-range")
    dead: DeadTimesModel | None = getattr(model, "dead_times", None)
    if dead is not None and dead.tolerance is not None and not dead.tolerance > 0.0:
        raise (at / "dead_times" / "tolerance").error("the tolerance must be greater than zero", code="out-of-range")
    return rows


def _map_rows(model: MapModel, context: Context, at: Place) -> list[MapRow]:
    name = model.quantity_column
    table = _map_table(model, context, at)
    filters = {"rail_pressure": (model.rail_pressure, "Pa"), "energising_time": (model.energising_time, "s")}
    quantity, unit = table.columns[name], table.units[name]
    rows = _choose(table, filters, at)
    return [MapRow(_point(table, i, model, context), float(quantity[i]), unit, False) for i in rows]


def _map_table(model: MapModel, context: Context, at: Place) -> Table:
    name = model.quantity_column
    stated = (model.rail_pressure_unit, model.energising_time_unit, model.quantity_unit)
    units = GivenUnits(*(unit or "" for unit in stated))
    if model.layout != "rows":
        return found_table(
            context.path(model.file, at, model.form), model.form, units, name, matrix=model.layout == "matrix"
        )
    columns = [*_point_columns(model), Column(name, ("m3", "kg"), model.quantity_unit, domain=Domain.NON_NEGATIVE)]
    return map_columns(context.path(model.file, at, model.form), columns, model.form, units)


def _dead_time_rows(model: MapModel, context: Context, at: Place) -> list[MapRow]:
    dead: DeadTimesModel | None = getattr(model, "dead_times", None)
    if dead is None:
        return []
    table = context.columns(dead.file, at / "dead_times", _point_columns(dead), 1, dead.form)
    rows = _choose(table, {"rail_pressure": (model.rail_pressure, "Pa")}, at / "dead_times")
    return [MapRow(_point(table, i, model, context), *dead.quantity, True) for i in rows]


def _point_columns(model: MapModel | DeadTimesModel) -> list[Column]:
    return [
        Column("rail_pressure", "Pa", model.rail_pressure_unit),
        Column("energising_time", "s", model.energising_time_unit),
    ]


def _choose(table: Table, filters: Mapping[str, tuple[Sequence[float] | None, str]], at: Place) -> list[int]:
    """Rows that are at one of the wanted values of every column that has any."""
    keep = np.ones(len(table.rows), bool)
    for column, (targets, unit) in filters.items():
        if targets is None:
            continue
        values = table.columns[column]
        near = np.array([np.isclose(values, value, rtol=SAME, atol=0.0) for value in targets])
        for value, hits in zip(targets, near, strict=True):
            if not hits.any():
                available = ", ".join(to_text(float(v), unit) for v in np.unique(values)[:12])
                raise ConfigurationError(
                    f"{at / column}: {table.path} has no row at {to_text(value, unit)}; it has {available}.",
                    code="missing-row",
                    file=at.file,
                    place=(at / column).key,
                )
        keep &= near.any(axis=0)
    if not keep.any():
        raise ConfigurationError(
            f"{at}: no row of {table.path} is at a rail pressure and an energising time that were asked for.",
            code="no-row",
            file=at.file,
            place=at.key,
        )
    if np.count_nonzero(keep) > MOST_POINTS:
        raise ConfigurationError(
            f"{at}: {np.count_nonzero(keep)} rows of {table.path} would be simulated, and at most {MOST_POINTS} are; "
            "choose some with rail_pressure and energising_time.",
            code="too-many",
            file=at.file,
            place=at.key,
        )
    return [int(i) for i in np.flatnonzero(keep)]


def _point(table: Table, row: int, model: MapModel, context: Context) -> OperatingPoint:
    energising = float(table.columns["energising_time"][row])
    rail = float(table.columns["rail_pressure"][row])
    for column, value in (("energising_time", energising), ("rail_pressure", rail)):
        if not value > 0.0:
            raise table.place(column, row).error("the value must be greater than zero", code="out-of-range")
    with locate_errors(Place(str(table.path), f"{table.row} {table.rows[row]}")):
        point = OperatingPoint(
            rail, energising, model.cylinder_pressure, model.return_pressure, horizon=energising + AFTER_ENERGISING
        )
        check_point(context.injector, point)
        return point
