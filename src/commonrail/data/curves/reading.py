"""Reading of injection curves: which samples count, what each is the mean of, and their operating points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.units import to_text
from commonrail.data.curves.samples import RateModel, Samples, samples_of, within_window
from commonrail.data.curves.several import FoundCurve, courses_at, label_of, named_columns, traces_below_points
from commonrail.data.curves.shots import cut_shots
from commonrail.data.noise import NOISE, Noise
from commonrail.data.study_block import Context, TraceModel, drive_unit, mass_density
from commonrail.engine.operating_point import LONGEST, Energising, OperatingPoint, Trace
from commonrail.engine.status import check_point
from commonrail.readers.columns import Column
from commonrail.readers.location import Place, located


class ReadCurve(NamedTuple):
    """Content of a curve's file: point, bounds [s], rates [m³/s], and the density that made volumes of masses.

    `label` tells it from others of the same block, `shots` counts those of which it is the mean, and `noise` has the
    standard error of the mean.
    """

    point: OperatingPoint
    bounds: Floats
    rate: Floats
    mass_density: float
    label: str
    shots: int
    noise: Noise


def read_curves(model: RateModel, context: Context) -> list[ReadCurve]:
    """Read the injection curves of a block; see `DataSet.read_all`."""
    at = context.at
    ways = {
        "columns": model.columns is not None,
        "shots": model.shots is not None,
        "layout": model.layout != "columns",
    }
    stated = [key for key, is_stated in ways.items() if is_stated]
    if len(stated) > 1:
        raise at.error(f"{' and '.join(stated)} are different ways to find several curves; keep one")
    if not stated:
        return [_curve(model, FoundCurve(_single(model, context), None, None), context, "")]
    reader = {"columns": named_columns, "shots": cut_shots, "layout": traces_below_points}[stated[0]]
    found = reader(model, context)
    return [_curve(_at_point(model, curve, context), curve, context, label_of(curve)) for curve in found]


def _single(model: RateModel, context: Context) -> Samples:
    time = Column(model.time, "s", model.time_unit, increasing=True)
    rate = Column(model.rate, ("m3/s", "kg/s"), model.rate_unit)
    table = context.columns(model.file, context.at, [time, rate], form=model.form)
    return within_window(samples_of(table, model.rate, model, context.at), model, context.at)


def _at_point(model: RateModel, curve: FoundCurve, context: Context) -> RateModel:
    """The block at the operating point of one of its curves; a measured course goes before the pressure of a name."""
    at, courses = context.at, courses_at(curve, model, context)
    stated = {"rail_pressure": curve.rail_pressure, "energising_time": curve.energising_time}
    found = {key: value for key, value in stated.items() if value is not None and key not in courses}
    for key in found:
        if getattr(model, key) is not None or (key == "energising_time" and model.energisings is not None):
            raise (at / key).error("each curve of the file has its own; remove this key")
    if model.drive is not None and "drive" not in courses:
        raise (at / "drive").error(
            "one measured drive cannot belong to several curves; name columns by the pattern of the key columns, as in "
            '{ column = "I_{p}bar" }, or read each curve from a block of its own'
        )
    return model.model_copy(update={**found, **courses})


def _curve(model: RateModel, curve: FoundCurve, context: Context, label: str) -> ReadCurve:
    """Curve with its operating point, by volume."""
    samples = curve.samples
    point = _point(model, samples, context, context.at)
    density = mass_density(context.injector, samples.unit, point)
    scale = 1.0 if math.isnan(density) else density
    noise = NOISE if curve.sigma is None else Noise(sigma=curve.sigma / scale, freedom=curve.freedom)
    return ReadCurve(point, samples.bounds, samples.rate / scale, density, label, curve.shots, noise)


def _point(model: RateModel, samples: Samples, context: Context, at: Place) -> OperatingPoint:
    """Operating point, simulated from the first bound or energising to the last bound, in whole steps."""
    pulses, bounds = pulses_of(model, at), samples.bounds
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
    if model.rail_pressure is None:
        raise (at / "rail_pressure").error("this key is missing; add it")
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


def pulses_of(model: RateModel, at: Place) -> tuple[Energising, ...]:
    """Energisings that a block states, a single one from time 0."""
    if (model.energising_time is None) == (model.energisings is None):
        raise at.error('give either energising_time = "700 us" or energisings = [{ start = …, duration = … }]')
    if model.energising_time is not None:
        with located(at / "energising_time"):
            return (Energising(0.0, model.energising_time),)
    found = []
    for i, pulse in enumerate(model.energisings or ()):
        with located((at / "energisings")[i]):
            found.append(Energising(pulse.start, pulse.duration))
    return tuple(found)


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
    form = model.form if item.file is None else item.form
    table = context.columns(item.file or model.file, at, wanted, form=form)
    zero = model.time_zero if item.file is None else 0.0
    return Trace.of(table.columns[time] - zero, table.columns[item.column])
