"""Figures 4, 5 and 6 of the paper for print: the same charts as on the page, as SVG and PDF, by matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Sheet
from matplotlib.ticker import LogLocator, NullLocator

from commonrail.base.chart import MARKERS, Band, Boxes, Figure, Panel, Series

MM = 1.0 / 25.4  # inch
COLUMN, PAGE = 84.0, 174.0  # widths of print [mm]

# Told apart in grey by dash and width; the colours are those of the page.
_LOOKS: dict[str, dict[str, Any]] = {
    "measured": {"color": "#8a949e", "linewidth": 1.8},
    "rigid": {"color": "#b07d00", "linewidth": 0.9, "linestyle": (0, (4, 1.2, 1, 1.2))},
    "rigid fitted": {"color": "#8f4a7d", "linewidth": 0.9, "linestyle": (0, (7, 1.5, 1, 1.5))},
    "start": {"color": "#0072b2", "linewidth": 0.9, "linestyle": (0, (4, 1.5))},
    "best": {"color": "#c1272d", "linewidth": 0.9},
    "mean": {"color": "#0072b2", "linewidth": 0.9, "linestyle": (0, (4, 1.5))},
    "paper": {"color": "#00795c", "linewidth": 0.9},
    "level": {"color": "#6b7785", "linewidth": 0.8, "linestyle": (0, (1, 1.5))},
    "solid": {"color": "#3a3a3a", "linewidth": 0.8},
}
_STYLE: Any = {  # matplotlib's own type for it lists every key there is
    "font.size": 8.0,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters everywhere
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "text.parse_math": False,  # a label is a name, whatever signs it has
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
    _panel(axes, figure.panels[0])
    axes.set_xlabel(figure.x_title)
    sheet.legend(*_entries([axes]), loc="outside upper left", ncols=2)
    return sheet


def side_by_side(figures: Sequence[Figure], size: tuple[float, float]) -> Sheet:
    """One row for each figure, its two panels side by side, of a width and height [mm]."""
    sheet = _sheet(size)
    grid = sheet.subplots(len(figures), 2, squeeze=False, sharex=True)
    for row, figure in zip(grid, figures, strict=True):
        for axes, panel in zip(row, figure.panels, strict=True):
            _panel(axes, panel)
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
    found: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)


def _panel(axes: Axes, panel: Panel) -> None:
    for band in panel.bands:
        _band(axes, band)
    for boxes in panel.boxes:
        _boxes(axes, boxes)
    for series in panel.series:
        _series(axes, series)
    axes.set_ylabel(panel.y_title)
    if panel.logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(NullLocator())
    if panel.zero_line:
        axes.axhline(0.0, color="#1d2733", linewidth=0.6, zorder=1)
    if panel.categories:
        axes.set_xticks(range(len(panel.categories)), panel.categories)
    axes.set_axisbelow(True)


def _series(axes: Axes, series: Series) -> None:
    x, y = (np.array(values, dtype=float) for values in (series.x, series.y))  # None becomes NaN: a gap
    look = _LOOKS[series.look]
    label = series.label or "_nolegend_"
    if series.mode == MARKERS:
        marker = "_" if series.family is not None else "D"
        axes.plot(x, y, marker, color=look["color"], markersize=4.0, label=label, zorder=4)
    else:
        axes.plot(x, y, label=label, **look)


def _band(axes: Axes, band: Band) -> None:
    x, low, high = (np.array(values, dtype=float) for values in (band.x, band.low, band.high))
    axes.fill_between(x, low, high, color=_LOOKS[band.look]["color"], alpha=0.2, linewidth=0.0)


def _boxes(axes: Axes, boxes: Boxes) -> None:
    """Median thin, extremes thick, as the paper's Fig. 5."""
    colour = _LOOKS[boxes.look]["color"]
    names = ("whislo", "q1", "med", "q3", "whishi")
    drawn = axes.bxp(
        [dict(zip(names, box, strict=True)) for box in boxes.boxes],
        positions=[i + boxes.offset for i in range(len(boxes.boxes))],
        widths=0.26,
        manage_ticks=False,
        showfliers=False,
        boxprops={"color": colour, "linewidth": 0.8},
        whiskerprops={"color": colour, "linewidth": 0.8},
        medianprops={"color": colour, "linewidth": 0.6},
        capprops={"color": colour, "linewidth": 1.8},
    )
    drawn["boxes"][0].set_label(boxes.label)


def printed(sheets: Mapping[str, Callable[[], Sheet]]) -> dict[str, bytes]:
    """Sheets by name, made in the style of print, as files NAME.svg and NAME.pdf that are the same whenever made."""
    with mpl.rc_context(_STYLE):
        drawn = {name: make() for name, make in sheets.items()}
        return {f"{name}.{kind}": _file(sheet, kind) for name, sheet in drawn.items() for kind in _DATES}


_DATES = {"svg": "Date", "pdf": "CreationDate"}  # key of the date, which is left out


def _file(sheet: Sheet, kind: str) -> bytes:
    stream = BytesIO()
    sheet.savefig(stream, format=kind, metadata={_DATES[kind]: None, "Creator": "commonrail"})
    return stream.getvalue()
