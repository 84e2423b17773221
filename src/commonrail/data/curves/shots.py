"""A record of many injections, cut into shots by the channel of a trigger; mean curves of repeated shots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.hooks import note
from commonrail.base.units import parse, to_text
from commonrail.data.curves.samples import RateModel, Samples, ShotsModel, raster, read_samples
from commonrail.data.noise import NOISE, Noise
from commonrail.data.repeats import average_groups, group_rows
from commonrail.data.study_block import Context
from commonrail.readers.columns import Column, Table
from commonrail.readers.location import Place, locate_errors

MOST_CURVES = 1000  # in one file

RATES = ("m3/s", "kg/s")
TRIGGERS = ("V", "A", "1", "Pa")  # units of a channel that may be a trigger
BEFORE = 1e-3  # time before a shot over which a pressure is averaged [s]


class FoundCurve(NamedTuple):
    """A curve among several of a file."""

    samples: Samples  # compared ones
    rail_pressure: float | None  # [Pa]
    energising_time: float | None  # [s]; None where the block of the study states it
    shots: int = 1  # repeated shots of which it is the mean
    sigma: float | None = None  # standard error of the mean, in the unit of the samples
    freedom: float = 0.0  # its degrees of freedom
    scatter: float = 0.0  # relative standard error of the mean's quantity from shot-to-shot scatter

    @property
    def label(self) -> str:
        """Label that identifies the curve in its file."""
        parts = (self.rail_pressure, "Pa"), (self.energising_time, "s")
        return " ".join(to_text(value, unit) for value, unit in parts if value is not None)

    def noise(self, scale: float) -> Noise:
        """Noise of the mean, in the unit of the samples divided by `scale`."""
        if self.sigma is None:
            return NOISE
        spare = float(self.shots - 1)
        return Noise(sigma=self.sigma / scale, freedom=self.freedom, scatter=self.scatter, scatter_freedom=spare)


class _Channel(NamedTuple):
    """A channel: times (n,) [s], values (n,) in its SI unit."""

    time: Floats
    value: Floats
    unit: str

    def before(self, moments: Floats) -> Floats:
        """Mean over the last `BEFORE` up to each moment; its last value if that interval has no sample."""
        last = np.clip(np.searchsorted(self.time, moments, "right"), 1, None)
        first = np.minimum(np.searchsorted(self.time, moments - BEFORE, "left"), last - 1)
        return np.array([self.value[i:k].mean() for i, k in zip(first, last, strict=True)])

    def at(self, moments: Floats) -> Floats:
        """Last value up to each moment."""
        return np.asarray(self.value[np.clip(np.searchsorted(self.time, moments, "right") - 1, 0, None)])


def cut_shots(model: RateModel, context: Context) -> list[FoundCurve]:
    """Curves of the operating points of a record, each the mean of its shots.

    The `window` of the model counts from the start of energising. Raises `InputError` if a channel is missing, or there
    is no complete shot. Raises `ConfigurationError` if the window is missing.
    """
    at, shots = context.at, model.shots
    assert shots is not None
    if model.window is None:
        raise ConfigurationError(
            f'{at}: shots need a window, counted from the start of energising, as in window = ["-0.1 ms", "2 ms"].',
            code="missing-window",
            file=at.file,
            place=at.key,
        )
    if model.time_zero:
        raise (at / "time_zero").error(
            "the time of each shot starts at its trigger; state shots.offset, and remove this key", code="idle-key"
        )
    path = context.sheet(model.file, at, model.form).path
    begin, end = model.window
    trigger = _channel(Column(shots.trigger, TRIGGERS, otherwise="1"), model, context)
    edges = _edges(trigger, shots, max(end - begin, 0.0), path, at / "shots")
    period = float(np.median(np.diff(edges))) if len(edges) > 1 else np.inf
    if abs(shots.offset) >= period:
        raise (at / "shots" / "offset").error(
            f"an offset of {to_text(shots.offset, 's')} reaches the next trigger, {to_text(period, 's')} away; "
            "state the time from the trigger of the same shot",
            code="other-shot",
        )
    starts = edges + shots.offset
    rate = _take_channel(Column(model.rate, RATES, model.rate_unit), model, context)
    record = read_samples(rate, model.rate, model, at)
    step = model.resample or float(np.median(np.diff(record.bounds)))
    bounds = raster(begin, end, step, at / ("resample" if model.resample else "window"))
    slack = 1e-3 * step
    complete = (starts + bounds[0] >= record.bounds[0] - slack) & (starts + bounds[-1] <= record.bounds[-1] + slack)
    if not complete.any():
        raise InputError(
            f"{at / 'window'}: no shot of {path} is whole: the window reaches from {to_text(begin, 's')} to "
            f"{to_text(end, 's')} about {len(starts)} triggers, and {record.range()}.",
            code="no-whole-shot",
            file=at.file,
            place=(at / "window").key,
        )
    curves = _points(path, model, context, record, starts[complete], bounds)
    counts = sorted({curve.shots for curve in curves})
    many = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    lost = len(starts) - int(complete.sum())
    omitted = f"; {lost} that the record does not hold whole are omitted" if lost else ""
    note(f"{path}: {complete.sum()} shots at {len(curves)} operating points, {many} each{omitted}.")
    return curves


def _take_channel(column: Column, model: RateModel, context: Context) -> Table:
    """A channel of the record and its times."""
    time = Column(model.time, "s", model.time_unit, increasing=True)
    return context.columns(model.file, context.at, [time, column], form=model.form)


def _channel(column: Column, model: RateModel, context: Context) -> _Channel:
    table = _take_channel(column, model, context)
    return _Channel(table.columns[model.time], table.columns[column.name], table.units[column.name])


def _points(
    path: Path, model: RateModel, context: Context, record: Samples, starts: Floats, bounds: Floats
) -> list[FoundCurve]:
    """Mean curves of the operating points of shots that begin at `starts` [s], in the order of their first shots."""
    shots = model.shots
    assert shots is not None
    rail = time = None
    if shots.rail_pressure is not None:
        rail = _channel(Column(shots.rail_pressure, "Pa", model.rail_pressure_unit), model, context).before(starts)
    if shots.energising_time is not None:
        time = _channel(Column(shots.energising_time, "s", model.energising_time_unit), model, context).at(starts)
    places = np.column_stack([values if values is not None else np.ones(len(starts)) for values in (rail, time)])
    for values, what in ((rail, "rail pressure"), (time, "energising time")):
        if values is not None and not (values > 0.0).all():
            i = int(np.argmin(values > 0.0))
            raise InputError(
                f"{path}: the {what} of the shot at {to_text(float(starts[i]), 's')} is not greater than zero.",
                code="out-of-range",
                file=path,
            )
    groups = group_rows(places, shots.same)
    if len(groups) > MOST_CURVES:
        raise (context.at / "shots").error(
            f"the shots are at {len(groups)} operating points, and at most {MOST_CURVES} are read", code="too-many"
        )
    curves = []
    for rows in groups:
        cut = [record._replace(bounds=record.bounds - starts[i]).on(bounds) for i in rows]
        # rounded to six digits, so that the mean of equal numbers equals them
        mean = [None if values is None else float(f"{values[rows].mean():.6g}") for values in (rail, time)]
        curves.append(mean_curve(cut, *mean))
    return curves


def _edges(trigger: _Channel, shots: ShotsModel, dead: float, path: Path, at: Place) -> Floats:
    """Times [s] at which the trigger rises through its level; within `dead` after one no other counts."""
    low, high = float(trigger.value.min()), float(trigger.value.max())
    level = 0.5 * (low + high)
    if shots.level is not None:
        with locate_errors(at / "level"):
            level = parse(shots.level, trigger.unit)
    value = trigger.value
    rises = np.flatnonzero((value[:-1] < level) & (value[1:] >= level))
    if not len(rises):
        raise (at / "trigger").error(
            f'"{shots.trigger}" of {path} never rises through {level:.6g} {trigger.unit}; its values reach from '
            f"{low:.6g} to {high:.6g}",
            code="no-trigger",
        )
    share = (level - value[rises]) / (value[rises + 1] - value[rises])
    times = trigger.time[rises] + share * (trigger.time[rises + 1] - trigger.time[rises])
    edges: list[float] = []
    for moment in times.tolist():
        if not edges or moment - edges[-1] >= dead:
            edges.append(moment)
    return np.array(edges)


def mean_curve(shots: Sequence[Samples], rail_pressure: float | None, energising_time: float | None) -> FoundCurve:
    """Mean of repeated shots, on the raster of the first and as long as the shortest.

    `rail_pressure` and `energising_time` in [Pa], [s].
    """
    if len(shots) == 1:
        return FoundCurve(shots[0], rail_pressure, energising_time)
    begin, end = max(s.bounds[0] for s in shots), min(s.bounds[-1] for s in shots)
    first_bounds = shots[0].bounds
    bounds = first_bounds[(first_bounds >= begin - 1e-12) & (first_bounds <= end + 1e-12)]
    rates = np.array([s.on(bounds).rate for s in shots])
    mean_rate = rates.mean(axis=0)
    power = float(mean_rate @ mean_rate)
    # scale of each shot by least squares; it is not part of the samples' noise
    sizes = rates @ mean_rate / power if power else np.ones(len(shots))
    mean = average_groups(rates - np.multiply.outer(sizes - 1.0, mean_rate), [np.arange(len(shots))])
    samples = shots[0]._replace(bounds=bounds, rate=mean.mean[0])
    # without the contribution of the samples' noise; above 1 there is no injection to scale
    variance = float(sizes.var(ddof=1)) / len(shots) - (mean.sigma or 0.0) ** 2 / max(power, 1e-300)
    scatter = variance**0.5 if 0.0 < variance < 1.0 else 0.0
    return FoundCurve(samples, rail_pressure, energising_time, len(shots), mean.sigma, mean.freedom, scatter)
