"""Heat maps as HTML."""

from __future__ import annotations

from html import escape
from typing import Any

import plotly.graph_objects as go

from commonrail.display.heat_map import HeatMap
from commonrail.report.draw import canvas_html, page_layout

__all__ = ["heat_map_html"]

# Light enough throughout for dark numbers; they differ in lightness, so that they are told apart in grey too.
_SEQUENTIAL = [[0.0, "#f7fbff"], [0.5, "#a6cde4"], [1.0, "#5b9fcd"]]
_DIVERGING = [[0.0, "#5b9fcd"], [0.5, "#ffffff"], [1.0, "#e0907a"]]


def heat_map_html(figure: HeatMap, key: str, height: int = 560) -> str:
    """Element of a page that shows a heat map, without plotly's script.

    Parameters
    ----------
    figure : HeatMap
    key : str
        Identifier, unique within the page.
    height : int
        [px].
    """
    canvas = go.Figure(
        go.Heatmap(
            x=list(figure.x),
            y=list(figure.y),
            z=[list(row) for row in figure.values],
            text=[[escape(text, quote=False) for text in row] for row in figure.texts],
            texttemplate="%{text}",
            textfont={"size": 9.5, "color": "#1d2733"},
            colorscale=_DIVERGING if figure.diverging else _SEQUENTIAL,
            colorbar={"title": {"text": escape(figure.unit, quote=False)}, "thickness": 12},
            hovertemplate="%{x}, %{y}: %{text}<extra></extra>",
            xgap=1,
            ygap=1,
            **_range(figure),
        )
    )
    canvas.update_xaxes(title_text=escape(figure.x_title, quote=False), type="category", showgrid=False)
    canvas.update_yaxes(title_text=escape(figure.y_title, quote=False), type="category", showgrid=False)
    canvas.update_layout(page_layout(height) | {"margin": {"l": 64, "r": 10, "t": 10, "b": 46}})
    return canvas_html(canvas, key)


def _range(figure: HeatMap) -> dict[str, Any]:
    """Range of the colours of a difference: the same on both sides of zero."""
    if not figure.diverging:
        return {}
    largest = max((abs(v) for row in figure.values for v in row if v is not None), default=1.0) or 1.0
    return {"zmin": -largest, "zmax": largest}
