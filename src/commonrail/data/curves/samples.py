"""Samples of a measured rate: bounds of the averaging intervals, windows and resampling."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.units import convert, to_text
from commonrail.data.study_block import Course, DataModel, DriveModel
from commonrail.readers.columns import Table
from commonrail.readers.location import Place
from commonrail.readers.tables import LEAST_SAMPLES
from commonrail.readers.toml import FileModel, Unit

# Shape of the block of an injection curve in a study file.

Time = Annotated[float, Unit("s")]


class PulseModel(FileModel):
    """One energising."""

    start: Time
    duration: Time


class ShotsModel(FileModel):
    """Repeated shots in one long record: how each is found, and the columns that state its operating point.

    `offset` is the time from the trigger's edge to the start of energising; shots whose pressures and times differ by
    less than `same` belong to one operating point.
    """

    trigger: str
    level: str | float | int | None = None
    offset: Time = 0.0
    rail_pressure: str | None = None
    energising_time: str | None = None
    same: Annotated[float, Unit("1"), Field(gt=0.0, lt=1.0)] = 0.02


class RateModel(DataModel):
    """One injection curve of a file, or several: as named columns, below header rows, or as shots of a record."""

    kind: Literal["rate"]
    time: str = "time"
    rate: str = "rate"
    columns: str | None = None
    layout: Literal["columns", "header rows"] = "columns"
    shots: ShotsModel | None = None
    time_unit: str | None = None
    rate_unit: str | None = None
    rail_pressure_unit: str | None = None
    energising_time_unit: str | None = None
    rail_pressure: Course | None = None
    cylinder_pressure: Course
    return_pressure: Course
    drive: DriveModel | None = None
    energising_time: Time | None = None
    energisings: list[PulseModel] | None = Field(default=None, min_length=1, max_length=100)
    time_zero: Time = 0.0
    resample: Annotated[float, Unit("s"), Field(gt=0.0)] | None = None
    window: list[Time] | None = Field(default=None, min_length=2, max_length=2)
    sampling: Literal["mean", "centred"] = "mean"
    first_bound: Time | None = None


MOST_SAMPLES = 1_000_000  # of a curve on another raster

_TIME_UNITS = ("us", "ms", "s", "ns")


class Samples(NamedTuple):
    """Samples of a rate."""

    bounds: Floats  # (n + 1,): [s]
    rate: Floats  # (n,): in `unit`, m3/s or kg/s
    unit: str
    time_unit: str  # unit of the time as the file gives it
    time: str  # where it is given

    def range(self) -> str:
        """Part of a sentence that states the time range of the samples."""
        first, last = (to_text(float(bound), "s") for bound in (self.bounds[0], self.bounds[-1]))
        return f"the samples reach from {first} to {last}, {self.time} being in {self.time_unit}"

    def misread(self, begin: float, end: float) -> str:
        """Advice to correct the time unit, if the samples would cover `begin` to `end` [s] in another unit."""
        stated_factor = convert(1.0, self.time_unit, "s")
        for unit in _TIME_UNITS:
            factor = convert(1.0, unit, "s") / stated_factor
            first, last = factor * float(self.bounds[0]), factor * float(self.bounds[-1])
            inside = np.count_nonzero((factor * self.bounds >= begin) & (factor * self.bounds <= end))
            if unit != self.time_unit and inside > LEAST_SAMPLES and last >= 0.5 * end and first <= begin + 0.5 * end:
                return f'; if they were recorded in {unit}, correct the unit of {self.time} to "{unit}"'
        return ""

    def on(self, bounds: Floats) -> Samples:
        """Samples over other intervals within their time range; the integral over time is kept.

        The integral is interpolated by cubics with slopes from central differences. Linear interpolation would average
        neighbours at a shift of half a sample: a second low-pass filter, which the model of the meter does not contain.
        """
        from scipy.interpolate import CubicHermiteSpline  # takes a tenth of a second to import

        integral = np.concatenate(([0.0], np.cumsum(self.rate * np.diff(self.bounds))))
        course = CubicHermiteSpline(self.bounds, integral, np.gradient(integral, self.bounds, edge_order=2))
        return self._replace(bounds=bounds, rate=np.diff(course(bounds)) / np.diff(bounds))


def read_samples(table: Table, column: str, model: RateModel, at: Place) -> Samples:
    """Samples of a column of rates, with the times of its table.

    An empty cell at the end of the `column` ends the samples. Raises `InputError` for too few samples or a gap.
    """
    time, rate = table.columns[model.time] - model.time_zero, table.columns[column]
    empty = np.flatnonzero(np.isnan(rate))
    if len(empty):
        if not np.isnan(rate[empty[0] :]).all():
            raise table.place(column, int(empty[0])).error(
                "a number is expected: others follow in this column", code="not-a-number"
            )
        time, rate = time[: empty[0]], rate[: empty[0]]
    if len(rate) < LEAST_SAMPLES:
        raise Place(str(table.path), f'column "{column}"').error(
            f"there are {len(rate)} samples, and at least {LEAST_SAMPLES} are needed", code="too-few"
        )
    where = f'the column "{model.time}" of {table.path}'
    return Samples(_bounds(model, time, at), rate, table.units[column], table.written_units[model.time], where)


def _bounds(model: RateModel, time: Floats, at: Place) -> Floats:
    """Bounds of the intervals that the samples are means over."""
    if model.sampling == "centred":
        if model.first_bound is not None:
            raise (at / "first_bound").error('this key belongs to sampling = "mean"; remove it', code="idle-key")
        return bounds_around(time)
    first = 2.0 * time[0] - time[1]
    if model.first_bound is not None:
        first = model.first_bound
        if not first < time[0]:
            raise (at / "first_bound").error(
                f"{to_text(first, 's')} must lie before the first sample at {to_text(float(time[0]), 's')}",
                code="order",
            )
    return np.concatenate(([first], time))


def bounds_around(time: Floats) -> Floats:
    """Bounds (n + 1,) in the middle between times (n,)."""
    middles = 0.5 * (time[1:] + time[:-1])
    return np.concatenate(([2.0 * time[0] - middles[0]], middles, [2.0 * time[-1] - middles[-1]]))


def within_window(samples: Samples, model: RateModel, at: Place) -> Samples:
    """Samples whose intervals lie in the window, at the requested sample interval."""
    begin, end = float(samples.bounds[0]), float(samples.bounds[-1])
    if model.window is not None:
        begin, end = model.window
        _check_window(samples, begin, end, at / "window")
    if model.resample is not None:
        return samples.on(raster(begin, end, model.resample, at / "resample"))
    if model.window is None:
        return samples
    slack = _slack(samples)
    inside = np.flatnonzero((samples.bounds >= begin - slack) & (samples.bounds <= end + slack))
    if len(inside) <= LEAST_SAMPLES:
        cure = samples.misread(begin, end) or "; widen the window, or correct the unit if the times are wrong"
        raise ConfigurationError(
            f"{at / 'window'}: only {max(len(inside) - 1, 0)} samples lie in the window from {to_text(begin, 's')} to "
            f"{to_text(end, 's')}, and at least {LEAST_SAMPLES} are needed; {samples.range()}{cure}.",
            code="too-few",
            file=at.file,
            place=(at / "window").key,
        )
    first, last = int(inside[0]), int(inside[-1])
    return samples._replace(bounds=samples.bounds[first : last + 1].copy(), rate=samples.rate[first:last])


def _slack(samples: Samples) -> float:
    """Rounding of microseconds to seconds [s]."""
    return 1e-3 * float(np.min(np.diff(samples.bounds)))


def _check_window(samples: Samples, begin: float, end: float, at: Place) -> None:
    bounds, slack = samples.bounds, _slack(samples)
    if not begin < end:
        raise ConfigurationError(
            f'{at}: the window must begin before it ends, as in ["0 us", "1200 us"].',
            code="order",
            file=at.file,
            place=at.key,
        )
    if begin < bounds[0] - slack or end > bounds[-1] + slack:
        cure = (
            samples.misread(begin, end) or "; choose a window within them, or correct the unit if the times are wrong"
        )
        raise ConfigurationError(
            f"{at}: the window reaches from {to_text(begin, 's')} to {to_text(end, 's')}, and {samples.range()}{cure}.",
            code="window-outside",
            file=at.file,
            place=at.key,
        )


def raster(begin: float, end: float, step: float, at: Place) -> Floats:
    """Bounds of equal intervals from `begin`, as many as fit before `end`.

    `begin`, `end` and `step` in [s]. Raises `InputError` for too few or too many intervals.
    """
    count = int(np.floor((end - begin) / step + 1e-6))
    if not LEAST_SAMPLES <= count <= MOST_SAMPLES:
        raise at.error(
            f"a step of {to_text(step, 's')} makes {count} samples of the time from {to_text(begin, 's')} to "
            f"{to_text(end, 's')}, and {LEAST_SAMPLES} to {MOST_SAMPLES} are allowed",
            code="wrong-number",
        )
    return np.asarray(begin + step * np.arange(count + 1, dtype=np.float64))
