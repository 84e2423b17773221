"""Faces of results in a notebook: one line, tables, figures, data frames and named arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup, escape

from commonrail.analysis.sensitivity.result import Sensitivity
from commonrail.analysis.tolerance.result import ToleranceResult
from commonrail.calibration.comparison import Comparison
from commonrail.calibration.result import result_record
from commonrail.calibration.run import Calibration
from commonrail.calibration.study import Study
from commonrail.display.chart import Figure
from commonrail.display.heat_map import HeatMap
from commonrail.display.table import Table, tabulated
from commonrail.display.text import fixed, quantity, significant
from commonrail.engine.solution import Batch, Solution
from commonrail.errors import ConfigurationError
from commonrail.files.run_folder import rate_curves
from commonrail.injector.definition import Injector
from commonrail.kinds.base import DataSet
from commonrail.maps.quantity_map import InjectionMap
from commonrail.maps.sweep import Sweep
from commonrail.report.arrays import Arrays, arrays_of
from commonrail.report.draw import figure_svg
from commonrail.report.draw_map import heat_map_svg
from commonrail.report.error_map import error_maps
from commonrail.report.figures import convergence_figure, figures_of
from commonrail.report.html import render
from commonrail.report.map import map_figures, map_lines, map_tables
from commonrail.report.parameters import parameter_table
from commonrail.report.sensitivity import sensitivity_lines, sensitivity_tables
from commonrail.report.simulation import course_figure
from commonrail.report.sweep import sweep_figures, sweep_lines
from commonrail.report.tables import tables_of
from commonrail.report.tolerance import tolerance_lines, tolerance_tables

__all__ = ["Picture", "dataset_of", "frame_of", "html_of", "line_of", "plot_of"]

MICRO, MM3 = 1e6, 1e9
MOST_ROWS = 24  # of a table in a notebook
MOST_FIGURES = 12
LONGEST = 100  # letters of a title within a line

Drawn = Figure | HeatMap


class Face(NamedTuple):
    """Content that a notebook shows of one kind of result: sentences, the first being its line, tables, figures."""

    lines: Callable[[Any], Sequence[str]]
    tables: Callable[[Any], Sequence[Table]] = lambda _: ()
    figures: Callable[[Any], Sequence[Drawn]] = lambda _: ()


class Picture:
    """Figures of a result: a notebook shows them, `save` writes them as a page that needs no other file.

    Parameters
    ----------
    title : str
    figures : sequence of Figure or HeatMap
    """

    def __init__(self, title: str, figures: Sequence[Drawn]) -> None:
        self.title, self.figures = title, tuple(figures)

    def __repr__(self) -> str:
        """Title and number of figures."""
        return f"<Picture: {self.title}, {len(self.figures)} figure{'' if len(self.figures) == 1 else 's'}>"

    def _repr_html_(self) -> str:
        """Figures, drawn."""
        return "".join(map(_figure_html, self.figures))

    def save(self, path: str | Path) -> Path:
        """Write the figures as an HTML page; returns its path."""
        from commonrail.files.atomic import write_text

        path = Path(path)
        parts = [(figure, _svg(figure)) for figure in self.figures]
        write_text(path, render("picture.html", title=self.title, kind="Figures", synthetic=[], figures=parts))
        return path


def line_of(result: Any) -> str:
    """One line on a result, which never fails: it is what a debugger shows."""
    name = type(result).__name__
    try:
        words = next(iter(_face(result).lines(result)))
    except Exception:  # a result that is only half made
        return f"<{name}>"
    return f"<{name}: {words if len(words) <= 2 * LONGEST else words[: 2 * LONGEST] + '…'}>"


def html_of(result: Any) -> str:
    """Sentences and tables of a result."""
    face = _face(result)
    lines = "".join(f"<p>{escape(line)}</p>" for line in face.lines(result))
    return f'<div class="commonrail">{lines}{"".join(map(_table_html, face.tables(result)))}</div>'


def plot_of(result: Any) -> Picture:
    """Figures of a result.

    Raises
    ------
    ConfigurationError
        If there are none.
    """
    figures = list(_face(result).figures(result))
    if not figures:
        raise ConfigurationError(
            f"A {type(result).__name__} of this kind has nothing to draw; its tables are its HTML."
        )
    shown = figures[:MOST_FIGURES]
    more = f", the first {MOST_FIGURES} of {len(figures)}" if len(figures) > MOST_FIGURES else ""
    return Picture(f"{next(iter(_face(result).lines(result)))[:LONGEST]}{more}", shown)


def frame_of(result: Any) -> Any:
    """Values of a result as a pandas.DataFrame: a row for each place on its axes, the unit behind each name.

    Raises
    ------
    ConfigurationError
        If pandas is missing, or there are no values.
    """
    pandas, arrays = _library("pandas"), _arrays(result)
    axes = next(iter(arrays.values.values())).axes
    places = pandas.MultiIndex.from_product([arrays.axes[axis].values for axis in axes]).to_frame(index=False)
    places.columns = [_headed(axis, arrays.axes[axis].unit) for axis in axes]
    for name, array in arrays.values.items():
        if array.axes == axes:
            places[_headed(name, array.unit)] = array.values.reshape(-1)
    return places


def dataset_of(result: Any) -> Any:
    """Values of a result as an xarray.Dataset; units are in the attribute `units` of each array.

    Raises
    ------
    ConfigurationError
        If xarray is missing, or there are no values.
    """
    xarray, arrays = _library("xarray"), _arrays(result)
    made = {
        name: (array.axes, array.values, {"units": array.unit} if array.unit else {})
        for name, array in {**arrays.axes, **arrays.values}.items()
    }
    axes = {name: made.pop(name) for name in arrays.axes}
    return xarray.Dataset(made, axes, {"title": arrays.title})


def _headed(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _arrays(result: Any) -> Arrays:
    found = arrays_of(result)
    if found is None:
        raise ConfigurationError(
            f"A {type(result).__name__} has no table of values; read its attributes or its record()."
        )
    return found


def _library(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise ConfigurationError(
            f"This needs {name}, which is not installed: install it with pip install 'commonrail[notebook]'."
        ) from error


def _face(result: Any) -> Face:
    return next(face for kind, face in _FACES if isinstance(result, kind))


def _svg(figure: Drawn) -> Markup:
    return Markup(heat_map_svg(figure) if isinstance(figure, HeatMap) else figure_svg(figure))


def _figure_html(figure: Drawn) -> str:
    shown = Markup('<div style="max-width:860px;background:#fff"><b>{}</b>{}<small>{}</small></div>')
    return shown.format(figure.title, _svg(figure), figure.caption)


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


def _solution_lines(s: Solution) -> list[str]:
    return [
        f"{s.status.name}; {fixed(s.injected_volume, 2, MM3)} mm³ injected, {fixed(s.returned_volume, 2, MM3)} mm³ "
        f"returned; opens at {fixed(s.opening, 1, MICRO)} µs, closes at {fixed(s.closing, 1, MICRO)} µs"
    ]


def _batch_lines(batch: Batch) -> list[str]:
    candidates, points = batch.injected_mass.shape
    return [f"{candidates} candidates at {points} operating points, {int(batch.failed.sum())} simulations failed"]


def _injector_lines(injector: Injector) -> list[str]:
    lines = [f"{injector.name}, {injector.variant.label}, {len(injector.values)} parameters"]
    return lines + ([injector.synthetic] if injector.synthetic else [])


def _study_lines(study: Study) -> list[str]:
    names = ", ".join(data.name for data in study.data[:4]) + (", …" if len(study.data) > 4 else "")
    count = study.space.dimension
    return [f"“{study.title}”: {count} parameter{'' if count == 1 else 's'} of {study.injector.name}; data {names}"]


def _study_tables(study: Study) -> list[Table]:
    return [_free_table(study), _data_table(study.data)]


def _free_table(study: Study) -> Table:
    return tabulated(
        "Free parameters",
        study.space.parameters,
        [
            ("parameter", lambda p: p.name),
            ("start", lambda p: quantity(p.reference, p.unit)),
            ("lower", lambda p: quantity(p.lower, p.unit)),
            ("upper", lambda p: quantity(p.upper, p.unit)),
        ],
    )


def _data_table(data: Sequence[DataSet]) -> Table:
    return tabulated(
        "Data",
        data,
        [
            ("data set", lambda d: d.name),
            ("kind", lambda d: d.kind),
            ("role", lambda d: d.role.value),
            ("values", lambda d: str(len(d.measured))),
            ("points", lambda d: str(len(d.points))),
        ],
        "",
        3,
    )


def _calibration_lines(c: Calibration) -> list[str]:
    ending = f"; {c.convergence.sentence}" if c.convergence else ""
    fall = f"{significant(c.start_cost)} → {significant(c.cost)}"
    return [
        f"“{c.study.title[:LONGEST]}”: objective {fall}, {c.status}{ending}",
        *(str(finding.sentence) for finding in c.warnings),
    ]


def _calibration_tables(c: Calibration) -> list[Table]:
    record = result_record(c, {})
    return [parameter_table(record["parameters"]), *tables_of(record["data"], record["labels"])]


def _calibration_figures(c: Calibration) -> Iterator[Drawn]:
    record = result_record(c, {})
    traces = {
        curve.data: {"time_s": 0.5 * (curve.bounds[1:] + curve.bounds[:-1]), **curve.rates}
        for curve in rate_curves(c.study.data, c.scores)
    }
    yield from error_maps(record)
    yield from figures_of(record, traces)
    if len(record["generations"]) > 1:
        yield convergence_figure(record["generations"])


def _map_figures(found: InjectionMap) -> list[Drawn]:
    heats, curves = map_figures({found.injector.name: found})
    return [*heats, *curves]


_FACES: tuple[tuple[type, Face], ...] = (
    (Solution, Face(_solution_lines, figures=lambda s: [course_figure({"": s})])),
    (Batch, Face(_batch_lines)),
    (Injector, Face(_injector_lines)),
    (Study, Face(_study_lines, _study_tables)),
    (Calibration, Face(_calibration_lines, _calibration_tables, lambda c: list(_calibration_figures(c)))),
    (
        InjectionMap,
        Face(lambda m: map_lines({m.injector.name: m}), lambda m: map_tables({m.injector.name: m}), _map_figures),
    ),
    (Sweep, Face(sweep_lines, figures=sweep_figures)),
    (
        Sensitivity,
        Face(lambda s: [s.title, *sensitivity_lines(s.record())], lambda s: sensitivity_tables(s.record())),
    ),
    (
        ToleranceResult,
        Face(lambda t: [t.tolerances.title, *tolerance_lines(t.record())], lambda t: tolerance_tables(t.record())),
    ),
    (
        Comparison,
        Face(lambda c: [f"{len(c.models)} models on {len(c.data)} data sets: {', '.join(c.models)}"]),
    ),
)
