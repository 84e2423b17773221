"""Figures as HTML: the only file that knows plotly."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape
from typing import Any

import plotly.graph_objects as go
import plotly.io as pio
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from commonrail.display.chart import Band, Bars, Boxes, Figure, Panel, Series

__all__ = ["canvas_html", "draw", "drawings", "figure_html", "page_layout", "plotly_script"]

INK, SOFT, GRID = "#1d2733", "#586472", "#e3e7eb"
ROUNDING = 1e-9  # of the largest value; differences of sums of doubles stay below
FONT = "system-ui, -apple-system, 'Segoe UI', 'Liberation Sans', Arial, sans-serif"

# Told apart in grey by dash and width, and by the colour-blind (Okabe and Ito's palette).
_LOOKS: dict[str, dict[str, Any]] = {
    "measured": {"color": "#6b7785", "width": 3.0},
    "rigid": {"color": "#b07d00", "width": 1.4, "dash": "dot"},
    "rigid fitted": {"color": "#8f4a7d", "width": 1.4, "dash": "longdashdot"},
    "start": {"color": "#0072b2", "width": 1.6, "dash": "dash"},
    "best": {"color": "#c1272d", "width": 1.8},
    "mean": {"color": "#0072b2", "width": 1.6, "dash": "dash"},
    "paper": {"color": "#00795c", "width": 1.6, "dash": "dashdot"},
    "level": {"color": "#6b7785", "width": 1.2, "dash": "dot"},
}
_FAMILY_LINES: dict[str, dict[str, Any]] = {
    "start": {"width": 1.2, "dash": "dot"},
    "best": {"width": 1.8},
    "measured": {"width": 1.8},
}
_FAMILIES = (
    "#0072b2",
    "#d55e00",
    "#00795c",
    "#8f4a7d",
    "#7a6a00",
    "#3a3a3a",
    "#5b8fb9",
    "#a6312b",
)
_MARKERS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "cross", "x")

# The buttons are named one by one: plotly's own choice holds one that sends the data to its cloud.
_CONFIG = {
    "displaylogo": False,
    "displayModeBar": "hover",
    "responsive": True,
    "plotlyServerURL": "",
    "showSendToCloud": False,
    "modeBarButtons": [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
}


def plotly_script() -> str:
    """Plotly's own script, to be put into a page once."""
    script: str = get_plotlyjs()
    return script


def figure_html(figure: Figure, key: str, height: int = 0) -> str:
    """Element of a page that shows a figure, without plotly's script.

    Parameters
    ----------
    figure : Figure
    key : str
        Identifier, unique within the page.
    height : int
        [px]; by default what its panels need.
    """
    return canvas_html(draw(figure, height or 300 + 110 * (len(figure.panels) - 1)), key)


def canvas_html(canvas: go.Figure, key: str) -> str:
    """Element of a page that shows a plotly figure, with the identifier `key`."""
    fragment: str = pio.to_html(canvas, config=_CONFIG, include_plotlyjs=False, full_html=False, div_id=key)
    return fragment


def drawings(figures: Iterable[Figure], height: int = 0) -> list[tuple[Figure, str]]:
    """Figures with their elements of a page, which are numbered; `height` [px] as for `figure_html`."""
    return [(figure, figure_html(figure, f"figure-{i}", height)) for i, figure in enumerate(figures)]


def _plain(text: str) -> str:
    """Text as plotly shows it unchanged: it reads tags and a few entities, but not that of a quotation mark."""
    return escape(text, quote=False)


def draw(figure: Figure, height: int) -> go.Figure:
    """Plotly figure of a `Figure`, panels above one another."""
    count = len(figure.panels)
    canvas = make_subplots(
        rows=count,
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.05,
        row_heights=[panel.share for panel in figure.panels],
    )
    for row, panel in enumerate(figure.panels, start=1):
        for trace in _traces(panel):
            canvas.add_trace(trace, row=row, col=1)
        canvas.update_yaxes(_y_axis(panel), row=row, col=1)
        if panel.categories:
            names = [_plain(name) for name in panel.categories]
            canvas.update_xaxes(tickvals=list(range(len(names))), ticktext=names, row=row, col=1)
        if panel.rows:
            canvas.update_yaxes(_rows(panel.rows), row=row, col=1)
    canvas.update_xaxes(showgrid=True, gridcolor=GRID, linecolor=INK, ticks="outside", zeroline=False)
    canvas.update_xaxes(title_text=_plain(figure.x_title), row=count, col=1)
    canvas.update_layout(page_layout(height))
    return canvas


def _traces(panel: Panel) -> list[Any]:
    """Bands behind, boxes and bars, then lines and markers."""
    bands = [edge for band in panel.bands for edge in _edges(band)]
    solid = [*(_boxes(boxes) for boxes in panel.boxes), *(_bars(bars) for bars in panel.bars)]
    return [*bands, *solid, *(_trace(series) for series in panel.series)]


def _edges(band: Band) -> list[go.Scatter]:
    """Lower edge, and upper edge with what lies between them filled."""
    shared: dict[str, Any] = {"x": band.x, "mode": "lines", "line": {"width": 0}, "showlegend": False}
    group = band.look if band.family is None else f"family {band.family}"
    shared |= {"hoverinfo": "skip", "legendgroup": group}
    colour = _LOOKS[band.look]["color"] if band.family is None else _FAMILIES[band.family % len(_FAMILIES)]
    fill = _faint(colour)
    return [go.Scatter(y=band.low, **shared), go.Scatter(y=band.high, fill="tonexty", fillcolor=fill, **shared)]


def _boxes(boxes: Boxes) -> go.Box:
    low, q1, median, q3, high = zip(*boxes.boxes, strict=True)
    colour = _LOOKS[boxes.look]["color"]
    return go.Box(
        x=[i + boxes.offset for i in range(len(median))],
        lowerfence=low,
        q1=q1,
        median=median,
        q3=q3,
        upperfence=high,
        name=_plain(boxes.label),
        legendgroup=boxes.label,
        marker={"color": colour},
        line={"color": colour, "width": 1.4},
        fillcolor=_faint(colour),
        width=0.26,
        whiskerwidth=0.9,
    )


def _bars(bars: Bars) -> go.Bar:
    """Bars as lengths from their starts, as plotly takes them."""
    colour = _LOOKS[bars.look]["color"]
    lengths = [None if a is None or b is None else b - a for a, b in zip(bars.start, bars.end, strict=True)]
    interval = {
        "type": "data",
        "symmetric": False,
        "array": [_distance(high, end) for end, high in zip(bars.end, bars.high or bars.end, strict=True)],
        "arrayminus": [_distance(end, low) for end, low in zip(bars.end, bars.low or bars.end, strict=True)],
        "color": INK,
        "thickness": 1.2,
        "width": 3,
    }
    return go.Bar(
        x=lengths,
        base=[0.0 if a is None else a for a in bars.start],
        y=list(range(len(lengths))),
        orientation="h",
        offsetgroup=str(bars.slot),
        name=_plain(bars.label),
        marker={"color": _faint(colour), "line": {"color": colour, "width": 1.2}},
        error_x=interval if bars.high else {"visible": False},
    )


def _distance(high: float | None, low: float | None) -> float:
    return 0.0 if high is None or low is None else max(high - low, 0.0)


def _rows(rows: tuple[str, ...]) -> dict[str, Any]:
    """Vertical axis with a name for each row, the first at the top."""
    names = [_plain(name) for name in rows]
    return {
        "tickvals": list(range(len(names))),
        "ticktext": names,
        "range": [len(names) - 0.5, -0.5],
        "showgrid": False,
        "ticks": "",
    }


def _faint(colour: str) -> str:
    """A colour of six hexadecimal digits, three quarters transparent."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.22)"


def _trace(series: Series) -> go.Scatter:
    line = _line(series)
    symbol = _MARKERS[(series.family or 0) % len(_MARKERS)]
    return go.Scatter(
        x=series.x,
        y=series.y,
        name=_plain(series.label),
        showlegend=bool(series.label),
        mode=series.mode,
        line=line,
        marker={
            "color": line["color"],
            "symbol": symbol,
            "size": 5 if "lines" in series.mode else 8,
        },
        # Clicking "start values" in the legend hides the curve and its error alike.
        legendgroup=series.look if series.family is None else f"family {series.family}",
        connectgaps=False,
    )


def _line(series: Series) -> dict[str, Any]:
    if series.family is None:
        return _LOOKS[series.look]
    colour = _FAMILIES[series.family % len(_FAMILIES)]
    return {"color": colour, **_FAMILY_LINES.get(series.look, {"width": 1.6, "dash": series.look})}


def _log_ticks(panel: Panel) -> list[float]:
    """1, 2 and 5 times the powers of ten; plotly writes 20 and 200 both as "2"."""
    values = [v for series in panel.series for v in series.y if v is not None and v > 0.0] or [1.0]
    decades = range(math.floor(math.log10(min(values))), math.ceil(math.log10(max(values))) + 1)
    return [digit * 10.0**decade for decade in decades for digit in (1, 2, 5)]


def _around_a_constant(panel: Panel) -> dict[str, list[float]]:
    """Range about lines that are constant but for rounding: plotly would span the rounding, and write no ticks."""
    values = [v for series in panel.series for v in series.y if v is not None]
    if panel.bands or panel.boxes or not values:
        return {}
    size = max(abs(v) for v in values)
    constant = size > 0.0 and max(values) - min(values) <= ROUNDING * size
    return {"range": [min(values) - 0.05 * size, max(values) + 0.05 * size]} if constant else {}


def _y_axis(panel: Panel) -> dict[str, Any]:
    ticks = {"tickvals": _log_ticks(panel)} if panel.logarithmic else _around_a_constant(panel)
    return {
        **ticks,
        "title": {"text": _plain(panel.y_title), "standoff": 6},
        "type": "log" if panel.logarithmic else "linear",
        "gridcolor": GRID,
        "linecolor": INK,
        "ticks": "outside",
        "zeroline": panel.zero_line,
        "zerolinecolor": INK,
        "zerolinewidth": 1,
        "automargin": True,
    }


def page_layout(height: int) -> dict[str, Any]:
    """Layout that all figures of a page share; `height` [px]."""
    return {
        "template": "none",
        "height": height,
        "autosize": True,
        "font": {"family": FONT, "size": 12.5, "color": INK},
        "margin": {"l": 54, "r": 10, "t": 34, "b": 46},
        "hovermode": "closest",
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": SOFT, "activecolor": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "#ffffff",
        "legend": {
            "orientation": "h",
            "x": 0,
            "xanchor": "left",
            "y": 1.02,
            "yanchor": "bottom",
            "font": {"size": 12.5},
        },
    }
