"""Figures 4, 5 and 6 of the paper for print: the same charts as on the page, as SVG and PDF, by matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Sheet

from commonrail.base.chart import Figure
from commonrail.report.plot import draw_panel

MM = 1.0 / 25.4  # inch
COLUMN, PAGE = 84.0, 174.0  # widths of print [mm]

THIN = 0.5  # line width in points per pixel of the pages
_STYLE: Any = {  # matplotlib's own type for it lists every key there is
    "font.size": 8.0,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters everywhere
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "text.parse_math": False,  # labels are plain names, even with a dollar sign
    "grid.color": "#e3e7eb",
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.fontsize": 7.0,
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "commonrail",  # with it, and without dates, the same figure gives the same file
}


def single(figure: Figure, size: tuple[float, float]) -> Sheet:
    """One panel, of a width and height [mm]."""
    sheet = _sheet(size)
    axes = sheet.subplots()
    draw_panel(axes, figure.panels[0], THIN)
    axes.set_xlabel(figure.x_title)
    sheet.legend(*_entries([axes]), loc="outside upper left", ncols=2)
    return sheet


def side_by_side(figures: Sequence[Figure], size: tuple[float, float]) -> Sheet:
    """One row for each figure, its two panels side by side, of a width and height [mm]."""
    sheet = _sheet(size)
    grid = sheet.subplots(len(figures), 2, squeeze=False, sharex=True)
    for row, figure in zip(grid, figures, strict=True):
        for axes, panel in zip(row, figure.panels, strict=True):
            draw_panel(axes, panel, THIN)
        row[0].set_title(figure.title, fontsize=8.0, loc="left")
    for axes in grid[-1]:
        axes.set_xlabel(figures[-1].x_title)
    sheet.legend(*_entries([grid[0, 0]]), loc="outside upper left", ncols=3)
    return sheet


def _sheet(size: tuple[float, float]) -> Sheet:
    sheet = Sheet(figsize=(size[0] * MM, size[1] * MM), layout="constrained")
    sheet.supxlabel(
        "synthetic data: virtual test bench of commonrail", fontsize=6.0, color="#586472", x=0.99, ha="right"
    )
    return sheet


def _entries(panels: Sequence[Axes]) -> tuple[list[Any], list[str]]:
    """Handles and texts of a legend, each text once."""
    handles: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    return list(handles.values()), list(handles)


def print_sheets(sheets: Mapping[str, Callable[[], Sheet]]) -> dict[str, bytes]:
    """Sheets by name, made in the style of print, as files NAME.svg and NAME.pdf that are the same whenever made."""
    with mpl.rc_context(_STYLE):
        drawn = {name: make() for name, make in sheets.items()}
        return {f"{name}.{kind}": _file(sheet, kind) for name, sheet in drawn.items() for kind in _DATES}


_DATES = {"svg": "Date", "pdf": "CreationDate"}  # key of the date, which is left out


def _file(sheet: Sheet, kind: str) -> bytes:
    stream = BytesIO()
    sheet.savefig(stream, format=kind, metadata={_DATES[kind]: None, "Creator": "commonrail"})
    return stream.getvalue()
