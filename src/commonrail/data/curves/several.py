"""Several injection curves of one file: columns named by their operating points, or with these in rows above them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from commonrail.base.errors import InputError
from commonrail.base.hooks import note
from commonrail.base.units import to_text
from commonrail.data.curves.samples import RateModel, Samples, samples_of, within_window
from commonrail.data.repeats import averaged, groups_of
from commonrail.data.study_block import Context, TraceModel
from commonrail.readers.columns import MOST_SHOWN, Column
from commonrail.readers.grid import read_grid
from commonrail.readers.location import Place
from commonrail.readers.operating_points import ColumnPattern, NamedPoint, find_traces
from commonrail.readers.tables import take_columns

MOST_CURVES = 1000
SAME = 1e-6  # relative difference below which two traces are at one operating point

RATES = ("m3/s", "kg/s")


class FoundCurve(NamedTuple):
    """A curve among several of a file."""

    samples: Samples  # those that count
    rail_pressure: float | None  # [Pa]
    energising_time: float | None  # [s]; None where the block of the study states it
    shots: int = 1  # repeated shots of which it is the mean
    sigma: float | None = None  # standard error of the mean, in the unit of the samples
    freedom: float = 0.0  # its degrees of freedom


def label_of(curve: FoundCurve) -> str:
    """Words that tell a curve from the others of its file."""
    parts = (curve.rail_pressure, "Pa"), (curve.energising_time, "s")
    return " ".join(to_text(value, unit) for value, unit in parts if value is not None)


def named_columns(model: RateModel, context: Context) -> list[FoundCurve]:
    """Curves of the columns whose names fit the key `columns` of a block.

    Raises `InputError` if no name fits, or a column cannot be read. Raises `ConfigurationError` if the window does not
    fit.
    """
    at = context.at
    pattern = ColumnPattern(model.columns or "", stated_units(model), at / "columns")
    sheet = context.sheet(model.file, at, model.form)
    points = [point for name in sheet.names if (point := pattern.read(name)) is not None]
    if not points:
        shown = ", ".join(f'"{name}"' for name in sheet.names[:MOST_SHOWN])
        raise (at / "columns").error(
            f'no column of {sheet.path} fits "{pattern.text}"; it has {shown}{", …" * (len(sheet.names) > MOST_SHOWN)}'
        )
    if len(points) > MOST_CURVES:
        raise (at / "columns").error(f"{len(points)} columns fit, and at most {MOST_CURVES} are read")
    time = Column(model.time, "s", model.time_unit, increasing=True)
    wanted = [Column(point.column, RATES, model.rate_unit, required=False) for point in points]
    if sheet.apart:
        tables = [take_columns(sheet, [time, column]) for column in wanted]
    else:
        tables = [take_columns(sheet, [time, *wanted])] * len(wanted)
    samples = [
        within_window(samples_of(table, point.column, model, at), model, at)
        for table, point in zip(tables, points, strict=True)
    ]
    return _gathered(points, samples, at / "columns")


def courses_at(curve: FoundCurve, model: RateModel, context: Context) -> dict[str, TraceModel]:
    """Courses of a block by their keys whose `column` is a pattern, each with the column at a curve's operating point.

    Raises `InputError` if not exactly one column fits.
    """
    found = {}
    for key in ("rail_pressure", "cylinder_pressure", "return_pressure", "drive"):
        item = getattr(model, key)
        if isinstance(item, TraceModel) and model.columns is not None and "{" in item.column:
            at = context.at / key
            pattern = ColumnPattern(item.column, stated_units(model), at / "column")
            sheet = context.sheet(item.file or model.file, at, model.form if item.file is None else item.form)
            columns = [p.column for name in sheet.names if (p := pattern.read(name)) and _is_at(p, curve)]
            if len(columns) != 1:
                raise (at / "column").error(
                    f'{len(columns)} columns of {sheet.path} fit "{item.column}" at {label_of(curve)}, and one must'
                )
            found[key] = item.model_copy(update={"column": columns[0]})
    return found


def _is_at(point: NamedPoint, curve: FoundCurve) -> bool:
    pairs = (point.rail_pressure, curve.rail_pressure), (point.energising_time, curve.energising_time)
    return all(a is None or b is None or abs(a - b) <= SAME * b for a, b in pairs)


def stated_units(model: RateModel) -> dict[str, str]:
    """Units of the numbers in names that a block states, by their SI units."""
    return {"Pa": model.rail_pressure_unit or "", "s": model.energising_time_unit or ""}


def _gathered(points: Sequence[NamedPoint], samples: Sequence[Samples], at: Place) -> list[FoundCurve]:
    """One curve for each operating point: the mean of its shots."""
    places = np.array([(p.rail_pressure or 1.0, p.energising_time or 1.0) for p in points])
    found = []
    for rows in groups_of(places, SAME):
        first = points[rows[0]]
        if len(rows) > 1 and not first.shot:
            raise at.error(
                f'the columns "{first.column}" and "{points[rows[1]].column}" are at one operating point; mark what '
                "numbers repeated shots with {shot}"
            )
        found.append(mean_curve([samples[i] for i in rows], first.rail_pressure, first.energising_time))
    return found


def mean_curve(shots: Sequence[Samples], rail_pressure: float | None, energising_time: float | None) -> FoundCurve:
    """Mean of repeated shots, on the raster of the first and as long as the shortest.

    `rail_pressure` and `energising_time` in [Pa], [s].
    """
    if len(shots) == 1:
        return FoundCurve(shots[0], rail_pressure, energising_time)
    begin, end = max(s.bounds[0] for s in shots), min(s.bounds[-1] for s in shots)
    own = shots[0].bounds
    bounds = own[(own >= begin - 1e-12) & (own <= end + 1e-12)]
    rates = np.array([s.on(bounds).rate for s in shots])
    mean = averaged(rates, [np.arange(len(shots))])
    samples = shots[0]._replace(bounds=bounds, rate=mean.mean[0])
    return FoundCurve(samples, rail_pressure, energising_time, len(shots), mean.sigma, mean.freedom)


def traces_below_points(model: RateModel, context: Context) -> list[FoundCurve]:
    """Curves of a table that has their operating points in rows above them.

    Raises `InputError` if it is no such table. Raises `ConfigurationError` if the window does not fit.
    """
    at = context.at
    path = context.path(model.file, at)
    grid = read_grid(path, model.form.encoding or None, model.form.sheet or None)
    stated = {
        "rail pressure": model.rail_pressure_unit or "",
        "energising time": model.energising_time_unit or "",
        "time": model.time_unit or "",
        "rate": model.rate_unit or "",
    }
    wide = find_traces(grid, model.time, stated)
    if len(wide.names) > MOST_CURVES:
        raise InputError(f"{path}: the table has {len(wide.names)} traces, and at most {MOST_CURVES} are read.")
    note(f"{path}: read as {len(wide.names)} traces below their operating points; {'; '.join(grid.said)}.")
    rail, time = wide.points.get("rail pressure"), wide.points.get("energising time")
    points = [
        NamedPoint(name, None if rail is None else float(rail[i]), None if time is None else float(time[i]), str(i + 1))
        for i, name in enumerate(wide.names)
    ]
    samples = [within_window(samples_of(wide.table, name, model, at), model, at) for name in wide.names]
    return _gathered(points, samples, at / "layout")
