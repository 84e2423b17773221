"""Results in a notebook: one line, tables, figures, data frames and named arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from commonrail.display.heat_map import HeatMap
from commonrail.display.table import Table
from commonrail.errors import ConfigurationError
from commonrail.report.draw import figure_svg
from commonrail.report.draw_map import heat_map_svg
from commonrail.report.html import render
from commonrail.report.presenter import Arrays, Drawn, presenter_of

__all__ = ["Picture", "dataset_of", "frame_of", "html_of", "line_of", "plot_of"]

MOST_ROWS = 24  # of a table in a notebook
MOST_FIGURES = 12
LONGEST = 100  # letters of a title within a line


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
        words = next(iter(presenter_of(result).lines(result)))
    except Exception:  # a result that is only half made
        return f"<{name}>"
    return f"<{name}: {words if len(words) <= 2 * LONGEST else words[: 2 * LONGEST] + '…'}>"


def html_of(result: Any) -> str:
    """Sentences and tables of a result."""
    shown = presenter_of(result)
    lines = "".join(f"<p>{escape(line)}</p>" for line in shown.lines(result))
    return f'<div class="commonrail">{lines}{"".join(map(_table_html, shown.tables(result)))}</div>'


def plot_of(result: Any) -> Picture:
    """Figures of a result.

    Raises
    ------
    ConfigurationError
        If there are none.
    """
    figures = list(presenter_of(result).figures(result))
    if not figures:
        raise ConfigurationError(
            f"A {type(result).__name__} of this kind has nothing to draw; its tables are its HTML."
        )
    shown = figures[:MOST_FIGURES]
    more = f", the first {MOST_FIGURES} of {len(figures)}" if len(figures) > MOST_FIGURES else ""
    return Picture(f"{next(iter(presenter_of(result).lines(result)))[:LONGEST]}{more}", shown)


def frame_of(result: Any) -> Any:
    """Values of a result as a pandas.DataFrame: a row for each place on its axes, the unit behind each name.

    A result that makes rows of its own has those, in SI units.

    Raises
    ------
    ConfigurationError
        If pandas is missing, or there are no values.
    """
    pandas = _library("pandas")
    if hasattr(result, "rows"):
        return pandas.DataFrame(result.rows())
    arrays = _arrays(result)
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
    make = presenter_of(result).arrays
    if make is None:
        raise ConfigurationError(
            f"A {type(result).__name__} has no table of values; read its attributes or its record()."
        )
    return make(result)


def _library(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise ConfigurationError(
            f"This needs {name}, which is not installed: install it with pip install 'commonrail[notebook]'."
        ) from error


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
