"""Repeated shots in one long record: found by a trigger, brought to one raster, averaged at each operating point."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.hooks import note
from commonrail.base.units import parse, to_text
from commonrail.data.curves.samples import RateModel, Samples, ShotsModel, raster, samples_of
from commonrail.data.curves.several import MOST_CURVES, RATES, FoundCurve, mean_curve
from commonrail.data.repeats import groups_of
from commonrail.data.study_block import Context
from commonrail.readers.columns import Column, Sheet, Table
from commonrail.readers.location import Place, located
from commonrail.readers.tables import take_columns

TRIGGERS = ("V", "A", "1", "Pa")  # units of a channel that may be a trigger
BEFORE = 1e-3  # time before a shot over which a pressure is averaged [s]


class _Source(NamedTuple):
    """The file with its channels: `sheet` is None where it must be opened for each of them."""

    path: Path
    sheet: Sheet | None
    model: RateModel
    context: Context

    @classmethod
    def of(cls, model: RateModel, context: Context) -> _Source:
        sheet = context.sheet(model.file, context.at, model.form)
        return cls(sheet.path, sheet if sheet.apart else None, model, context)

    def take(self, column: Column) -> Table:
        """A channel and its times."""
        model, context = self.model, self.context
        wanted = [Column(model.time, "s", model.time_unit, increasing=True), column]
        sheet = self.sheet or context.sheet(model.file, context.at, model.form)
        return take_columns(sheet, wanted)

    def channel(self, column: Column) -> _Channel:
        """A channel in SI units."""
        table = self.take(column)
        return _Channel(table.columns[self.model.time], table.columns[column.name], table.units[column.name])


class _Channel(NamedTuple):
    """A channel: times (n,) [s], values (n,) in its SI unit."""

    time: Floats
    value: Floats
    unit: str

    def before(self, moments: Floats) -> Floats:
        """Mean over the last `BEFORE` up to each moment; its last value where there is none in it."""
        last = np.clip(np.searchsorted(self.time, moments, "right"), 1, None)
        first = np.minimum(np.searchsorted(self.time, moments - BEFORE, "left"), last - 1)
        return np.array([self.value[i:k].mean() for i, k in zip(first, last, strict=True)])

    def at(self, moments: Floats) -> Floats:
        """Last value up to each moment."""
        return np.asarray(self.value[np.clip(np.searchsorted(self.time, moments, "right") - 1, 0, None)])


def cut_shots(model: RateModel, context: Context) -> list[FoundCurve]:
    """Curves of the operating points of a record, each the mean of its shots.

    The `window` of the model counts from the start of energising. Raises `InputError` if a channel is missing, or no
    shot is found or whole. Raises `ConfigurationError` if the window is missing.
    """
    at, shots = context.at, model.shots
    assert shots is not None
    if model.window is None:
        raise ConfigurationError(
            f'{at}: shots need a window, counted from the start of energising, as in window = ["-0.1 ms", "2 ms"].'
        )
    if model.time_zero:
        raise (at / "time_zero").error("shots count from their triggers; state shots.offset, and remove this key")
    source = _Source.of(model, context)
    begin, end = model.window
    trigger = source.channel(Column(shots.trigger, TRIGGERS, otherwise="1"))
    starts = _edges(trigger, shots, max(end - begin, 0.0), source.path, at / "shots") + shots.offset
    rate = source.take(Column(model.rate, RATES, model.rate_unit))
    record = samples_of(rate, model.rate, model, at)
    step = model.resample or float(np.median(np.diff(record.bounds)))
    bounds = raster(begin, end, step, at / ("resample" if model.resample else "window"))
    slack = 1e-3 * step
    whole = (starts + bounds[0] >= record.bounds[0] - slack) & (starts + bounds[-1] <= record.bounds[-1] + slack)
    if not whole.any():
        raise InputError(
            f"{at / 'window'}: no shot of {source.path} is whole: the window reaches from {to_text(begin, 's')} to "
            f"{to_text(end, 's')} about {len(starts)} triggers, and {record.range()}."
        )
    found = _points(source, record, starts[whole], bounds)
    counts = sorted({curve.shots for curve in found})
    many = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    lost = len(starts) - int(whole.sum())
    omitted = f"; {lost} that the record does not hold whole are omitted" if lost else ""
    note(f"{source.path}: {whole.sum()} shots at {len(found)} operating points, {many} each{omitted}.")
    return found


def _points(source: _Source, record: Samples, starts: Floats, bounds: Floats) -> list[FoundCurve]:
    """Mean curves of the operating points of shots that begin at `starts` [s], in the order of their first shots."""
    shots = source.model.shots
    assert shots is not None
    rail, time = _set_points(source, starts)
    places = np.column_stack([values if values is not None else np.ones(len(starts)) for values in (rail, time)])
    for values, what in ((rail, "rail pressure"), (time, "energising time")):
        if values is not None and not (values > 0.0).all():
            i = int(np.argmin(values > 0.0))
            raise InputError(
                f"{source.path}: the {what} of the shot at {to_text(float(starts[i]), 's')} is not greater than zero."
            )
    groups = groups_of(places, shots.same)
    if len(groups) > MOST_CURVES:
        raise (source.context.at / "shots").error(
            f"the shots are at {len(groups)} operating points, and at most {MOST_CURVES} are read"
        )
    found = []
    for rows in groups:
        cut = [record._replace(bounds=record.bounds - starts[i]).on(bounds) for i in rows]
        mean = [None if values is None else _rounded(float(values[rows].mean())) for values in (rail, time)]
        found.append(mean_curve(cut, *mean))
    return found


def _rounded(value: float) -> float:
    """Value of six digits: a mean of equal numbers is that number."""
    return float(f"{value:.6g}")


def _set_points(source: _Source, starts: Floats) -> tuple[Floats | None, Floats | None]:
    """Rail pressure [Pa] and energising time [s] of each shot, where the record has channels of them."""
    model, shots = source.model, source.model.shots
    assert shots is not None
    rail = time = None
    if shots.rail_pressure is not None:
        rail = source.channel(Column(shots.rail_pressure, "Pa", model.rail_pressure_unit)).before(starts)
    if shots.energising_time is not None:
        time = source.channel(Column(shots.energising_time, "s", model.energising_time_unit)).at(starts)
    return rail, time


def _edges(trigger: _Channel, shots: ShotsModel, dead: float, path: Path, at: Place) -> Floats:
    """Times [s] at which the trigger rises through its level; within `dead` after one no other counts."""
    low, high = float(trigger.value.min()), float(trigger.value.max())
    level = 0.5 * (low + high)
    if shots.level is not None:
        with located(at / "level"):
            level = parse(shots.level, trigger.unit)
    value = trigger.value
    rises = np.flatnonzero((value[:-1] < level) & (value[1:] >= level))
    if not len(rises):
        raise (at / "trigger").error(
            f'"{shots.trigger}" of {path} never rises through {level:.6g} {trigger.unit}; its values reach from '
            f"{low:.6g} to {high:.6g}"
        )
    share = (level - value[rises]) / (value[rises + 1] - value[rises])
    times = trigger.time[rises] + share * (trigger.time[rises + 1] - trigger.time[rises])
    kept: list[float] = []
    for moment in times.tolist():
        if not kept or moment - kept[-1] >= dead:
            kept.append(moment)
    return np.array(kept)
