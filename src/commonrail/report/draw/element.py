"""Elements of a page that show charts, drawn once and for all: a page shows them without any library."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from markupsafe import Markup

from commonrail.base.chart import Chart, Figure, HeatMap
from commonrail.report.draw.figure import NARROW, WIDE, figure_svg
from commonrail.report.draw.heat_map import heat_map_svg


def svg(figure: Chart, width: int = WIDE, height: int = 0, name: str = "") -> Markup:
    """Picture of a chart, of a size [px] and by default as high as it needs; `name` is a class of the element."""
    if isinstance(figure, HeatMap):
        return Markup(heat_map_svg(figure, width))
    return Markup(figure_svg(figure, width, height, name))


def figure_html(figure: Chart, key: str, height: int = 0) -> Markup:
    """Element that shows a chart, drawn for a page and for a telephone.

    The identifier `key` is unique within the page; the height [px] is by default what its panels or rows need.
    """
    kind = " heat" if isinstance(figure, HeatMap) else ""
    pictures = svg(figure, WIDE, height, "wide") + svg(figure, NARROW, round(0.75 * height), "narrow")
    return Markup('<div class="drawing{}" id="{}">{}</div>').format(kind, key, pictures)


def small_html(figure: Figure, key: str) -> Markup:
    """Element that shows a figure among others beside it, with the identifier `key`."""
    return Markup('<div class="drawing" id="{}">{}</div>').format(key, svg(figure, NARROW))


def drawings(figures: Iterable[Chart], height: int = 0, name: str = "figure") -> Sequence[tuple[Chart, Markup]]:
    """Charts with their elements, whose identifiers are the name and a number; `height` [px] as for `figure_html`."""
    return [(figure, figure_html(figure, f"{name}-{i}", height)) for i, figure in enumerate(figures)]
