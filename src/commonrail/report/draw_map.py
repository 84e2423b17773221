"""Heat maps as SVG within HTML."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup, escape

from commonrail.display.heat_map import HeatMap
from commonrail.display.text import significant
from commonrail.report.draw import FONT, INK, WIDE, cut, text_width

__all__ = ["heat_map_html", "heat_map_svg"]

# Light enough throughout for dark numbers; they differ in lightness, so that they are told apart in grey too.
_SEQUENTIAL = ("#f7fbff", "#a6cde4", "#5b9fcd")
_DIVERGING = ("#5b9fcd", "#ffffff", "#e0907a")
NUMBERS = 9.5  # size of the numbers in the cells [px]
NARROWEST, BROADEST = 31.0, 84.0  # columns: narrower ones show no numbers [px]
LOWEST = 84.0  # map, whatever its rows: its vertical title has room [px]
SCALE, TALL = 58.0, 21.0  # width of the scale of colours with its numbers; height of a row, unless stated [px]
TOP, BELOW, RIGHT = 12.0, 40.0, 12.0


def heat_map_html(figure: HeatMap, key: str, height: int = 0) -> str:
    """Element of a page that shows a heat map; on a telephone it is moved sideways under the finger.

    Parameters
    ----------
    figure : HeatMap
    key : str
        Identifier, unique within the page.
    height : int
        [px]; by default a fixed one for each row.
    """
    drawn = Markup(heat_map_svg(figure, height))
    return Markup('<div class="drawing heat" id="{}" tabindex="0">{}</div>').format(key, drawn)


def heat_map_svg(figure: HeatMap, height: int = 0) -> str:
    """Picture of a heat map; `height` [px], by default a fixed one for each row."""
    rows, columns = len(figure.y), len(figure.x)
    left = max(map(text_width, figure.y), default=0.0) + 32.0
    cell = min((WIDE - left - SCALE - RIGHT) / max(columns, 1), BROADEST)
    tall = (height - TOP - BELOW) / max(rows, 1) if height else max(TALL, LOWEST / max(rows, 1))
    bottom = TOP + tall * rows
    parts = [
        _cell(figure, i, j, (left + cell * j, bottom - tall * (i + 1), cell, tall))
        for i in range(rows)
        for j in range(columns)
    ]
    names = [(left + cell * (j + 0.5), bottom + 15.0, "middle", name) for j, name in _column_names(figure.x, cell)]
    names += [(left - 6.0, bottom - tall * (i + 0.5) + 4.0, "end", name) for i, name in enumerate(figure.y)]
    names.append((left + cell * columns / 2, bottom + 33.0, "middle", figure.x_title))
    parts += [f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{at}">{escape(text)}</text>' for x, y, at, text in names]
    turned = f'transform="translate(13 {(TOP + bottom) / 2:.1f}) rotate(-90)" text-anchor="middle"'
    parts += [f"<text {turned}>{escape(figure.y_title)}</text>", _scale(figure, left + cell * columns + 10.0, bottom)]
    return (
        f'<svg class="figure map" viewBox="0 0 {WIDE} {round(bottom + BELOW)}" xmlns="http://www.w3.org/2000/svg" '
        f'font-family="{escape(FONT)}" font-size="11" fill="{INK}" role="img" aria-label="{escape(figure.title)}">'
        f"{''.join(parts)}</svg>"
    )


def _column_names(names: Sequence[str], width: float) -> list[tuple[int, str]]:
    """Names below columns of a width [px]: words are cut, and of numbers that do not fit only some are shown."""
    if not all(name[:1].isdigit() for name in names):
        return [(j, cut(name, width - 4.0)) for j, name in enumerate(names)]
    every = int(-(-max(map(text_width, names), default=1.0) // max(width - 4.0, 1.0)))
    return list(enumerate(names))[:: max(every, 1)]


def _cell(figure: HeatMap, i: int, j: int, place: tuple[float, float, float, float]) -> str:
    """Cell with its number, and with its place and number in words."""
    value, text = figure.values[i][j], figure.texts[i][j]
    if value is None and not text.strip():
        return ""
    x, y, width, height = place
    colour = "#ffffff" if value is None else _colour(figure, value)
    said = f"{figure.y_title} {figure.y[i]}; {figure.x_title} {figure.x[j]}: {text} {figure.unit}"
    shown = text if width >= min(NARROWEST, text_width(text)) else ""
    return (
        f'<g><title>{escape(said)}</title><rect x="{x + 0.5:.1f}" y="{y + 0.5:.1f}" width="{width - 1:.1f}" '
        f'height="{height - 1:.1f}" fill="{colour}"/><text x="{x + width / 2:.1f}" y="{y + height / 2 + 3.4:.1f}" '
        f'font-size="{NUMBERS}" text-anchor="middle">{escape(shown)}</text></g>'
    )


def _ends(figure: HeatMap) -> tuple[float, float]:
    """Values of the first and the last colour; of a difference as far from zero on both sides."""
    values = [v for row in figure.values for v in row if v is not None]
    if figure.diverging:
        largest = figure.largest or max(map(abs, values), default=1.0) or 1.0
        return -largest, largest
    low, high = min(values, default=0.0), max(values, default=1.0)
    return low, high if high > low else low + 1.0


def _colour(figure: HeatMap, value: float) -> str:
    low, high = _ends(figure)
    place = 2.0 * min(max((value - low) / (high - low), 0.0), 1.0)
    stops = _DIVERGING if figure.diverging else _SEQUENTIAL
    first = min(int(place), 1)
    pair = [[int(stop[k : k + 2], 16) for k in (1, 3, 5)] for stop in stops[first : first + 2]]
    return "#" + "".join(f"{round(a + (place - first) * (b - a)):02x}" for a, b in zip(*pair, strict=True))


def _scale(figure: HeatMap, x: float, bottom: float) -> str:
    """Colours from the lowest value to the highest, with their numbers, beside a map that ends at a place [px]."""
    low, high = _ends(figure)
    steps = 24
    tall = (bottom - TOP) / steps
    parts = [
        f'<rect x="{x:.1f}" y="{bottom - tall * (k + 1):.1f}" width="10" height="{tall + 0.5:.1f}" '
        f'fill="{_colour(figure, low + (k + 0.5) / steps * (high - low))}"/>'
        for k in range(steps)
    ]
    places = (TOP + 8.0, (TOP + bottom) / 2 + 4.0, bottom)
    for y, value in zip(places, (high, 0.5 * (low + high), low), strict=True):
        parts.append(f'<text x="{x + 13:.1f}" y="{y:.1f}">{significant(value, 3).replace("-", "−")}</text>')
    return "".join(parts)
