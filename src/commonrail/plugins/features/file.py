"""Rates of injection in a file, one column for each shot, as traces whose features are found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.errors import InputError
from commonrail.base.units import fits, to_text
from commonrail.data.features.rate_trace import RATE_UNITS, RateTrace, bounds_around
from commonrail.engine.operating_point import Energising
from commonrail.readers.columns import PLAIN, Column, FileForm, Sheet, Table, unit_of
from commonrail.readers.operating_points import named_points
from commonrail.readers.tables import open_sheet, take_columns

MOST_SHOTS = 500


class RateColumns(NamedTuple):
    """Columns of a file that hold rates, and what their samples are.

    Without names every column whose header has a unit of a rate; units are those where the file gives none. `centred`:
    a sample is the mean around its time, else over the interval that ends at it. Samples between two times of the
    window [s] count.
    """

    time: str = "time"
    rates: tuple[str, ...] = ()
    time_unit: str | None = None
    rate_unit: str | None = None
    centred: bool = False
    window: tuple[float, float] | None = None
    form: FileForm = PLAIN


def read_rates(path: Path, columns: RateColumns, energisings: Sequence[Energising] = ()) -> dict[str, RateTrace]:
    """Rates of a file by the names of their columns.

    The energisings are those of every shot; where there is none, an energising time in the names of all columns is
    taken, from time 0. InputError if the file has no rate, or no samples in the window, or a name states another
    energising time.
    """
    sheet = open_sheet(path, columns.form)
    names = columns.rates or _found(sheet)
    if len(names) > MOST_SHOTS:
        raise InputError(f"{path}: there are {len(names)} rates, and at most {MOST_SHOTS} are read; name those wanted.")
    time = Column(columns.time, "s", columns.time_unit, increasing=True)
    rates = [Column(name, tuple(RATE_UNITS), columns.rate_unit) for name in names]
    if sheet.apart:
        tables = [take_columns(sheet, [time, rate]) for rate in rates]
    else:
        tables = [take_columns(sheet, [time, *rates])] * len(rates)
    if len({table.units[name] for name, table in zip(names, tables, strict=True)}) > 1:
        raise InputError(f"{path}: some rates are by mass and some by volume; name those of one kind.")
    own = _energised(path, names, tuple(energisings))
    return {name: _trace(table, name, columns, own[name]) for name, table in zip(names, tables, strict=True)}


def _trace(table: Table, name: str, columns: RateColumns, energisings: tuple[Energising, ...]) -> RateTrace:
    """A rate within the window."""
    moments = table.columns[columns.time]
    before = np.concatenate(([2.0 * moments[0] - moments[1]], moments))
    bounds = bounds_around(moments) if columns.centred else before
    keep = _within(bounds, columns.window, table.path)
    edges = bounds[keep[0] : keep[-1] + 2]
    return RateTrace(edges, table.columns[name][keep], table.units[name], energisings)


def are_repeated(names: Sequence[str]) -> bool:
    """Return whether rates may be repeated shots: their names state no different operating points."""
    return len({(point.rail_pressure, point.energising_time) for point in named_points(names)}) < 2


def _energised(path: Path, names: Sequence[str], given: tuple[Energising, ...]) -> dict[str, tuple[Energising, ...]]:
    found = dict.fromkeys(names, given)
    for point in named_points(names):
        duration = point.energising_time
        if duration is None:
            continue
        if not given:
            found[point.column] = (Energising(0.0, duration),)
        elif len(given) > 1 or not math.isclose(given[0].duration, duration, rel_tol=1e-6):
            raise InputError(
                f'{path}: the name of "{point.column}" states an energising time of {to_text(duration, "s")}, but '
                f"{' and '.join(to_text(pulse.duration, 's') for pulse in given)} is given for all; state none, and "
                "each rate has its own, or name only the rates that were measured with it."
            )
    return found


def _found(sheet: Sheet) -> tuple[str, ...]:
    """Columns that have a unit of a rate."""
    found = tuple(name for name in sheet.names if any(fits(unit_of(sheet, name), one) for one in RATE_UNITS))
    if not found:
        raise InputError(
            f'{sheet.path}: no column has the unit of a rate in its header, as in "rate [mm3/ms]"; name the columns '
            "and state their unit."
        )
    return found


def _within(bounds: Floats, window: tuple[float, float] | None, path: Path) -> IndexArray:
    begin, end = (-np.inf, np.inf) if window is None else window
    keep = np.flatnonzero((bounds[:-1] >= begin) & (bounds[1:] <= end))
    if len(keep) < 4:
        raise InputError(
            f"{path}: only {len(keep)} samples lie in the window, and at least 4 are needed; the samples reach from "
            f"{1e6 * bounds[0]:.6g} us to {1e6 * bounds[-1]:.6g} us."
        )
    return keep
