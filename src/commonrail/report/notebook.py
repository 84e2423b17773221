"""Results in a notebook: one line, tables, figures, data frames and named arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from commonrail.base import registry
from commonrail.base.arguments import instance, integer
from commonrail.base.chart import Chart
from commonrail.base.display import load_library
from commonrail.base.errors import ConfigurationError
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import count_noun, quantity, significant, to_fixed
from commonrail.calibration.record import CalibrationRecord, read_as
from commonrail.calibration.result import result_record
from commonrail.calibration.run import Calibration
from commonrail.calibration.study import Study
from commonrail.data.records import MICROSECOND, MM3
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch, Solution
from commonrail.physics.injector import Injector
from commonrail.report.figure import svg
from commonrail.report.fit.figures import convergence_figure, error_maps, figures_of
from commonrail.report.fit.tables import parameter_table, tables_of
from commonrail.report.html import render
from commonrail.report.presenter import Array, Arrays, Presenter, in_common_unit, presenter_of
from commonrail.runs.folder import rate_curves

# Presenters of simulations, injectors, studies and fits: what notebooks show of them.

LONGEST = 100  # letters of a title within a line


def _solution_lines(s: Solution) -> list[str]:
    return [
        f"{s.status.name}; {to_fixed(s.injected_volume, 2, MM3)} mm³ injected, {to_fixed(s.returned_volume, 2, MM3)} "
        f"mm³ returned; opens at {to_fixed(s.opening, 1, MICROSECOND)} µs, closes at "
        f"{to_fixed(s.closing, 1, MICROSECOND)} µs"
    ]


def _batch_lines(batch: Batch) -> list[str]:
    candidates, points = batch.injected_mass.shape
    return [f"{candidates} candidates at {points} operating points, {int(batch.failed.sum())} simulations failed"]


def _injector_lines(injector: Injector) -> list[str]:
    lines = [f"{injector.name}, {injector.variant.label}, {len(injector.values)} parameters"]
    return lines + ([injector.synthetic] if injector.synthetic else [])


def _study_lines(study: Study) -> list[str]:
    names = ", ".join(data.name for data in study.data[:4]) + (", …" if len(study.data) > 4 else "")
    parameters = count_noun(study.space.dimension, "parameter")
    return [f"“{study.title}”: {parameters} of {study.injector.name}; data {names}"]


def _study_tables(study: Study) -> list[Table]:
    free: list[Column] = [
        ("parameter", lambda p: p.name),
        ("start", lambda p: quantity(p.reference, p.unit)),
        ("lower", lambda p: quantity(p.lower, p.unit)),
        ("upper", lambda p: quantity(p.upper, p.unit)),
    ]
    data: list[Column] = [
        ("data set", lambda d: d.name),
        ("kind", lambda d: d.kind),
        ("role", lambda d: d.role.value),
        ("values", lambda d: str(len(d.measured))),
        ("points", lambda d: str(len(d.points))),
    ]
    return [
        table_from_columns("Free parameters", study.space.parameters, free),
        table_from_columns("Data", study.data, data, "", 3),
    ]


def _calibration_lines(c: Calibration) -> list[str]:
    ending = f"; {c.convergence.sentence}" if c.convergence else ""
    fall = f"{significant(c.start_cost)} → {significant(c.cost)}"
    return [
        f"“{c.study.title[:LONGEST]}”: objective {fall}, {c.status}{ending}",
        *(str(finding.sentence) for finding in c.warnings),
    ]


def _calibration_tables(c: Calibration) -> list[Table]:
    record = read_as(CalibrationRecord, result_record(c, {}))
    return [parameter_table(record.parameters), *tables_of(record.data, record.labels)]


def _calibration_figures(c: Calibration) -> Iterator[Chart]:
    record = read_as(CalibrationRecord, result_record(c, {}))
    traces = {curve.data: curve.trace for curve in rate_curves(c.study.data, c.scores)}
    yield from error_maps(record.data)
    yield from figures_of(record.data, record.labels, traces)
    if len(record.generations) > 1:
        yield convergence_figure(record.generations)


_CHANNELS = {"lift": "m", "pressure": "Pa", "current": "A", "force": "N", "coefficient": "1"}


def _solution_arrays(solution: Solution) -> Arrays:
    """Arrays at the middles of the samples; a channel is the mean of the values at both bounds."""
    values = {"rate": in_common_unit(("time",), solution.rate, "m3/s")}
    for name, channel in solution.channels.items():
        unit = next((u for ending, u in _CHANNELS.items() if name.endswith(ending)), "")
        values[name] = in_common_unit(("time",), 0.5 * (channel[1:] + channel[:-1]), unit)
    return Arrays({"time": in_common_unit(("time",), solution.rate_time, "s")}, values, "Course of an injection")


def _batch_arrays(batch: Batch) -> Arrays:
    axes = ("candidate", "point")
    sizes = zip(axes, batch.injected_mass.shape, strict=True)
    values = {
        "injected_volume": in_common_unit(axes, batch.injected_volume, "m3"),
        "returned_volume": in_common_unit(axes, batch.returned_volume, "m3"),
        **{name: in_common_unit(axes, getattr(batch, name), "s") for name in ("opening", "closing", "first_closing")},
        "greatest_lift": in_common_unit(axes, batch.greatest_lift, "m"),
        "status": Array(axes, batch.status),
    }
    return Arrays({name: Array((name,), np.arange(size)) for name, size in sizes}, values, "Figures of injections")


def _calibration_arrays(calibration: Calibration) -> Arrays:
    arrays = _study_arrays(calibration.study)
    best = _by_parameter([calibration.best[name] for name in calibration.study.space.names])
    return arrays._replace(values={"calibrated": best, **arrays.values})


def _study_arrays(study: Study) -> Arrays:
    """Free parameters in SI units."""
    attributes = {"start": "reference", "lower": "lower", "upper": "upper", "unit": "unit"}
    parameters = study.space.parameters
    values = {key: _by_parameter([getattr(p, name) for p in parameters]) for key, name in attributes.items()}
    return Arrays({"parameter": _by_parameter(study.space.names)}, values, study.title)


def _injector_arrays(injector: Injector) -> Arrays:
    values = {
        "value": _by_parameter(list(injector.values.values())),
        "unit": _by_parameter([injector.quantities[name].unit for name in injector.values]),
        "meaning": _by_parameter([injector.quantities[name].meaning for name in injector.values]),
    }
    return Arrays({"parameter": _by_parameter(list(injector.values))}, values, injector.title)


def _by_parameter(values: Sequence[Any]) -> Array:
    return Array(("parameter",), np.array(values))


SOLUTION = Presenter(_solution_lines, arrays=_solution_arrays)
BATCH = Presenter(_batch_lines, arrays=_batch_arrays)
INJECTOR = Presenter(_injector_lines, arrays=_injector_arrays)
STUDY = Presenter(_study_lines, _study_tables, arrays=_study_arrays)
CALIBRATION = Presenter(
    _calibration_lines, _calibration_tables, lambda c: list(_calibration_figures(c)), _calibration_arrays
)


MOST_ROWS = 24  # of a table in a notebook
MOST_FIGURES = 12


class Picture:
    """Figures of a result: a notebook shows them, `save` writes them as a page that needs no other file."""

    def __init__(self, title: str, figures: Sequence[Chart], beside: str = "") -> None:
        self.title, self.figures, self.beside = title, tuple(figures), beside

    def __repr__(self) -> str:
        """Title and number of figures."""
        return f"<Picture: {self.title}, {count_noun(len(self.figures), 'figure')}>"

    def _repr_html_(self) -> str:
        """Figures, drawn, and the HTML after them."""
        return "".join([*map(_figure_html, self.figures), self.beside])

    def save(self, path: str | Path) -> Path:
        """Write the figures as an HTML page; returns its path."""
        from commonrail.base.output import write_text

        path = Path(path)
        parts = [(figure, svg(figure)) for figure in self.figures]
        values: dict[str, Any] = {"title": self.title, "figures": parts, "beside": Markup(self.beside)}
        write_text(path, render("picture.html", kind="Figures", synthetic=[], **values))
        return path


def line_of(result: Any) -> str:
    """One line on a result; never raises, because debuggers call it."""
    name = type(result).__name__
    try:
        words = next(iter(presenter_of(result).lines(result)))
    except Exception:  # a result that is only half made
        return f"<{name}>"
    return f"<{name}: {words if len(words) <= 2 * LONGEST else words[: 2 * LONGEST] + '…'}>"


def html_of(result: Any) -> str:
    """Sentences and tables of a result."""
    shown = presenter_of(result)
    lines = "".join(f"<p>{escape(line)}</p>" for line in shown.lines(result))
    return f'<div class="commonrail">{lines}{"".join(map(_table_html, shown.tables(result)))}</div>'


def charts_of(result: Any, point: OperatingPoint | None = None) -> list[Chart]:
    """Figures of a result as plain numbers; errors as of `picture_of`."""
    if isinstance(result, Solution):
        point = instance(point, OperatingPoint | None, "point") or result.point
        return [registry.require("simulations", "figure").call(result, point)]
    if point is not None:
        raise ConfigurationError(f"A {type(result).__name__} has no point; omit it.")
    if not (figures := list(presenter_of(result).figures(result))):
        raise ConfigurationError(
            f"A {type(result).__name__} of this kind has nothing to draw; its tables are its HTML."
        )
    return figures


def draw_of(result: Any, ax: Any = None, figure: int = 0, point: OperatingPoint | None = None) -> Any:
    """Axes with one figure of a result, drawn by matplotlib; errors as of `Shown.plot`."""
    charts = charts_of(result, point)
    number = integer(figure, "figure", 0)
    if number >= len(charts):
        titles = ", ".join(f"{i} (“{chart.title}”)" for i, chart in enumerate(charts))
        raise ConfigurationError(f"This {type(result).__name__} has no figure {number}; it has {titles}.")
    load_library("matplotlib")
    from commonrail.report.plot import draw

    return draw(charts[number], ax)


def picture_of(result: Any, point: OperatingPoint | None = None) -> Picture:
    """Figures of a result; for a simulation, also a section of the injector, at its own point or at `point`.

    ConfigurationError without figures, or if a result that is not a simulation gets a point.
    """
    figures, beside = charts_of(result, point), ""
    if isinstance(result, Solution):
        beside = registry.require("simulations", "section").call(result, point or result.point)
    shown = figures[:MOST_FIGURES]
    more = f", the first {MOST_FIGURES} of {len(figures)}" if len(figures) > MOST_FIGURES else ""
    return Picture(f"{next(iter(presenter_of(result).lines(result)))[:LONGEST]}{more}", shown, beside)


def frame_of(result: Any) -> Any:
    """Values of a result as a pandas.DataFrame: a row for each place on its axes, the unit after each name.

    A result with a method `rows` gives these rows, in SI units. ConfigurationError if pandas is missing, or there are
    no values.
    """
    pandas = load_library("pandas")
    if hasattr(result, "rows"):
        return pandas.DataFrame(result.rows())
    arrays = _arrays(result)
    axes = next(iter(arrays.values.values())).axes
    places = pandas.MultiIndex.from_product([arrays.axes[axis].values for axis in axes]).to_frame(index=False)
    places.columns = [_column_name(axis, arrays.axes[axis].unit) for axis in axes]
    for name, array in arrays.values.items():
        if array.axes == axes:
            places[_column_name(name, array.unit)] = array.values.reshape(-1)
    return places


def dataset_of(result: Any) -> Any:
    """Values of a result as an xarray.Dataset; units are in the attribute `units` of each array.

    ConfigurationError if xarray is missing, or there are no values.
    """
    xarray, arrays = load_library("xarray"), _arrays(result)
    variables = {
        name: (array.axes, array.values, {"units": array.unit} if array.unit else {})
        for name, array in {**arrays.axes, **arrays.values}.items()
    }
    axes = {name: variables.pop(name) for name in arrays.axes}
    return xarray.Dataset(variables, axes, {"title": arrays.title})


def _column_name(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _arrays(result: Any) -> Arrays:
    make = presenter_of(result).arrays
    if make is None:
        raise ConfigurationError(
            f"A {type(result).__name__} has no table of values; read its attributes or its record()."
        )
    return make(result)


def _figure_html(figure: Chart) -> str:
    shown = Markup('<div style="max-width:860px;background:#fff;color:#1d2733"><b>{}</b>{}<small>{}</small></div>')
    return shown.format(figure.title, svg(figure), figure.caption)


def _table_html(table: Table) -> str:
    rows = table.rows[:MOST_ROWS]
    head = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    body = "".join(
        "<tr>"
        + "".join(
            f'<td style="text-align:{"left" if i < table.texts else "right"}">{escape(cell.plain)}</td>'
            for i, cell in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    more = len(table.rows) - len(rows)
    note = f"{more} more rows are in the report. {table.note}" if more else table.note
    return f"<h4>{escape(table.title)}</h4><table><tr>{head}</tr>{body}</table><small>{escape(note)}</small>"
