"""Figures by matplotlib: the charts of the pages, drawn into axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import LogLocator, NullLocator

from commonrail.base.arrays import Floats
from commonrail.base.chart import Band, Bars, Boxes, Chart, Figure, HeatMap, Panel, Points, Series
from commonrail.base.errors import ConfigurationError
from commonrail.report.axis import INK
from commonrail.report.figure import DASHES, SIZES, colour_of, line_of, marker_style
from commonrail.report.heat_map import DIVERGING, SEQUENTIAL

POINTS = 0.75  # of a pixel of the pages


def draw(chart: Chart, ax: Axes | Sequence[Axes] | None = None) -> Any:
    """Draw a chart into axes, by default of a new figure; returns one `Axes`, or an array of them.

    A figure of several panels has axes for each; of fewer axes that are given, each gets the next panel from the top.

    Raises
    ------
    ConfigurationError
        If there are more axes than panels.
    """
    panels: Sequence[Panel | HeatMap] = chart.panels if isinstance(chart, Figure) else [chart]
    target: Any = ax
    if ax is None:
        shares = [panel.share if isinstance(panel, Panel) else 1.0 for panel in panels]
        height = 1.6 + 2.6 * sum(shares) / max(shares)
        _, target = pyplot.subplots(
            len(panels), figsize=(7.0, height), layout="constrained", sharex=True, height_ratios=shares, squeeze=False
        )
    axes: list[Axes] = list(np.atleast_1d(np.asarray(target, dtype=object)).ravel())
    if len(axes) > len(panels):
        raise ConfigurationError(
            f"The figure “{chart.title}” has {len(panels)} panels, and {len(axes)} axes were given; give one for each."
        )
    for panel_axes, panel in zip(axes, panels, strict=False):
        if isinstance(panel, HeatMap):
            _heat_map(panel_axes, panel)
        else:
            draw_panel(panel_axes, panel)
            if panel.has_legend and panel_axes.get_legend_handles_labels()[1]:
                panel_axes.legend(frameon=False, fontsize="small")
    axes[0].set_title(chart.title, loc="left", fontsize="medium")
    axes[-1].set_xlabel(chart.x_title)
    return axes[0] if len(axes) == 1 else np.array(axes, dtype=object)


def draw_panel(axes: Axes, panel: Panel, scale: float = POINTS) -> None:
    """Draw one panel without its legend; `scale` are points of a line's width by pixels of the pages."""
    for band in panel.bands:
        _band(axes, band)
    for boxes in panel.boxes:
        _boxes(axes, boxes, scale)
    slots = sorted({bars.slot for bars in panel.bars})
    for bars in panel.bars:
        _bars(axes, bars, slots.index(bars.slot), len(slots))
    for series in panel.series:
        _series(axes, series, scale)
    axes.set_ylabel(panel.y_title)
    if panel.logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(NullLocator())
    if panel.zero_line:
        axes.axhline(0.0, color=INK, linewidth=0.6, zorder=1)
    if panel.categories:
        axes.set_xticks(range(len(panel.categories)), panel.categories)
    if panel.rows:
        axes.set_yticks(range(len(panel.rows)), panel.rows)
        axes.set_ylim(len(panel.rows) - 0.5, -0.5)
    edges = [series.y for series in panel.series if series.look == panel.scaled_by]
    values = np.concatenate([_numbers(edge) for edge in edges] or [np.array([])])
    if panel.scaled_by and np.isfinite(values).any():
        low, high = np.nanmin(values), np.nanmax(values)
        room = 0.05 * (high - low) or 1.0
        axes.set_ylim(low - room, high + room)
    axes.set_axisbelow(True)


def _numbers(values: Points) -> Floats:
    return np.array(values, dtype=float)  # None becomes NaN: a gap


def _series(axes: Axes, series: Series, scale: float) -> None:
    colour, width, dash = line_of(series)
    style: dict[str, Any] = {"color": colour, "linestyle": "none", "label": series.label or "_nolegend_"}
    if "lines" in series.mode:
        pattern = tuple(float(length) / width for length in DASHES[dash].split()) if dash in DASHES else ()
        style |= {"linewidth": scale * width, "linestyle": (0, pattern) if pattern else "solid"}
    if "markers" in series.mode:
        _, cap, _, hollow = marker_style(series)
        style |= {"marker": "o" if cap == "round" else "s", "markersize": scale * SIZES[series.mode]}
        style |= {"markerfacecolor": "white" if hollow else colour, "zorder": 4}
    axes.plot(_numbers(series.x), _numbers(series.y), **style)
    if series.low and series.high:
        reach = np.stack([_numbers(series.y) - _numbers(series.low), _numbers(series.high) - _numbers(series.y)])
        x, y = _numbers(series.x), _numbers(series.y)
        axes.errorbar(x, y, yerr=reach, fmt="none", ecolor=colour, elinewidth=0.9, capsize=2.0)


def _band(axes: Axes, band: Band) -> None:
    colour = colour_of(band.look, band.family, band.ordered)
    x, low, high = (_numbers(values) for values in (band.x, band.low, band.high))
    axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0.0)


def _boxes(axes: Axes, boxes: Boxes, scale: float) -> None:
    """Median thin, extremes thick, as Fig. 5 of the paper."""
    colour = colour_of(boxes.look, None)
    names = ("whislo", "q1", "med", "q3", "whishi")
    widths = {"boxprops": 1.2, "whiskerprops": 1.2, "medianprops": 0.9, "capprops": 2.4}
    looks: dict[str, Any] = {artist: {"color": colour, "linewidth": scale * width} for artist, width in widths.items()}
    drawn = axes.bxp(
        [dict(zip(names, box, strict=True)) for box in boxes.boxes],
        positions=[i + boxes.offset for i in range(len(boxes.boxes))],
        widths=0.26,
        manage_ticks=False,
        showfliers=False,
        **looks,
    )
    drawn["boxes"][0].set_label(boxes.label)


def _bars(axes: Axes, bars: Bars, slot: int, slots: int) -> None:
    colour = colour_of(bars.look, None)
    start, end, thick = _numbers(bars.start), _numbers(bars.end), 0.8 / slots
    rows = np.arange(len(end)) - 0.4 + thick * (slot + 0.5)
    axes.barh(rows, end - start, thick, left=start, label=bars.label or "_nolegend_", color=colour, alpha=0.35)
    if bars.low and bars.high:
        reach = np.abs(np.stack([end - _numbers(bars.low), _numbers(bars.high) - end]))
        axes.errorbar(end, rows, xerr=reach, fmt="none", ecolor=INK, elinewidth=0.9, capsize=2.5)


def _heat_map(axes: Axes, chart: HeatMap) -> None:
    values = np.array([_numbers(row) for row in chart.values])
    top = chart.largest or float(np.nanmax(np.abs(values), initial=0.0)) or 1.0
    colours = LinearSegmentedColormap.from_list("commonrail", DIVERGING if chart.diverging else SEQUENTIAL)
    low = -top if chart.diverging else float(np.nanmin(values, initial=top))
    image = axes.imshow(values, cmap=colours, vmin=low, vmax=top, origin="lower", aspect="auto")
    for (i, j), _ in np.ndenumerate(values):
        axes.text(j, i, chart.texts[i][j], ha="center", va="center", fontsize="x-small", color=INK)
    axes.set_xticks(range(len(chart.x)), chart.x)
    axes.set_yticks(range(len(chart.y)), chart.y)
    axes.set_ylabel(chart.y_title)
    axes.figure.colorbar(image, ax=axes, label=chart.unit)
