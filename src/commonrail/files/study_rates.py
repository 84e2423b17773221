"""Injection curves of a study: which samples count, what each is the mean of, and their operating point."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.study import RateData, Role
from commonrail.engine.operating_point import Course, Energising, OperatingPoint, Trace
from commonrail.engine.validity import check_point
from commonrail.errors import ConfigurationError
from commonrail.files.place import Place, located
from commonrail.files.study_context import Context
from commonrail.files.study_models import RateModel, TraceModel
from commonrail.files.tables import LEAST_SAMPLES, read_columns
from commonrail.units import parse, to_text

__all__ = ["read_rate"]

Floats = NDArray[np.float64]

LONGEST = 1.0  # of a simulation [s]


class _Samples(NamedTuple):
    """Bounds (n + 1,) [s], rates (n,) in `unit`."""

    bounds: Floats
    rate: Floats
    unit: str


def read_rate(model: RateModel, context: Context, at: Place) -> RateData:
    """Read an injection curve.

    Parameters
    ----------
    model : RateModel
    context : Context
    at : Place
        Of the data set in the study file.

    Raises
    ------
    InputError
        If a file or a value cannot be read.
    ConfigurationError
        If the window does not fit the data or the energising, or the drive does not fit the injector.
    """
    samples = _window(_samples(model, context, at), model, at)
    point = _point(model, samples.bounds, context, at)
    density = context.mass_density(samples.unit, point)
    return RateData(
        model.name,
        Role(model.role),
        point,
        samples.bounds,
        samples.rate if math.isnan(density) else samples.rate / density,
        model.weight,
        model.source,
        model.synthetic,
        density,
    )


def _samples(model: RateModel, context: Context, at: Place) -> _Samples:
    table = read_columns(
        context.path(model.file, at / "file"),
        {model.time: "s", model.rate: ("m3/s", "kg/s")},
        stated={model.time: model.time_unit, model.rate: model.rate_unit},
        increasing=model.time,
    )
    bounds = _bounds(model, table.columns[model.time], at)
    return _Samples(bounds, table.columns[model.rate], table.units[model.rate])


def _bounds(model: RateModel, time: Floats, at: Place) -> Floats:
    """Bounds of the intervals that the samples are means over."""
    if model.sampling == "centred":
        if model.first_bound is not None:
            raise (at / "first_bound").error('this key belongs to sampling = "mean"; remove it')
        middles = 0.5 * (time[1:] + time[:-1])
        return np.concatenate(([2.0 * time[0] - middles[0]], middles, [2.0 * time[-1] - middles[-1]]))
    first = 2.0 * time[0] - time[1]
    if model.first_bound is not None:
        first = parse(model.first_bound, "s", str(at / "first_bound"))
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
    begin, end = (parse(item, "s", str(at[i])) for i, item in enumerate(model.window))
    slack = 1e-3 * float(np.min(np.diff(bounds)))  # rounding of microseconds to seconds
    if not begin < end:
        raise ConfigurationError(f'{at}: the window must begin before it ends, as in ["0 us", "1200 us"].')
    if begin < bounds[0] - slack or end > bounds[-1] + slack:
        raise ConfigurationError(
            f"{at}: the window reaches from {to_text(begin, 's')} to {to_text(end, 's')}, and the samples "
            f"only from {to_text(float(bounds[0]), 's')} to {to_text(float(bounds[-1]), 's')}; narrow it."
        )
    inside = np.flatnonzero((bounds >= begin - slack) & (bounds <= end + slack))
    if len(inside) <= LEAST_SAMPLES:
        raise ConfigurationError(
            f"{at}: only {max(len(inside) - 1, 0)} samples lie in the window, and at least "
            f"{LEAST_SAMPLES} are needed; widen it."
        )
    first, last = int(inside[0]), int(inside[-1])
    return _Samples(bounds[first : last + 1].copy(), samples.rate[first:last], samples.unit)


def _point(model: RateModel, bounds: Floats, context: Context, at: Place) -> OperatingPoint:
    """Operating point, simulated from the first bound or energising to the last bound, in whole steps."""
    pulses = _pulses(model, at)
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
            f"simulation may be, {to_text(LONGEST, 's')}; give a window."
        )
    rail, cylinder, low = (
        _course(item, "Pa", model, context, at / key)
        for key, item in (
            ("rail_pressure", model.rail_pressure),
            ("cylinder_pressure", model.cylinder_pressure),
            ("return_pressure", model.return_pressure),
        )
    )
    drive = _drive(model, context, at / "drive")
    with located(at):
        point = OperatingPoint(rail, pulses, cylinder, low, drive, steps * context.time_step, start)
        check_point(context.injector, point)
        return point


def _pulses(model: RateModel, at: Place) -> tuple[Energising, ...]:
    if (model.energising_time is None) == (model.energisings is None):
        raise at.error('give either energising_time = "700 us" or energisings = [{ start = …, duration = … }]')
    if model.energisings is None:
        return (Energising(0.0, parse(model.energising_time or 0.0, "s", str(at / "energising_time"))),)
    at = at / "energisings"
    return tuple(
        Energising(parse(p.start, "s", str(at[i] / "start")), parse(p.duration, "s", str(at[i] / "duration")))
        for i, p in enumerate(model.energisings)
    )


def _drive(model: RateModel, context: Context, at: Place) -> Trace | None:
    injector, unit = context.injector, context.drive_unit
    if bool(unit) != (model.drive is not None):
        raise ConfigurationError(
            f"{at}: the injector {injector.name} has drive_kind "
            f'"{injector.variant.drive.value}"; give a measured drive if, and only if, it is a trace.'
        )
    return None if model.drive is None else _trace(model.drive, unit, model, context, at)


def _course(item: str | float | TraceModel, unit: str, model: RateModel, context: Context, at: Place) -> Course:
    if isinstance(item, TraceModel):
        return _trace(item, unit, model, context, at)
    return parse(item, unit, str(at))


def _trace(item: TraceModel, unit: str, model: RateModel, context: Context, at: Place) -> Trace:
    """A measured course; what it does not say of file and time is that of the data set."""
    time = item.time or model.time
    time_unit = item.time_unit or (model.time_unit if item.file is None else None)
    table = read_columns(
        context.path(item.file or model.file, at / "file"),
        {time: "s", item.column: unit},
        stated={time: time_unit, item.column: item.unit},
        increasing=time,
    )
    return Trace.of(table.columns[time], table.columns[item.column])
