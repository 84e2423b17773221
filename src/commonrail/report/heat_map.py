"""Heat maps as SVG within HTML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from markupsafe import escape

from commonrail.base.chart import HeatMap
from commonrail.base.text import significant
from commonrail.report.axis import FONT, INK, LONGEST, SIZE, WIDE, shorten, text_width, upright

# Light enough throughout for dark numbers; they differ in lightness, so they differ in grey too.
SEQUENTIAL = ("#f7fbff", "#a6cde4", "#5b9fcd")
DIVERGING = ("#5b9fcd", "#ffffff", "#e0907a")
NUMBERS = 9.5  # size of the numbers in the cells [px]
NARROWEST, BROADEST = 31.0, 84.0  # columns: narrower ones show no numbers [px]
LOWEST = 84.0  # map, whatever its rows: its vertical title is not cut [px]
SCALE, TALL = 58.0, 21.0  # room of the scale of colours with its numbers; height of a row [px]
TOP, BELOW, RIGHT = 12.0, 40.0, 12.0
SMALLEST = 7.0  # numbers in the cells on a telephone; smaller ones are shown by a tap [px]


class _Frame(NamedTuple):
    """Places of a map [px]: width of the picture, left edge and bottom of its cells, their size, room below them."""

    width: float
    left: float
    bottom: float
    cell: float
    tall: float
    below: float

    @property
    def is_narrow(self) -> bool:
        """True for the picture on a telephone, whose scale lies below the map."""
        return self.width < WIDE


def heat_map_svg(figure: HeatMap, width: int = WIDE) -> str:
    """Picture of a heat map, of a width [px].

    A narrow picture has its scale of colours below the map.
    """
    frame = _frame(figure, float(width))
    size = _number_size(figure, frame)
    cells = [
        _cell(figure, (i, j), _place(frame, i, j), frame.is_narrow, size)
        for i in range(len(figure.y))
        for j in range(len(figure.x))
    ]
    parts = [f'<g class="cells" font-size="{size:.3g}" text-anchor="middle">{"".join(cells)}</g>']
    parts += _names(figure, frame)
    middle = TOP + 0.5 * (frame.bottom - TOP)
    turned = f'transform="translate(13 {middle:.1f}) rotate(-90)" text-anchor="middle"'
    parts += [f"<text {turned}>{escape(figure.y_title)}</text>", _scale(figure, frame)]
    total, name = round(frame.bottom + frame.below), "narrow" if frame.is_narrow else "wide"
    return (
        f'<svg class="figure map {name}" viewBox="0 0 {width} {total}" xmlns="http://www.w3.org/2000/svg" '
        f'font-family="{escape(FONT)}" font-size="11" fill="{INK}" role="img" aria-label="{escape(figure.title)}">'
        f"{''.join(parts)}</svg>"
    )


def _frame(figure: HeatMap, width: float) -> _Frame:
    rows, columns, narrow = max(len(figure.y), 1), max(len(figure.x), 1), width < WIDE
    left = max(map(text_width, figure.y), default=0.0) + 32.0
    left = min(left, 0.45 * width) if narrow else left
    cell = min((width - left - (0.0 if narrow else SCALE) - RIGHT) / columns, BROADEST)
    below = BELOW + _upright(figure.x, cell) + (34.0 if narrow else 0.0)
    tall = max(TALL, LOWEST / rows)
    return _Frame(width, left, TOP + tall * rows, cell, tall, below)


def _place(frame: _Frame, i: int, j: int) -> tuple[float, float, float, float]:
    """Left, top, width and height of a cell [px]."""
    return frame.left + frame.cell * j, frame.bottom - frame.tall * (i + 1), frame.cell, frame.tall


def _upright(names: Sequence[str], width: float) -> float:
    """Room for upright words below columns of a width [px]; numbers are never upright."""
    return 0.0 if _are_numbers(names) else upright(names, width)


def _are_numbers(names: Sequence[str]) -> bool:
    return all(name[:1].isdigit() for name in names)


def _number_size(figure: HeatMap, frame: _Frame) -> float:
    """Size of the numbers in the cells [px]: smaller in the narrow columns of a telephone, 0 where they do not fit."""
    longest = max((text_width(text) for row in figure.texts for text in row), default=0.0) / SIZE
    if not frame.is_narrow:
        return NUMBERS
    fitting = min((frame.cell - 2.0) / max(longest, 1.0), NUMBERS)
    return fitting if fitting >= SMALLEST else 0.0


def _names(figure: HeatMap, frame: _Frame) -> list[str]:
    """Names of rows and columns, and the title below the columns."""
    bottom, turned = frame.bottom, _upright(figure.x, frame.cell)
    texts = []
    for j, name in enumerate(figure.x) if turned else _column_names(figure.x, frame.cell):
        x = frame.left + frame.cell * (j + 0.5)
        if turned:
            at = f'transform="translate({x + 4.0:.1f} {bottom + 6.0:.1f}) rotate(-90)" text-anchor="end"'
            texts.append(f"<text {at}>{escape(shorten(name, LONGEST))}</text>")
        else:
            texts.append(f'<text x="{x:.1f}" y="{bottom + 15.0:.1f}" text-anchor="middle">{escape(name)}</text>')
    for i, name in enumerate(figure.y):
        y = bottom - frame.tall * (i + 0.5) + 4.0
        short = shorten(name, frame.left - 32.0) if frame.is_narrow else name
        texts.append(f'<text x="{frame.left - 6.0:.1f}" y="{y:.1f}" text-anchor="end">{escape(short)}</text>')
    x, y = frame.left + frame.cell * len(figure.x) / 2, bottom + 33.0 + turned
    return [*texts, f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{escape(figure.x_title)}</text>']


def _column_names(names: Sequence[str], width: float) -> list[tuple[int, str]]:
    """Names below columns of a width [px]: of numbers that do not fit only some are shown."""
    if not _are_numbers(names):
        return list(enumerate(names))
    every = int(-(-max(map(text_width, names), default=1.0) // max(width - 4.0, 1.0)))
    return list(enumerate(names))[:: max(every, 1)]


def _cell(
    figure: HeatMap, at: tuple[int, int], place: tuple[float, float, float, float], narrow: bool, size: float
) -> str:
    """Cell with its number, and on a page, which a mouse moves over, with its place and number in words.

    `at` is row and column, `place` left, top, width and height [px], `size` that of the number [px], 0 for none.
    """
    i, j = at
    value, text = figure.values[i][j], figure.texts[i][j]
    if value is None and not text.strip():
        return ""
    x, y, width, height = place
    colour = "#ffffff" if value is None else _colour(figure, value)
    said = f"{figure.y_title} {figure.y[i]}; {figure.x_title} {figure.x[j]}: {text} {figure.unit}"
    title = "" if narrow else f"<title>{escape(said)}</title>"
    fits = size > 0.0 if narrow else width >= min(NARROWEST, text_width(text))
    middle, line = _short(x + width / 2), _short(y + height / 2 + 0.36 * size)
    number = f'<text x="{middle}" y="{line}">{escape(text)}</text>' if fits else ""
    left, top, across, down = map(_short, (x + 0.5, y + 0.5, width - 1, height - 1))
    cell = f'<path d="M{left} {top}h{across}v{down}h-{across}z" fill="{colour}"/>{number}'  # shorter than a rect
    return cell if narrow else f'<g class="cell">{title}{cell}</g>'


def _short(place: float) -> str:
    """Tenths of a pixel."""
    return f"{round(place, 1):g}"


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
    stops = DIVERGING if figure.diverging else SEQUENTIAL
    first = min(int(place), 1)
    pair = [[int(stop[k : k + 2], 16) for k in (1, 3, 5)] for stop in stops[first : first + 2]]
    return "#" + "".join(f"{round(a + (place - first) * (b - a)):02x}" for a, b in zip(*pair, strict=True))


def _scale(figure: HeatMap, frame: _Frame) -> str:
    """Colours from the lowest value to the highest, with their numbers, next to the map or below a narrow one."""
    (low, high), steps = _ends(figure), 24
    texts = [significant(value, 3).replace("-", "−") for value in (low, 0.5 * (low + high), high)]
    colours = [_colour(figure, low + (k + 0.5) / steps * (high - low)) for k in range(steps)]
    x, bottom, long = frame.left + frame.cell * len(figure.x) + 10.0, frame.bottom, frame.bottom - TOP
    if frame.is_narrow:
        x, bottom, long = frame.left, frame.bottom + frame.below - 28.0, frame.width - frame.left - RIGHT
    step = long / steps
    if frame.is_narrow:
        places = [(x + step * k, bottom, step + 0.5, 10.0) for k in range(steps)]
        numbers = [(x + 0.5 * long * k, bottom + 22.0, anchor) for k, anchor in enumerate(("start", "middle", "end"))]
    else:
        places = [(x, bottom - step * (k + 1), 10.0, step + 0.5) for k in range(steps)]
        numbers = [(x + 13.0, y, "start") for y in (bottom, (TOP + bottom) / 2 + 4.0, TOP + 8.0)]
    parts = [
        f'<rect x="{px:.1f}" y="{py:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{colour}"/>'
        for (px, py, width, height), colour in zip(places, colours, strict=True)
    ]
    parts += [
        f'<text x="{px:.1f}" y="{py:.1f}" text-anchor="{anchor}">{text}</text>'
        for (px, py, anchor), text in zip(numbers, texts, strict=True)
    ]
    return "".join(parts)
