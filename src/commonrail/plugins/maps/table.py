"""Table over two axes in the units of a control unit, the common form of all map files."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Bools, Floats, Ints
from commonrail.base.errors import InputError
from commonrail.base.units import compatible, convert, fits
from commonrail.engine.operating_point import RAIL_PRESSURES
from commonrail.physics.injector import Injector
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.compensation import Compensation
from commonrail.plugins.maps.response import Conditions, density_at
from commonrail.plugins.maps.run import Edges, InjectionMap
from commonrail.plugins.maps.sweep import Sweep
from commonrail.readers.columns import BAND
from commonrail.readers.quantity_matrix import LONGEST_SIMULATED

LONGEST_LABEL = 128
_LABEL = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\[\d+\])?(\.[A-Za-z_][A-Za-z0-9_]*(\[\d+\])?)*")

DIGITS = 10  # significant digits of an axis; writes 0.1 as such, not as its double
DECIMALS = 3  # of energising times and quantities


class MapUnits(NamedTuple):
    """Units of a file: of rail pressure, quantity (a volume or a mass) and energising time; decimals of values."""

    pressure: str = "hPa"
    quantity: str = "mm^3/inj"
    time: str = "us"
    decimals: int = DECIMALS


ECU_UNITS = MapUnits()
READABLE = ("MPa", "mm3", "us")  # units of files for people


class Axis(NamedTuple):
    """Axis of a table: name, unit, and values (n,) in it, strictly increasing."""

    name: str
    unit: str
    values: Floats


class Layer(NamedTuple):
    """Further numbers of each cell: name, unit, and values (y, x) in it."""

    name: str
    unit: str
    values: Floats


@dataclass(frozen=True)
class MapTable:
    """Map as files hold it.

    `label` is its name in the control unit, `title` a description; `name` and `unit` belong to its values (y, x), which
    are rounded as written and NaN if a number is missing. `states` (y, x) are words, `notes` describe model,
    conditions and rules, `layers` are edges of bands from a fit; DCM and CDFX hold none. `decimals` apply to the
    values.
    """

    label: str
    title: str
    name: str
    unit: str
    x: Axis
    y: Axis
    values: Floats
    states: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    layers: tuple[Layer, ...] = ()
    decimals: int = DECIMALS

    def require_numbers(self, what: str) -> None:
        """Raise `InputError` that names the first cell without a number, for formats that cannot hold one."""
        missing = np.argwhere(~np.isfinite(self.values))
        if len(missing):
            y, x = missing[0]
            raise InputError(
                f"{what} needs a number in every cell, but {len(missing)} of {self.values.size} cells have none, the "
                f"first at {self.x.values[x]:g} {self.x.unit}, {self.y.values[y]:g} {self.y.unit} "
                f"({self.states[y][x]}); choose other axes, or let the rule for unreachable quantities extrapolate or "
                "hold."
            )


def choose_units(path: Path, stated: Sequence[str | None], like: MapTable | None = None) -> MapUnits:
    """Units of a file: those of the map `like` if given, else the `stated` ones, else the default of its format.

    `InputError` if one is unknown or of another kind.
    """
    if like is not None:
        return read_units(like)
    usual = ECU_UNITS[:3] if path.suffix.lower() in (".dcm", ".cdfx") else READABLE
    pressure, quantity, time = (unit or default for unit, default in zip(stated, usual, strict=True))
    units = MapUnits(pressure, quantity, time)
    convert(0.0, "Pa", units.pressure)
    convert(0.0, "kg" if compatible(units.quantity, "kg") else "m3", units.quantity)
    convert(0.0, "s", units.time)
    return units


def check_label(label: str) -> str:
    """Return a valid name for a control unit.

    `InputError` if it holds anything but letters without accents, digits, underscores, points and indices in brackets.
    """
    if len(label) <= LONGEST_LABEL and _LABEL.fullmatch(label):
        return label
    raise InputError(
        f'"{label[:LONGEST_LABEL]}" cannot be a label; write at most {LONGEST_LABEL} letters, digits and '
        "underscores, the first one not a digit, as in InjVlv_tiET_MAP."
    )


def inverse_table(m: InjectionMap, label: str, units: MapUnits = ECU_UNITS) -> MapTable:
    """Table of energising times over rail pressure (x) and quantity (y).

    `InputError` if a unit is unknown or of another kind, or the label is not valid.
    """
    inverse = m.inverse
    decimals = _decimals(units.decimals, m.adjustment.time_resolution, "s", units.time)
    return MapTable(
        check_label(label),
        f"Energising time of {m.injector.name} over rail pressure and quantity",
        "energising_time",
        units.time,
        _axis("rail_pressure", m.axes.rail_pressure, "Pa", units.pressure),
        Axis("quantity", units.quantity, _round_digits(_quantities(m, m.axes.quantity, units))),
        np.round(convert(inverse.energising_time.T, "s", units.time), decimals),
        _states(inverse.state.T, m.inverse_ballistic.T),
        describe_conditions(m),
        () if m.bands is None else _layers(m, m.bands.delivered, units),
        decimals,
    )


def _decimals(fewest: int, resolution: float | None, unit: str, written: str) -> int:
    """Decimals, at least the fewest, that write multiples of a resolution in another unit exactly."""
    if resolution is None:
        return fewest
    step = Decimal(f"{convert(resolution, unit, written):.{DIGITS}g}").normalize()
    return max(fewest, -int(step.as_tuple().exponent))


def is_turned(table: MapTable) -> bool | None:
    """True if the y axis holds the pressures; None if the axes are not pressure and quantity."""
    for turned, pressure, quantity in ((False, table.x, table.y), (True, table.y, table.x)):
        if fits(pressure.unit, "Pa") and (fits(quantity.unit, "kg") or fits(quantity.unit, "m3")):
            return turned
    return None


def convert_axes(table: MapTable, density: float) -> tuple[Floats, Floats]:
    """Rail pressures [Pa] and quantities [m³] of a map; masses are divided by the reference density [kg/m³]."""
    pressure, quantity = (table.y, table.x) if is_turned(table) else (table.x, table.y)
    by_mass = fits(quantity.unit, "kg")
    values = convert(quantity.values, quantity.unit, "kg" if by_mass else "m3")
    return convert(pressure.values, pressure.unit, "Pa"), values / density if by_mass else values


def read_units(like: MapTable) -> MapUnits:
    """Units and decimals of a map over rail pressure and quantity; microseconds if its values are not times.

    Decimals are at least enough for whole microseconds, since a map of round numbers does not show what it needs.
    """
    x, y = (like.y, like.x) if is_turned(like) else (like.x, like.y)
    if not fits(like.unit, "s"):
        return MapUnits(x.unit, y.unit)
    fewest = math.ceil(-math.log10(convert(1e-6, "s", like.unit)) - 1e-9)
    return MapUnits(x.unit, y.unit, like.unit, max(like.decimals, fewest))


def find_simulated_columns(like: MapTable, conditions: Conditions) -> Bools:
    """Mask (n,) of the pressures of a map that can be simulated: above the cylinder pressure."""
    pressure, _ = convert_axes(like, 1.0)
    return np.asarray(pressure > max(conditions.cylinder_pressure, RAIL_PRESSURES.low))


def complete_columns(table: MapTable, like: MapTable, conditions: Conditions) -> MapTable:
    """Complete a table over the simulated pressures of another map with that map's values at its other pressures."""
    which = find_simulated_columns(like, conditions)
    axis, before = (like.y, like.values.T) if is_turned(like) else (like.x, like.values)
    values, states = before.copy(), np.full(before.shape, "as before", object)
    values[:, which], states[:, which] = table.values, np.array(table.states, object)
    layers = tuple(layer._replace(values=np.full(before.shape, np.nan)) for layer in table.layers)
    for layer, edges in zip(layers, table.layers, strict=True):
        layer.values[:, which] = edges.values
    x = table.x._replace(values=axis.values)
    return replace(table, x=x, values=values, states=tuple(map(tuple, states.tolist())), layers=layers)


def arrange_like(table: MapTable, like: MapTable) -> MapTable:
    """Table with title, axes and order of another map."""
    if is_turned(like):
        table = replace(
            table,
            values=table.values.T,
            states=tuple(zip(*table.states, strict=True)),
            layers=tuple(layer._replace(values=layer.values.T) for layer in table.layers),
            x=table.y,
            y=table.x,
        )
    x, y = like.x._replace(name=table.x.name), like.y._replace(name=table.y.name)
    return replace(table, title=like.title or table.title, x=x, y=y)


def tables_at_quantities(compensated: Compensation, label: str, change: bool) -> list[MapTable]:
    """Tables of energising times that hold quantities.

    Of a second injection over rail pressure (x) and quantity (y), a table for each dwell, whose µs join the label:
    ``label_600us``. Of a single injection, and for a `change` against an injection alone, over
    the condition (x) and rail pressure (y), a table for each quantity, which joins the label if there are several.
    `InputError` as `inverse_table`.
    """
    if change or not compensated.first_energising_time > 0.0:
        return _condition_tables(compensated, label, change)
    tables = []
    for dwell, inverse in zip(compensated.condition.values.tolist(), compensated.inverses, strict=True):
        ballistic = np.zeros(inverse.state.shape, bool)
        table = inverse_table(replace(compensated.alone, inverse=inverse, inverse_ballistic=ballistic), label)
        first = f"{compensated.first_energising_time * 1e6:g} us"
        pause = f"dwell {dwell * 1e6:g} us from the end of the first energising ({first})"
        title = f"Energising time of the second injection of {compensated.alone.injector.name}, {pause}"
        name = check_label(f"{label}_{dwell * 1e6:g}us".replace(".", "_"))
        tables.append(replace(table, label=name, title=title, notes=(*table.notes, f"second injection: {pause}")))
    return tables


def _condition_tables(compensated: Compensation, label: str, change: bool) -> list[MapTable]:
    """Tables over the condition (x) and rail pressure (y)."""
    alone = compensated.alone
    times = compensated.energising_time - alone.inverse.energising_time if change else compensated.energising_time
    times = convert(times, "s", ECU_UNITS.time)
    what = "Correction of the energising time" if change else "Energising time"
    states = np.array([inverse.state for inverse in compensated.inverses])
    volumes = _round_digits(_quantities(alone, alone.axes.quantity, ECU_UNITS)).tolist()
    note, injection = f"varied: {compensated.condition.name}", f"{alone.injector.name} for"
    if compensated.first_energising_time > 0.0:
        first = f"first injection: {compensated.first_energising_time * 1e6:g} us"
        note = f"{first}; dwell: from its end to the second's start"
        injection = "a second injection of"
    return [
        MapTable(
            check_label(f"{label}_{volume:g}".replace(".", "_") if len(volumes) > 1 else label),
            f"{what} of {injection} {volume:g} {ECU_UNITS.quantity}",
            "correction" if change else "energising_time",
            ECU_UNITS.time,
            Axis(compensated.condition.name, compensated.unit, np.array(compensated.values)),
            _axis("rail_pressure", alone.axes.rail_pressure, "Pa", ECU_UNITS.pressure),
            np.round(times[:, :, j].T, DECIMALS),
            _states(states[:, :, j].T, np.array(False)),
            (*describe_conditions(alone), note),
        )
        for j, volume in enumerate(volumes)
    ]


def change_table(swept: Sweep, alone: Floats, label: str) -> MapTable:
    """Change of the quantity of a second injection against the injection alone, over dwell (x) and rail pressure (y).

    `swept` varies dwell and rail pressure, `alone` (pressures,) [m³]. `InputError` if the label is not valid.
    """
    axes = {v.name: v.values for v in swept.variables}
    turned = swept.variables[0].name == "rail_pressure"
    second, fused = (values if turned else values.T for values in (swept.second, swept.fused))
    change = convert(second - alone[:, None], "m3", ECU_UNITS.quantity)
    states = np.where(fused, "fused", np.where(np.isfinite(change), "reached", "failed"))
    base = swept.base
    pause = (
        f"first injection: {base.first_energising_time * 1e6:g} us, second: {base.energising_time * 1e6:g} us; dwell: "
        "from the end of the first to the start of the second"
    )
    return MapTable(
        check_label(label),
        f"Change of the quantity of a second injection of {swept.injector.name}",
        "change",
        ECU_UNITS.quantity,
        _axis("dwell", axes["dwell"], "s", ECU_UNITS.time),
        _axis("rail_pressure", axes["rail_pressure"], "Pa", ECU_UNITS.pressure),
        np.round(change, DECIMALS),
        tuple(map(tuple, states.tolist())),
        (*_conditions(swept.injector, base.conditions), pause),
    )


def quantity_table(m: InjectionMap, label: str, units: MapUnits = ECU_UNITS) -> MapTable:
    """Table of quantities over rail pressure (x) and energising time (y). `InputError` as `inverse_table`."""
    states = np.where(np.isfinite(m.volume), np.where(m.ballistic, "ballistic", "reached"), "failed").T
    finest, by_mass = m.adjustment.quantity_resolution, compatible(units.quantity, "kg")
    finest = finest * m.density if finest is not None and by_mass else finest
    decimals = _decimals(DECIMALS, finest, "kg" if by_mass else "m3", units.quantity)
    return MapTable(
        check_label(label),
        f"Injected quantity of {m.injector.name} over rail pressure and energising time",
        "quantity",
        units.quantity,
        _axis("rail_pressure", m.axes.rail_pressure, "Pa", units.pressure),
        _axis("energising_time", m.axes.energising_time, "s", units.time),
        np.round(_quantities(m, m.volume.T, units), decimals),
        tuple(map(tuple, states.tolist())),
        describe_conditions(m),
        () if m.bands is None else _layers(m, m.bands.quantity, units),
        decimals,
    )


def _layers(m: InjectionMap, edges: Edges, units: MapUnits) -> tuple[Layer, ...]:
    """Edges of bands (pressures, y) in the unit of the file."""
    layers = []
    for level, pair in edges.items():
        for side, volume in zip(("lower", "upper"), pair, strict=True):
            values = np.round(_quantities(m, volume.T, units), DECIMALS)
            layers.append(Layer(f"quantity{BAND}{100.0 * level:g}_{side}", units.quantity, values))
    return tuple(layers)


def describe_conditions(m: InjectionMap) -> tuple[str, ...]:
    """Model, conditions, rules and adjustments of a map, one per line."""
    rules = (
        f"several energising times: {_SEVERAL[m.rules.several.value]}; "
        f"unreachable quantities: {_BEYOND[m.rules.beyond.value]}; "
        + LONGEST_SIMULATED.format(m.axes.energising_time[-1] * 1e6)
    )
    bands = [f"bands of measured quantities: {m.bands.estimator}"] if m.bands else []
    costs = (cost.sentence for cost in m.costs)
    return (*_conditions(m.injector, m.conditions), rules, *costs, *bands)


def _conditions(injector: Injector, conditions: Conditions) -> tuple[str, ...]:
    """Model, pressures and fuel, one per line."""
    lines = (
        f"simulated by commonrail, not measured: {injector.name} ({injector.variant.label})",
        f"synthetic: {injector.synthetic}" if injector.synthetic else "",
        f"cylinder pressure {conditions.cylinder_pressure * 1e-6:g} MPa, return pressure "
        f"{conditions.return_pressure * 1e-6:g} MPa, fuel {injector.fuel.name} at "
        f"{injector.values['fuel.temperature'] - 273.15:g} degC, reference density "
        f"{density_at(injector, conditions):.1f} kg/m3",
    )
    return tuple(line for line in lines if line)


_SEVERAL = {"neighbours": "that of the neighbours", "shortest": "the shortest", "longest": "the longest"}
_BEYOND = {
    "extrapolate": "extrapolated as a line through the two longest simulated times",
    "hold": "the longest simulated time",
    "empty": "no number",
}


def _axis(name: str, values: Floats, si_unit: str, unit: str) -> Axis:
    return Axis(name, unit, _round_digits(convert(values, si_unit, unit)))


def _quantities(m: InjectionMap, volume: Floats, units: MapUnits) -> Floats:
    """Volumes [m³] in the unit of the file, which can be a mass."""
    by_mass = compatible(units.quantity, "kg")
    return convert(volume * m.density if by_mass else volume, "kg" if by_mass else "m3", units.quantity)


def _round_digits(values: Floats) -> Floats:
    return np.array([float(f"{value:.{DIGITS}g}") for value in values.tolist()])


_WORDS = {CellState.BEYOND: "unreachable", CellState.ZERO: "no quantity"}


def _states(states: Ints, ballistic: Bools) -> tuple[tuple[str, ...], ...]:
    """Words for the states of cells (y, x), including `ballistic`."""
    words = {int(state): _WORDS.get(state, state.name.lower()) for state in CellState}
    texts = np.where(ballistic & (states == CellState.REACHED), "ballistic", np.vectorize(words.get)(states))
    return tuple(map(tuple, texts.tolist()))
