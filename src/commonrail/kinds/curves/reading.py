"""Reading of injection curves: which samples count, what each is the mean of, and their operating point."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from commonrail.engine.operating_point import LONGEST, Energising, OperatingPoint, Trace
from commonrail.engine.validity import check_point
from commonrail.errors import ConfigurationError
from commonrail.kinds.reading import Context, Course, DataModel, DriveModel, TraceModel, drive_unit, mass_density
from commonrail.reading.fields import FileModel, Unit
from commonrail.reading.place import Place, located
from commonrail.reading.tables import LEAST_SAMPLES, Column
from commonrail.units import convert, to_text

__all__ = ["PulseModel", "RateModel", "ReadCurve", "read_curve"]

Floats = NDArray[np.float64]

Time = Annotated[float, Unit("s")]

_TIME_UNITS = ("us", "ms", "s", "ns")


class _Samples(NamedTuple):
    """Bounds (n + 1,) [s], rates (n,) in `unit`; unit of the time as the file gives it, and where it is given."""

    bounds: Floats
    rate: Floats
    unit: str
    time_unit: str
    time: str

    def range(self) -> str:
        """Sentence part that says what times the samples have."""
        first, last = (to_text(float(bound), "s") for bound in (self.bounds[0], self.bounds[-1]))
        return f"the samples reach from {first} to {last}, {self.time} being in {self.time_unit}"

    def misread(self, begin: float, end: float) -> str:
        """Cure for samples that would fill a time from `begin` to `end` [s] if their unit were another one."""
        own = convert(1.0, self.time_unit, "s")
        for unit in _TIME_UNITS:
            factor = convert(1.0, unit, "s") / own
            first, last = factor * float(self.bounds[0]), factor * float(self.bounds[-1])
            inside = np.count_nonzero((factor * self.bounds >= begin) & (factor * self.bounds <= end))
            if unit != self.time_unit and inside > LEAST_SAMPLES and last >= 0.5 * end and first <= begin + 0.5 * end:
                return f'; if they were recorded in {unit}, correct the unit of {self.time} to "{unit}"'
        return ""


class PulseModel(FileModel):
    """One energising."""

    start: Time
    duration: Time


class RateModel(DataModel):
    """An injection curve."""

    kind: Literal["rate"]
    time: str = "time"
    rate: str = "rate"
    time_unit: str | None = None
    rate_unit: str | None = None
    rail_pressure: Course
    cylinder_pressure: Course
    return_pressure: Course
    drive: DriveModel | None = None
    energising_time: Time | None = None
    energisings: list[PulseModel] | None = Field(default=None, min_length=1, max_length=100)
    window: list[Time] | None = Field(default=None, min_length=2, max_length=2)
    sampling: Literal["mean", "centred"] = "mean"
    first_bound: Time | None = None


class ReadCurve(NamedTuple):
    """Content of a curve's file: point, bounds [s], rates [m³/s], and the density that made volumes of masses."""

    point: OperatingPoint
    bounds: Floats
    rate: Floats
    mass_density: float


def read_curve(model: RateModel, context: Context) -> ReadCurve:
    """Read an injection curve; see `DataSet.read`."""
    at = context.at
    samples = _window(_samples(model, context, at), model, at)
    point = _point(model, samples, context, at)
    density = mass_density(context.injector, samples.unit, point)
    return ReadCurve(point, samples.bounds, samples.rate if math.isnan(density) else samples.rate / density, density)


def _samples(model: RateModel, context: Context, at: Place) -> _Samples:
    time = Column(model.time, "s", model.time_unit, increasing=True)
    table = context.columns(model.file, at, [time, Column(model.rate, ("m3/s", "kg/s"), model.rate_unit)])
    bounds = _bounds(model, table.columns[model.time], at)
    column = f'the column "{model.time}" of {table.path}'
    return _Samples(bounds, table.columns[model.rate], table.units[model.rate], table.given[model.time], column)


def _bounds(model: RateModel, time: Floats, at: Place) -> Floats:
    """Bounds of the intervals that the samples are means over."""
    if model.sampling == "centred":
        if model.first_bound is not None:
            raise (at / "first_bound").error('this key belongs to sampling = "mean"; remove it')
        middles = 0.5 * (time[1:] + time[:-1])
        return np.concatenate(([2.0 * time[0] - middles[0]], middles, [2.0 * time[-1] - middles[-1]]))
    first = 2.0 * time[0] - time[1]
    if model.first_bound is not None:
        first = model.first_bound
        if not first < time[0]:
            raise (at / "first_bound").error(
                f"{to_text(first, 's')} must lie before the first sample at {to_text(float(time[0]), 's')}"
            )
    return np.concatenate(([first], time))


def _window(samples: _Samples, model: RateModel, at: Place) -> _Samples:
    """The samples whose intervals lie in the window."""
    if model.window is None:
        return samples
    at = at / "window"
    bounds = samples.bounds
    begin, end = model.window
    slack = 1e-3 * float(np.min(np.diff(bounds)))  # rounding of microseconds to seconds
    if not begin < end:
        raise ConfigurationError(f'{at}: the window must begin before it ends, as in ["0 us", "1200 us"].')
    if begin < bounds[0] - slack or end > bounds[-1] + slack:
        cure = (
            samples.misread(begin, end) or "; choose a window within them, or correct the unit if the times are wrong"
        )
        raise ConfigurationError(
            f"{at}: the window reaches from {to_text(begin, 's')} to {to_text(end, 's')}, and {samples.range()}{cure}."
        )
    inside = np.flatnonzero((bounds >= begin - slack) & (bounds <= end + slack))
    if len(inside) <= LEAST_SAMPLES:
        cure = samples.misread(begin, end) or "; widen the window, or correct the unit if the times are wrong"
        raise ConfigurationError(
            f"{at}: only {max(len(inside) - 1, 0)} samples lie in the window from {to_text(begin, 's')} to "
            f"{to_text(end, 's')}, and at least {LEAST_SAMPLES} are needed; {samples.range()}{cure}."
        )
    first, last = int(inside[0]), int(inside[-1])
    return samples._replace(bounds=bounds[first : last + 1].copy(), rate=samples.rate[first:last])


def _point(model: RateModel, samples: _Samples, context: Context, at: Place) -> OperatingPoint:
    """Operating point, simulated from the first bound or energising to the last bound, in whole steps."""
    pulses, bounds = _pulses(model, at), samples.bounds
    if pulses[0].start >= bounds[-1]:
        raise ConfigurationError(
            f"{at}: the samples that count end at {to_text(float(bounds[-1]), 's')}, before the first "
            f"energising at {to_text(pulses[0].start, 's')}; correct the window or the energising."
        )
    start = min(float(bounds[0]), pulses[0].start)
    steps = math.ceil((float(bounds[-1]) - start) / context.time_step - 1e-6)
    if steps * context.time_step > LONGEST:
        raise ConfigurationError(
            f"{at}: the samples that count reach over {to_text(float(bounds[-1]) - start, 's')}, longer than a "
            f"simulation may be, {to_text(LONGEST, 's')}: {samples.range()}; give a window, or correct the unit if the "
            "times are wrong."
        )
    rail, cylinder, low = (
        item if isinstance(item, float) else _trace(item, "Pa", model, context, at / key)
        for key, item in (
            ("rail_pressure", model.rail_pressure),
            ("cylinder_pressure", model.cylinder_pressure),
            ("return_pressure", model.return_pressure),
        )
    )
    drive = _drive(model, context, pulses[0].start, at / "drive")
    with located(at):
        point = OperatingPoint(rail, pulses, cylinder, low, drive, steps * context.time_step, start=start)
        check_point(context.injector, point)
        return point


def _pulses(model: RateModel, at: Place) -> tuple[Energising, ...]:
    if (model.energising_time is None) == (model.energisings is None):
        raise at.error('give either energising_time = "700 us" or energisings = [{ start = …, duration = … }]')
    if model.energising_time is not None:
        with located(at / "energising_time"):
            return (Energising(0.0, model.energising_time),)
    at = at / "energisings"
    return tuple(_pulse(pulse, at[i]) for i, pulse in enumerate(model.energisings or ()))


def _pulse(pulse: PulseModel, at: Place) -> Energising:
    with located(at):
        return Energising(pulse.start, pulse.duration)


def _drive(model: RateModel, context: Context, first: float, at: Place) -> Trace | None:
    injector, unit = context.injector, drive_unit(context.injector)
    if bool(unit) != (model.drive is not None):
        raise ConfigurationError(
            f"{at}: the injector {injector.name} has drive_kind "
            f'"{injector.variant.drive.value}"; give a measured drive if, and only if, it is a trace.'
        )
    if model.drive is None:
        return None
    drive = _trace(model.drive, unit, model, context, at)
    return _from_zero(drive, first, at) if model.drive.zero_at_rest else drive


def _from_zero(drive: Trace, first: float, at: Place) -> Trace:
    """The drive less its mean before the first energising at `first` [s], while no current can flow."""
    time, value = np.array(drive.time), np.array(drive.value)
    before = time < first
    if not before.any():
        raise (at / "zero_at_rest").error(
            f"the drive has no sample before the first energising at {to_text(first, 's')}, so that its zero is "
            "unknown; give a longer trace, or omit this key"
        )
    return Trace.of(time, value - float(np.mean(value[before])))


def _trace(item: TraceModel, unit: str, model: RateModel, context: Context, at: Place) -> Trace:
    """Read a measured course; what it does not say of file and time is that of the data set."""
    time = item.time or model.time
    time_unit = item.time_unit or (model.time_unit if item.file is None else None)
    wanted = [Column(time, "s", time_unit, increasing=True), Column(item.column, unit, item.unit)]
    table = context.columns(item.file or model.file, at, wanted)
    return Trace.of(table.columns[time], table.columns[item.column])
