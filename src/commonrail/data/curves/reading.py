"""Reading of injection curves: which samples count, what each is the mean of, and their operating points."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.hooks import note
from commonrail.base.units import to_text
from commonrail.data.curves.samples import RateModel, Samples, read_samples, within_window
from commonrail.data.curves.shots import MOST_CURVES, RATES, FoundCurve, cut_shots, mean_curve
from commonrail.data.repeats import group_rows
from commonrail.data.study_block import Context, PressureModel, TraceModel, drive_unit
from commonrail.engine.operating_point import LONGEST, Energising, OperatingPoint, Trace
from commonrail.engine.record_filter import low_pass
from commonrail.engine.status import check_point
from commonrail.readers.columns import MOST_SHOWN, PLAIN, Column, name_and_unit
from commonrail.readers.grid import read_grid
from commonrail.readers.location import Place, locate_errors
from commonrail.readers.operating_points import ColumnPattern, NamedPoint, find_traces
from commonrail.readers.tables import take_each


def read_curves(model: RateModel, context: Context) -> list[tuple[FoundCurve, OperatingPoint]]:
    """Read the injection curves of a block, each with its operating point; see `DataSet.read_all`."""
    at = context.at
    ways = {
        "columns": model.columns is not None,
        "shots": model.shots is not None,
        "layout": model.layout != "columns",
    }
    stated = [key for key, is_stated in ways.items() if is_stated]
    if len(stated) > 1:
        raise at.error(f"{' and '.join(stated)} are different ways to find several curves; keep one", code="conflict")
    if not stated:
        time = Column(model.time, "s", model.time_unit, increasing=True)
        table = context.columns(model.file, at, [time, Column(model.rate, RATES, model.rate_unit)], form=model.form)
        samples = within_window(read_samples(table, model.rate, model, at), model, at)
        single = FoundCurve(samples, None, None)
        return [(single, _point(model, samples, context, *courses_at([single], model, context)))]
    reader = {"columns": read_named_columns, "shots": cut_shots, "layout": traces_below_points}[stated[0]]
    curves = reader(model, context)
    models = [_at_point(model, curve, at) for curve in curves]
    courses = courses_at(curves, model, context)
    return [
        (curve, _point(own_model, curve.samples, context, read))
        for own_model, curve, read in zip(models, curves, courses, strict=True)
    ]


def _at_point(model: RateModel, curve: FoundCurve, at: Place) -> RateModel:
    """The block at the operating point of one of its curves; a measured course overrides a column name's pressure."""
    stated = {"rail_pressure": curve.rail_pressure, "energising_time": curve.energising_time}
    from_name = {key: value for key, value in stated.items() if value is not None and not _of_each(key, model)}
    for key in from_name:
        if getattr(model, key) is not None or (key == "energising_time" and model.energisings is not None):
            raise (at / key).error("each curve of the file has its own; remove this key", code="idle-key")
    if model.drive is not None and not _of_each("drive", model):
        raise (at / "drive").error(
            "one measured drive cannot belong to several curves; name columns by the pattern of the key columns, as in "
            '{ column = "I_{p}bar" }, or read each curve from a block of its own',
            code="shared-drive",
        )
    return model.model_copy(update=from_name)


def _point(model: RateModel, samples: Samples, context: Context, courses: Mapping[str, Trace]) -> OperatingPoint:
    """Operating point, simulated from the first bound or energising to the last bound, in whole steps."""
    at = context.at
    pulses, bounds = list_pulses(model, at), samples.bounds
    if pulses[0].start >= bounds[-1]:
        raise ConfigurationError(
            f"{at}: the samples that count end at {to_text(float(bounds[-1]), 's')}, before the first "
            f"energising at {to_text(pulses[0].start, 's')}; correct the window or the energising.",
            code="energising-after-data",
            file=at.file,
            place=at.key,
        )
    start = min(float(bounds[0]), pulses[0].start)
    steps = math.ceil((float(bounds[-1]) - start) / context.time_step - 1e-6)
    if steps * context.time_step > LONGEST:
        raise ConfigurationError(
            f"{at}: the samples that count reach over {to_text(float(bounds[-1]) - start, 's')}, longer than a "
            f"simulation may be, {to_text(LONGEST, 's')}: {samples.range()}; give a window, or correct the unit if the "
            "times are wrong.",
            code="too-long",
            file=at.file,
            place=at.key,
        )
    if model.rail_pressure is None:
        raise (at / "rail_pressure").error("this key is missing; add it", code="missing")
    rail, cylinder, low = (courses.get(key, getattr(model, key)) for key in _PRESSURES)
    drive = _drive(model, context, pulses[0].start, courses)
    with locate_errors(at):
        point = OperatingPoint(rail, pulses, cylinder, low, drive, steps * context.time_step, start=start)
        check_point(context.injector, point)
        return point


def list_pulses(model: RateModel, at: Place) -> tuple[Energising, ...]:
    """Energisings that a block states, a single one from time 0."""
    if (model.energising_time is None) == (model.energisings is None):
        raise at.error(
            'give either energising_time = "700 us" or energisings = [{ start = …, duration = … }]', code="conflict"
        )
    if model.energising_time is not None:
        with locate_errors(at / "energising_time"):
            return (Energising(0.0, model.energising_time),)
    pulses = []
    for i, pulse in enumerate(model.energisings or ()):
        with locate_errors((at / "energisings")[i]):
            pulses.append(Energising(pulse.start, pulse.duration))
    return tuple(pulses)


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
            f'"{injector.variant.drive.value}"; state a measured drive only for "current" or "voltage".',
            code="drive-kind",
            file=context.at.file,
            place=(context.at / "drive").key,
        )


def _from_zero(drive: Trace, first: float, at: Place) -> Trace:
    """The drive less its mean before the first energising at `first` [s], while no current can flow."""
    time, value = np.array(drive.time), np.array(drive.value)
    before = time < first
    if not before.any():
        raise (at / "zero_at_rest").error(
            f"the drive has no sample before the first energising at {to_text(first, 's')}, so that its zero is "
            "unknown; give a longer trace, or omit this key",
            code="no-zero",
        )
    return Trace.of(time, value - float(np.mean(value[before])))


_PRESSURES = ("rail_pressure", "cylinder_pressure", "return_pressure")


# Several injection curves of one file: columns named by their operating points, or with these in rows above them.


Record = tuple[Floats, Floats]  # times [s] and values
NOISE_TOLD = 1e-4  # least reported noise (rms) relative to the pressure; tenfold noise changes pilots by 10 %
SAME = 1e-6  # relative difference below which two traces are at one operating point


def read_named_columns(model: RateModel, context: Context) -> list[FoundCurve]:
    """Curves of the columns whose names fit the key `columns` of a block.

    Raises `InputError` if no name fits, or a column cannot be read. Raises `ConfigurationError` if the window does not
    fit.
    """
    at = context.at
    pattern = ColumnPattern(name_and_unit(model.columns or "")[0], list_units(model), at / "columns")
    sheet = context.sheet(model.file, at, model.form)
    points = [point for name in sheet.names if (point := pattern.read(name)) is not None]
    if not points:
        shown = ", ".join(f'"{name}"' for name in sheet.names[:MOST_SHOWN])
        raise (at / "columns").error(
            f'no column of {sheet.path} fits "{pattern.text}"; it has {shown}{", …" * (len(sheet.names) > MOST_SHOWN)}',
            code="no-columns",
        )
    if len(points) > MOST_CURVES:
        raise (at / "columns").error(f"{len(points)} columns fit, and at most {MOST_CURVES} are read", code="too-many")
    time = Column(model.time, "s", model.time_unit, increasing=True)
    columns = [Column(point.column, RATES, model.rate_unit, required=False) for point in points]
    tables = take_each(sheet, time, columns)
    samples = [
        within_window(read_samples(table, point.column, model, at), model, at)
        for table, point in zip(tables, points, strict=True)
    ]
    return _average_shots(points, samples, at / "columns")


def courses_at(curves: Sequence[FoundCurve], model: RateModel, context: Context) -> list[dict[str, Trace]]:
    """Measured courses of each curve by key; a file is read once for all curves, even if `column` is a pattern.

    Times default to those of the data set. Pressures are low-passed, with a note. Raises `InputError`
    if not exactly one column fits a curve, or a column cannot be read.
    """
    courses_of_curves: list[dict[str, Trace]] = [{} for _ in curves]
    for key in (*_PRESSURES, "drive"):
        item = getattr(model, key)
        if not isinstance(item, TraceModel):
            continue
        if key == "drive":
            _check_drive(model, context)
        at, is_own = context.at / key, item.file is None
        if is_own and item.form != PLAIN:
            raise at.error(
                "encoding, decimal and sheet of a course apply to a separate file; state file too",
                code="missing-file-key",
            )
        sheet = context.sheet(item.file or model.file, at, model.form if is_own else item.form)
        names = [item.column] * len(curves)
        if _of_each(key, model):
            pattern = ColumnPattern(item.column, list_units(model), at / "column")
            points = [point for name in sheet.names if (point := pattern.read(name))]
            for i, curve in enumerate(curves):
                fitting = [point.column for point in points if _is_at(point, curve)]
                if len(fitting) != 1:
                    raise (at / "column").error(
                        f'{len(fitting)} columns of {sheet.path} fit "{item.column}" at {curve.label}, and one must',
                        code="open-column",
                    )
                names[i] = fitting[0]
        unit = drive_unit(context.injector) if key == "drive" else "Pa"
        time = Column(item.time or model.time, "s", item.time_unit or (model.time_unit if is_own else None), True)
        tables = take_each(sheet, time, [Column(name, unit, item.unit) for name in names])
        zero = model.time_zero if is_own else 0.0
        read = {
            name: (table.columns[time.name] - zero, table.columns[name])
            for name, table in zip(names, tables, strict=True)
        }
        if isinstance(item, PressureModel):
            read = _low_passed(read, item.low_pass, at)
        traces = {name: Trace.of(*record) for name, record in read.items()}
        for courses, name in zip(courses_of_curves, names, strict=True):
            courses[key] = traces[name]
    return courses_of_curves


def _low_passed(records: Mapping[str, Record], cut_off: float | None, at: Place) -> dict[str, Record]:
    """Records of a pressure without the noise of its sensor; a note tells what the noisiest one loses."""
    filtered = {name: low_pass(*record, cut_off) for name, record in records.items()}
    most = max(filtered.values(), key=lambda course: course.removed)
    if most.removed > NOISE_TOLD * np.abs(most.value).mean():
        note(
            f"{at}: low-passed at {to_text(most.cut_off, 'Hz', 3)}, removing {to_text(most.removed, 'Pa', 2)} rms: "
            "to change the cut-off, state low_pass."
        )
    return {name: (course.time, course.value) for name, course in filtered.items()}


def _of_each(key: str, model: RateModel) -> bool:
    """Return whether each curve has its own column of a course: the key `column` is a pattern."""
    item = getattr(model, key)
    return isinstance(item, TraceModel) and model.columns is not None and "{" in item.column


def _is_at(point: NamedPoint, curve: FoundCurve) -> bool:
    pairs = (point.rail_pressure, curve.rail_pressure), (point.energising_time, curve.energising_time)
    return all(a is None or b is None or abs(a - b) <= SAME * b for a, b in pairs)


def list_units(model: RateModel) -> dict[str, str]:
    """Stated units of the numbers in column names, by SI unit."""
    return {"Pa": model.rail_pressure_unit or "", "s": model.energising_time_unit or ""}


def _average_shots(points: Sequence[NamedPoint], samples: Sequence[Samples], at: Place) -> list[FoundCurve]:
    """One curve for each operating point: the mean of its shots."""
    places = np.array([(p.rail_pressure or 1.0, p.energising_time or 1.0) for p in points])
    curves = []
    for rows in group_rows(places, SAME):
        first = points[rows[0]]
        if len(rows) > 1 and not first.shot:
            raise at.error(
                f'the columns "{first.column}" and "{points[rows[1]].column}" are at one operating point; if they '
                "are repeated shots, replace the shot number in the pattern by {shot}",
                code="repeated",
            )
        curves.append(mean_curve([samples[i] for i in rows], first.rail_pressure, first.energising_time))
    return curves


def traces_below_points(model: RateModel, context: Context) -> list[FoundCurve]:
    """Curves of a table that has their operating points in rows above them.

    Raises `InputError` if it is not such a table. Raises `ConfigurationError` if the window does not fit.
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
        raise InputError(
            f"{path}: the table has {len(wide.names)} traces, and at most {MOST_CURVES} are read.",
            code="too-many",
            file=path,
        )
    note(f"{path}: read as {len(wide.names)} traces below their operating points; {'; '.join(grid.said)}.")
    rail, time = wide.points.get("rail pressure"), wide.points.get("energising time")
    points = [
        NamedPoint(name, None if rail is None else float(rail[i]), None if time is None else float(time[i]), str(i + 1))
        for i, name in enumerate(wide.names)
    ]
    samples = [within_window(read_samples(wide.table, name, model, at), model, at) for name in wide.names]
    return _average_shots(points, samples, at / "layout")
