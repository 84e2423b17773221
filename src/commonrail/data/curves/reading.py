"""Reading of injection curves: which samples count, what each is the mean of, and their operating points."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.hooks import note
from commonrail.base.units import parse, to_text
from commonrail.data.curves.samples import RateModel, Samples, ShotsModel, raster, samples_of, within_window
from commonrail.data.noise import NOISE, Noise
from commonrail.data.repeats import averaged, groups_of
from commonrail.data.study_block import Context, TraceModel, drive_unit, mass_density
from commonrail.engine.operating_point import LONGEST, Energising, OperatingPoint, Trace
from commonrail.engine.status import check_point
from commonrail.readers.columns import MOST_SHOWN, PLAIN, Column, Sheet, Table
from commonrail.readers.grid import read_grid
from commonrail.readers.location import Place, located
from commonrail.readers.operating_points import ColumnPattern, NamedPoint, find_traces
from commonrail.readers.tables import take_columns


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
        single = FoundCurve(_single(model, context), None, None)
        return [_curve(model, single, context, *courses_at([single], model, context))]
    reader = {"columns": named_columns, "shots": cut_shots, "layout": traces_below_points}[stated[0]]
    found = reader(model, context)
    models = [_at_point(model, curve, at) for curve in found]
    courses = courses_at(found, model, context)
    return [_curve(own, curve, context, read) for own, curve, read in zip(models, found, courses, strict=True)]


def _single(model: RateModel, context: Context) -> Samples:
    time = Column(model.time, "s", model.time_unit, increasing=True)
    rate = Column(model.rate, ("m3/s", "kg/s"), model.rate_unit)
    table = context.columns(model.file, context.at, [time, rate], form=model.form)
    return within_window(samples_of(table, model.rate, model, context.at), model, context.at)


def _at_point(model: RateModel, curve: FoundCurve, at: Place) -> RateModel:
    """The block at the operating point of one of its curves; a measured course goes before the pressure of a name."""
    stated = {"rail_pressure": curve.rail_pressure, "energising_time": curve.energising_time}
    found = {key: value for key, value in stated.items() if value is not None and not _of_each(key, model)}
    for key in found:
        if getattr(model, key) is not None or (key == "energising_time" and model.energisings is not None):
            raise (at / key).error("each curve of the file has its own; remove this key")
    if model.drive is not None and not _of_each("drive", model):
        raise (at / "drive").error(
            "one measured drive cannot belong to several curves; name columns by the pattern of the key columns, as in "
            '{ column = "I_{p}bar" }, or read each curve from a block of its own'
        )
    return model.model_copy(update=found)


def _curve(model: RateModel, curve: FoundCurve, context: Context, courses: Mapping[str, Trace]) -> ReadCurve:
    """Curve with its operating point, by volume; `courses` are those that were read for it."""
    samples = curve.samples
    point = _point(model, samples, context, courses)
    density = mass_density(context.injector, samples.unit, point)
    scale = 1.0 if math.isnan(density) else density
    noise = NOISE
    if curve.sigma is not None:
        spare = float(curve.shots - 1)
        noise = Noise(sigma=curve.sigma / scale, freedom=curve.freedom, scatter=curve.scatter, scatter_freedom=spare)
    return ReadCurve(point, samples.bounds, samples.rate / scale, density, label_of(curve), curve.shots, noise)


def _point(model: RateModel, samples: Samples, context: Context, courses: Mapping[str, Trace]) -> OperatingPoint:
    """Operating point, simulated from the first bound or energising to the last bound, in whole steps."""
    at = context.at
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
    rail, cylinder, low = (courses.get(key, getattr(model, key)) for key in _PRESSURES)
    drive = _drive(model, context, pulses[0].start, courses)
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


def _drive(model: RateModel, context: Context, first: float, courses: Mapping[str, Trace]) -> Trace | None:
    _check_drive(model, context)
    if model.drive is None:
        return None
    drive = courses["drive"]
    return _from_zero(drive, first, context.at / "drive") if model.drive.zero_at_rest else drive


def _check_drive(model: RateModel, context: Context) -> None:
    injector = context.injector
    if bool(drive_unit(injector)) != (model.drive is not None):
        raise ConfigurationError(
            f"{context.at / 'drive'}: the injector {injector.name} has drive_kind "
            f'"{injector.variant.drive.value}"; give a measured drive if, and only if, it is a trace.'
        )


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


_PRESSURES = ("rail_pressure", "cylinder_pressure", "return_pressure")


def _tables(sheet: Sheet, time: Column, wanted: Sequence[Column]) -> list[Table]:
    """Table of each of some columns with their times; the file is gone through once."""
    each = {column.name: column for column in wanted}
    if sheet.apart:
        read = {name: take_columns(sheet, [time, column]) for name, column in each.items()}
    else:
        read = dict.fromkeys(each, take_columns(sheet, [time, *each.values()]))
    return [read[column.name] for column in wanted]


# Repeated shots in one long record: found by a trigger, brought to one raster, averaged at each operating point.

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
    edges = _edges(trigger, shots, max(end - begin, 0.0), source.path, at / "shots")
    period = float(np.median(np.diff(edges))) if len(edges) > 1 else np.inf
    if abs(shots.offset) >= period:
        raise (at / "shots" / "offset").error(
            f"{to_text(shots.offset, 's')} leads to the shot of another trigger, as they are {to_text(period, 's')} "
            "apart; count from the trigger of the shot"
        )
    starts = edges + shots.offset
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


# Several injection curves of one file: columns named by their operating points, or with these in rows above them.


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
    scatter: float = 0.0  # standard error of the mean's quantity as a share of it, as shots scatter as wholes


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
    tables = _tables(sheet, time, wanted)
    samples = [
        within_window(samples_of(table, point.column, model, at), model, at)
        for table, point in zip(tables, points, strict=True)
    ]
    return _gathered(points, samples, at / "columns")


def courses_at(curves: Sequence[FoundCurve], model: RateModel, context: Context) -> list[dict[str, Trace]]:
    """Courses of each curve by their keys; a file is read once for all curves, also where `column` is a pattern.

    What a key does not say of time is that of the data set. Raises `InputError` if not exactly one column fits a curve,
    or a column cannot be read.
    """
    found: list[dict[str, Trace]] = [{} for _ in curves]
    for key in (*_PRESSURES, "drive"):
        item = getattr(model, key)
        if not isinstance(item, TraceModel):
            continue
        if key == "drive":
            _check_drive(model, context)
        at, is_own = context.at / key, item.file is None
        if is_own and item.form != PLAIN:
            raise at.error("encoding, decimal and sheet of a course are those of a file of its own; state file too")
        sheet = context.sheet(item.file or model.file, at, model.form if is_own else item.form)
        names = [item.column] * len(curves)
        if _of_each(key, model):
            pattern = ColumnPattern(item.column, stated_units(model), at / "column")
            points = [point for name in sheet.names if (point := pattern.read(name))]
            for i, curve in enumerate(curves):
                fitting = [point.column for point in points if _is_at(point, curve)]
                if len(fitting) != 1:
                    raise (at / "column").error(
                        f'{len(fitting)} columns of {sheet.path} fit "{item.column}" at {label_of(curve)}, and one must'
                    )
                names[i] = fitting[0]
        unit = drive_unit(context.injector) if key == "drive" else "Pa"
        time = Column(item.time or model.time, "s", item.time_unit or (model.time_unit if is_own else None), True)
        tables = _tables(sheet, time, [Column(name, unit, item.unit) for name in names])
        zero = model.time_zero if is_own else 0.0
        for courses, name, table in zip(found, names, tables, strict=True):
            courses[key] = Trace.of(table.columns[time.name] - zero, table.columns[name])
    return found


def _of_each(key: str, model: RateModel) -> bool:
    """Return whether each curve has its own column of a course: the key `column` is a pattern."""
    item = getattr(model, key)
    return isinstance(item, TraceModel) and model.columns is not None and "{" in item.column


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
    whole = rates.mean(axis=0)
    power = float(whole @ whole)
    # of each shot, by least squares; what it is off by together is none of the noise of its samples
    sizes = rates @ whole / power if power else np.ones(len(shots))
    mean = averaged(rates - np.multiply.outer(sizes - 1.0, whole), [np.arange(len(shots))])
    samples = shots[0]._replace(bounds=bounds, rate=mean.mean[0])
    # less what the noise of samples adds to a factor; below its own size: without an injection it is no share of one
    variance = float(sizes.var(ddof=1)) / len(shots) - (mean.sigma or 0.0) ** 2 / max(power, 1e-300)
    scatter = variance**0.5 if 0.0 < variance < 1.0 else 0.0
    return FoundCurve(samples, rail_pressure, energising_time, len(shots), mean.sigma, mean.freedom, scatter)


def traces_below_points(model: RateModel, context: Context) -> list[FoundCurve]:
    """Curves of a table that has their operating points in rows above them.

    Raises `InputError` if it is no such table. Raises `ConfigurationError` if the window does not fit.
    """
    at = context.at
    path = context.path(model.file, at, model.form)
    grid = read_grid(path, model.form)
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
