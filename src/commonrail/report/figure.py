"""Figures as SVG within HTML, drawn once: a page shows them without any library."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from markupsafe import Markup, escape

from commonrail.base.arrays import Floats
from commonrail.base.chart import Band, Bars, Boxes, Chart, Figure, HeatMap, Panel, Points, Series
from commonrail.report.axis import FONT, INK, LONGEST, NARROW, SIZE, WIDE, Axis, shorten, span, text_width, upright
from commonrail.report.heat_map import heat_map_svg

# Content of one panel of a figure as SVG: bands, boxes, bars, lines and markers.

TENTHS = 10  # coordinates are whole tenths of a pixel
PASSES = 5  # each may move a line by a tenth of a pixel

# Distinct in grey by dash and width, and for the colour-blind (Okabe and Ito's palette).
LOOKS: dict[str, tuple[str, float, str]] = {  # colour, width [px], dash
    "measured": ("#6b7785", 3.0, "solid"),
    "rigid": ("#b07d00", 1.4, "dot"),
    "rigid fitted": ("#8f4a7d", 1.4, "longdashdot"),
    "start": ("#0072b2", 1.6, "dash"),
    "best": ("#c1272d", 1.8, "solid"),
    "mean": ("#0072b2", 1.6, "dash"),
    "paper": ("#00795c", 1.6, "dashdot"),
    "level": ("#6b7785", 1.2, "dot"),
    "moved": ("#00795c", 2.4, "solid"),  # simulated in the page
    "held": ("#6b7785", 1.4, "dash"),
}
# Colours on a dark page; cells of heat maps keep theirs.
_DARK = {
    "#fff": "#12181f",
    INK: "#e4e9ee",
    "#e3e7eb": "#2b3642",
    "#6b7785": "#9cabb9",
    "#b07d00": "#dca53a",
    "#8f4a7d": "#d392c4",
    "#0072b2": "#56b4e9",
    "#c1272d": "#ff7d70",
    "#00795c": "#35b98f",
    "#d55e00": "#ff9350",
    "#7a6a00": "#cdb945",
    "#3a3a3a": "#c5ccd3",
    "#5b8fb9": "#97c6ee",
    "#a6312b": "#ffa8a0",
    "#2c0594": "#6a58d8",
    "#4c02a1": "#855ed8",
    "#6a00a8": "#a064d8",
    "#8b0aa5": "#bc6ac6",
    "#a82296": "#d870b4",
    "#bf3984": "#e6839a",
    "#d3566d": "#f59680",
    "#e16462": "#f8ae6f",
    "#ee7b51": "#fbc55e",
}
_FAMILY_LINES: dict[str, tuple[float, str]] = {
    "start": (1.2, "dot"),
    "best": (1.8, "solid"),
    "measured": (1.8, "solid"),
}
FAMILIES = ("#0072b2", "#d55e00", "#00795c", "#8f4a7d", "#7a6a00", "#3a3a3a", "#5b8fb9", "#a6312b")
# Colours of an ordered quantity, low to high: matplotlib's plasma, whose rising lightness is distinguishable in grey
# and by the colour-blind; without its yellow, which is hardly visible on white.
RAMP = ("#2c0594", "#4c02a1", "#6a00a8", "#8b0aa5", "#a82296", "#bf3984", "#d3566d", "#e16462", "#ee7b51")
DASHES = {"dash": "7 4", "dot": "2 3", "dashdot": "7 3 2 3", "longdashdot": "11 3 2 3"}
# Filled disc, filled square, ring and frame: drawn as line ends, so that they keep their size in an enlarged panel.
_MARKERS = (("round", False), ("square", False), ("round", True), ("square", True))
SIZES = {"markers": 7.5, "lines+markers": 5.0}
_KEEPS_ITS_WIDTH = 'vector-effect="non-scaling-stroke"'


def dark_rules(within: str = "") -> str:
    """Rules of CSS by which a page draws its figures in the colours of a dark page.

    `within` is the selector of an element that contains the figures.
    """
    rules = [
        f'{within} svg.figure[{what}="{light}"], {within} .figure [{what}="{light}"] {{ {what}: {dark}; }}'
        for light, dark in _DARK.items()
        for what in ("fill", "stroke")
    ]
    return "\n  ".join([*rules, f"{within} .figure .cells text {{ fill: {INK}; }}"])


def colour_of(look: str, family: int | None, ordered: int = 0) -> str:
    """Colour of a series, a band or boxes; with `ordered` families, a step of the ramp."""
    if family is None:
        return LOOKS[look][0]
    if ordered:
        return RAMP[round(family * (len(RAMP) - 1) / max(ordered - 1, 1))]
    return FAMILIES[family % len(FAMILIES)]


def _key(look: str, family: int | None) -> str:
    """Attribute that an entry of a legend shares with its curves."""
    return f'data-key="{look if family is None else family}"'


def line_of(series: Series) -> tuple[str, float, str]:
    """Colour, width [px] and dash of a series."""
    if series.family is None:
        return LOOKS[series.look]
    width, dash = _FAMILY_LINES.get(series.look, (1.6, series.look))
    return colour_of(series.look, series.family, series.ordered), width, dash


def pane_svg(panel: Panel, x: Axis, y: Axis) -> str:
    """Everything inside the axes of a panel, in tenths of a pixel from its corner."""
    parts = [*(_band(band, x, y) for band in panel.bands)]
    for boxes in panel.boxes:
        parts += _boxes(boxes, x, y)
    slots = sorted({bars.slot for bars in panel.bars})
    for bars in panel.bars:
        parts += _bars(bars, x, y, (slots.index(bars.slot), len(slots)))
    for series in panel.series:
        parts += _series(series, x, y)
    return "".join(parts)


def _series(series: Series, x: Axis, y: Axis) -> Iterator[str]:
    places = _places(series.x, series.y, x, y)
    name = f' {_key(series.look, series.family)} data-look="{series.look}" data-name="{escape(series.label)}"'
    if "lines" in series.mode and (path := _path(places)):
        colour, width, dash = line_of(series)
        dashed = f' stroke-dasharray="{DASHES[dash]}"' if dash in DASHES else ""
        yield (
            f'<path class="curve"{name} d="{path}" fill="none" stroke="{colour}" stroke-width="{width}"{dashed} '
            f'stroke-linejoin="round" {_KEEPS_ITS_WIDTH}/>'
        )
    if bars := "".join(_error_bars(series, x, y)):
        key, colour = _key(series.look, series.family), line_of(series)[0]
        yield f'<path {key} d="{bars}" fill="none" stroke="{colour}" stroke-width="1.2" {_KEEPS_ITS_WIDTH}/>'
    if "markers" in series.mode and len(points := places[np.isfinite(places).all(axis=1)]):
        yield from marker_path(series, "".join(f"M{i} {j}h1" for i, j in points.astype(int).tolist()), name)


CAP = 3.0  # half width of the ends of an error bar [px]


def _error_bars(series: Series, x: Axis, y: Axis) -> Iterator[str]:
    """Paths of the error bars of a series."""
    for place, low, high in zip(series.x, series.low, series.high, strict=False):
        if place is not None and low is not None and high is not None:
            across, bottom, top = x.at(place), y.at(low), y.at(high)
            yield _move(across, bottom, across, top)
            yield from (_move(across - CAP, end, across + CAP, end) for end in (bottom, top))


def marker_style(series: Series) -> tuple[str, str, float, bool]:
    """Colour, kind of end, size [px] of the markers of a series, and whether they are hollow."""
    cap, hollow = _MARKERS[(series.family or 0) % len(_MARKERS)]
    size = SIZES[series.mode] * (0.85 if cap == "square" else 1.0)
    return line_of(series)[0], cap, size, hollow


def marker_path(series: Series, path: str, attributes: str = "") -> Iterator[str]:
    """Markers as ends of very short lines at the places of a path.

    The path is "M1 2h1" for each marker, since a line of zero length is not printed; `attributes`: of the first
    element.
    """
    colour, cap, size, hollow = marker_style(series)
    style = f'fill="none" stroke-linecap="{cap}" {_KEEPS_ITS_WIDTH}'
    key = _key(series.look, series.family)
    yield f'<path class="marks"{attributes} d="{path}" stroke="{colour}" stroke-width="{size:g}" {style}/>'
    if hollow:
        yield f'<path {key} d="{path}" stroke="#fff" stroke-width="{size - 3.2:g}" {style}/>'


def _places(xs: Points, ys: Points, x: Axis, y: Axis) -> Floats:
    """Whole tenths of a pixel (points, 2); NaN where a point has no number, or none on a logarithmic axis."""
    places = np.stack([x.places(xs), y.places(ys)], axis=1)
    places[np.isnan(places).any(axis=1)] = np.nan
    return np.asarray(np.round(np.clip(TENTHS * places, -1e6, 1e6)))


def _path(places: Floats) -> str:
    """Path through places, with gaps; a point that lies on the line between its neighbours is left out."""
    sound = np.isfinite(places).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], sound, [False]]).astype(int)))
    return "".join(_stretch(places[a:b]) for a, b in edges.reshape(-1, 2))


def _stretch(places: Floats) -> str:
    places = _thin_out(places).astype(int)
    steps = np.diff(places, axis=0).tolist()
    drawn = "".join(f"{'' if i < 0 else ' '}{i}{'' if j < 0 else ' '}{j}" for i, j in steps)
    return f"M{places[0, 0]} {places[0, 1]}l{drawn.strip() or '0 0'}"


def _thin_out(places: Floats) -> Floats:
    """Path without the points that lie within a tenth of a pixel of the line between their neighbours."""
    for _ in range(PASSES):
        if len(places) < 3:
            break
        before, here, after = places[:-2], places[1:-1], places[2:]
        along, away = after - before, here - before
        length = np.maximum(np.hypot(*along.T), 1.0)
        distance = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]) / length
        ahead = (along * away).sum(axis=1) >= 0.0
        spare = (distance < 1.0) & ahead & ((along * (after - here)).sum(axis=1) >= 0.0)
        spare[1::2] = False  # never two neighbours at once
        if not spare.any():
            return places
        places = places[np.concatenate([[True], ~spare, [True]])]
    return places


def _band(band: Band, x: Axis, y: Axis) -> str:
    low, high = _places(band.x, band.low, x, y), _places(band.x, band.high, x, y)
    sound = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)
    if not sound.any():
        return ""
    around = np.concatenate([low[sound], high[sound][::-1]])
    colour, key = colour_of(band.look, band.family, band.ordered), _key(band.look, band.family)
    return f'<path class="band" {key} d="{_stretch(around)}z" fill="{colour}" fill-opacity=".16"/>'


def _rect(x: float, y: float, width: float, height: float, colour: str) -> str:
    """Filled and framed rectangle [px]."""
    sizes = (round(TENTHS * v) for v in (x, y, max(width, 0.0), max(height, 0.0)))
    place = 'x="{}" y="{}" width="{}" height="{}"'.format(*sizes)
    return f'<rect {place} fill="{colour}" fill-opacity=".22" stroke="{colour}" stroke-width="1.2" {_KEEPS_ITS_WIDTH}/>'


def _lines(path: str, colour: str, width: float) -> str:
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}" {_KEEPS_ITS_WIDTH}/>'


def _move(x0: float, y0: float, x1: float, y1: float) -> str:
    """Straight line [px]."""
    return "M{} {}L{} {}".format(*(round(TENTHS * v) for v in (x0, y0, x1, y1)))


def _boxes(boxes: Boxes, x: Axis, y: Axis) -> Iterator[str]:
    colour = colour_of(boxes.look, None)
    for i, box in enumerate(boxes.boxes):
        low, q1, median, q3, high = (y.at(v) for v in box)
        left, middle, right = (x.at(i + boxes.offset + d) for d in (-0.13, 0.0, 0.13))
        yield _rect(left, q3, right - left, q1 - q3, colour)
        ends = "".join(_move(left, v, right, v) for v in (low, median, high))
        yield _lines(ends + _move(middle, low, middle, q1) + _move(middle, q3, middle, high), colour, 1.4)


def _bars(bars: Bars, x: Axis, y: Axis, slot: tuple[int, int]) -> Iterator[str]:
    """Bars in rows 0, 1, … of the vertical axis; `slot`: index of these bars in a row, and number of bars per row."""
    colour = colour_of(bars.look, None)
    number, count = slot
    thick = 0.8 / count
    path = ""
    for i, (start, end) in enumerate(zip(bars.start, bars.end, strict=True)):
        if start is None or end is None:
            continue
        top, bottom = (y.at(i - 0.4 + thick * (number + d)) for d in (0.0, 1.0))
        left, right = sorted((x.at(start), x.at(end)))
        yield _rect(left, min(top, bottom), right - left, abs(bottom - top), colour)
        low, high = (edges[i] if edges else None for edges in (bars.low, bars.high))
        if low is not None and high is not None:
            middle = 0.5 * (top + bottom)
            path += _move(x.at(low), middle, x.at(high), middle)
            path += "".join(_move(x.at(v), middle - 3.0, x.at(v), middle + 3.0) for v in (low, high))
    if path:
        yield _lines(path, INK, 1.2)


SOFT, GRID = "#586472", "#e3e7eb"
LINE = 16.0  # of a legend [px]
BETWEEN = 16.0  # panels [px]
BELOW = 40.0  # the last panel: ticks and title [px]
RIGHT = 14.0  # of the panels [px]
TITLE = 30.0  # of the vertical axis, with the spaces about it [px]
LARGEST_NAME = 0.45  # of a row name, relative to the width of the figure
SAMPLE = 26.0  # length of a legend's line, with the space after it [px]
APART = 14.0  # entries of a legend [px]
NAME, MOST_AT_ENDS = 14.0, 10  # distance of names at the ends of lines [px], and their number; more are in the legend


@dataclass(frozen=True)
class _Sheet:
    """Size of a figure, and left edge of its panels [px]."""

    width: float
    height: float
    left: float
    right: float

    @property
    def inner(self) -> float:
        """Width of the panels."""
        return self.width - self.left - self.right


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


def small_html(figure: Chart, key: str, height: int = 0) -> Markup:
    """Element that shows a figure in a row of others, with the identifier `key`; `height` as for `svg` [px]."""
    return Markup('<div class="drawing" id="{}">{}</div>').format(key, svg(figure, NARROW, height))


def small_drawings(figures: Iterable[Chart], name: str) -> list[tuple[Chart, Markup]]:
    """Charts in a row, with their elements, whose identifiers are the name and a number."""
    return [(figure, small_html(figure, f"{name}-{i}")) for i, figure in enumerate(figures, start=1)]


def drawings(figures: Iterable[Chart], height: int = 0, name: str = "figure") -> Sequence[tuple[Chart, Markup]]:
    """Charts with their elements, whose identifiers are the name and a number; `height` [px] as for `figure_html`."""
    return [(figure, figure_html(figure, f"{name}-{i}", height)) for i, figure in enumerate(figures)]


def figure_svg(figure: Figure, width: int = WIDE, height: int = 0, name: str = "") -> str:
    """Picture of a figure, panels above one another, as an element of the class `name`.

    Width and height are in px, the height by default what its panels need.
    """
    at_ends = _series_named_at_ends(figure, width)
    legend, top = _legend(figure, width, {series.label for series in at_ends})
    xs = _horizontals(figure.panels)
    height = height or _usual_height(figure, width, top)
    panes = _panes(figure, height, top)
    ys = [replace(_vertical(panel), start=pane, end=0.0) for panel, (_, pane) in zip(figure.panels, panes, strict=True)]
    left = _left_margin(figure, ys, width)
    names_room = max((SAMPLE + text_width(series.label) for series in at_ends), default=0.0)
    right = RIGHT + names_room
    turned = _upright_room(figure.panels[-1], width - left - right)
    sheet = _Sheet(float(width), height + turned, left, right)
    parts = [legend, *_names_at_ends(at_ends, ys[0], sheet.left + sheet.inner + 6.0, panes[0][0])]
    for i, panel in enumerate(figure.panels):
        axis_x = replace(xs[i], start=0.0, end=sheet.inner)
        last = i == len(figure.panels) - 1
        parts.append(_panel(panel, (axis_x, ys[i]), panes[i][0], sheet, last or xs[i] != xs[-1]))
    middle, bottom = sheet.left + sheet.inner / 2, sheet.height - 6.0
    width, height = round(sheet.width), round(sheet.height)
    parts.append(_text(figure.x_title, middle, bottom, "middle"))
    return (
        f'<svg class="figure {name}" data-x-title="{escape(figure.x_title)}" viewBox="0 0 {width} {height}" '
        'xmlns="http://www.w3.org/2000/svg" '
        f'font-family="{escape(FONT)}" font-size="{SIZE}" fill="{INK}" role="img" '
        f'aria-label="{escape(figure.title)}">{"".join(parts)}</svg>'
    )


def _usual_height(figure: Figure, width: int, top: float) -> int:
    first, more = (250.0, 100.0) if width > NARROW else (190.0, 70.0)
    rows = max((len(panel.rows) for panel in figure.panels), default=0)
    return round(top + max(first + more * (len(figure.panels) - 1), 22.0 * rows) + BELOW)


def _left_margin(figure: Figure, ys: Sequence[Axis], width: int) -> float:
    """Width of the title and the texts of the vertical axes [px]."""
    names = [text for axis, panel in zip(ys, figure.panels, strict=True) for _, text in _y_ticks(panel, axis, width)]
    return max(map(text_width, names), default=0.0) + TITLE


def _upright_room(panel: Panel, width: float) -> float:
    """Room for upright names of categories [px], in a panel of a width; 0 where they fit in a row."""
    return upright(panel.categories, width / len(panel.categories)) if panel.categories else 0.0


def _panes(figure: Figure, height: int, top: float) -> tuple[tuple[float, float], ...]:
    """Top and height of each panel [px]; the panels divide the height in proportion to their `share`.

    `height` [px]: height of the figure without upright category names.
    """
    available = height - top - BELOW - BETWEEN * (len(figure.panels) - 1)
    total = sum(panel.share for panel in figure.panels)
    panes = []
    for panel in figure.panels:
        panes.append((top, available * panel.share / total))
        top += panes[-1][1] + BETWEEN
    return tuple(panes)


def _y_ticks(panel: Panel, y: Axis, width: float) -> list[tuple[float, str]]:
    """Values and texts of the vertical axis: numbers in full, names of rows cut where they would fill the figure.

    The axis is from the bottom to the top of the panel, `width` the figure's [px].
    """
    if panel.rows:
        return [(float(i), shorten(name, LARGEST_NAME * width)) for i, name in enumerate(panel.rows)]
    return y.ticks(max(3, round(y.start / 45.0)))


def _horizontals(panels: Sequence[Panel]) -> list[Axis]:
    """Axis of each panel: shared by all panels, or its own categories."""
    values = [v for panel in panels for v in _x_values(panel)]
    # markers, and upright lines such as limits, would lie on the frame
    marks = any("markers" in series.mode or len(set(series.x)) == 1 for panel in panels for series in panel.series)
    low, high = span(values, padded=marks or any(panel.rows for panel in panels))
    ends = [v for panel in panels for bars in panel.bars for v in chain(bars.start, bars.end) if v is not None]
    shared = Axis(0.0 if not marks and min(ends, default=1.0) == 0.0 else low, high, 0.0, 1.0)  # bars begin on the axis
    return [Axis(-0.6, len(p.categories) - 0.4, 0.0, 1.0) if p.categories else shared for p in panels]


def _x_values(panel: Panel) -> list[float]:
    curves: list[Series | Band] = [*panel.series, *panel.bands]
    values = [v for curve in curves for v in curve.x]
    values += [v for bars in panel.bars for v in chain(bars.start, bars.end, bars.low, bars.high)]
    return [v for v in values if v is not None]


def _vertical(panel: Panel) -> Axis:
    if panel.rows:
        return Axis(len(panel.rows) - 0.4, -0.6, 0.0, 1.0)
    scaling = [series for series in panel.series if series.look == panel.scaled_by] or panel.series
    values = [v for series in scaling for v in chain(series.y, series.low, series.high) if v is not None]
    if not panel.scaled_by:
        values += [v for band in panel.bands for v in chain(band.low, band.high) if v is not None]
    values += [v for boxes in panel.boxes for box in boxes.boxes for v in box]
    if not panel.logarithmic:
        marks = any("markers" in series.mode for series in panel.series)
        return Axis(*span(values, zero=panel.zero_line, both_sides=panel.zero_line and marks), 0.0, 1.0)
    positive = [v for v in values if v > 0.0] or [1.0, 10.0]
    low, high = min(positive), max(positive)
    return Axis(low / 1.15, max(high * 1.15, 2.0 * low), 0.0, 1.0, True)


def _panel(panel: Panel, axes: tuple[Axis, Axis], top: float, sheet: _Sheet, labelled: bool) -> str:
    """Grid, content, frame and texts of a panel; `labelled` is whether its horizontal axis has texts."""
    x, y = axes
    height = y.start
    xs = _x_ticks(panel, x, sheet.inner)
    ys = _y_ticks(panel, y, sheet.width)
    grid = "".join(f"M{x.at(v):.1f} 0v{height:.1f}" for v, _ in xs if not panel.categories)
    grid += "".join(f"M0 {y.at(v):.1f}h{sheet.inner:.1f}" for v, _ in ys if not panel.rows)
    zero = (
        f"M0 {y.at(0.0):.1f}h{sheet.inner:.1f}" if panel.zero_line and not panel.rows and y.low < 0.0 < y.high else ""
    )
    zero += f"M{x.at(0.0):.1f} 0v{height:.1f}" if panel.rows and x.low < 0.0 < x.high else ""
    ends = f'data-x="{x.low!r} {x.high!r}" data-y="{y.low!r} {y.high!r}"'
    has_texts = ' data-texts=""' if labelled else ""
    fixed = ' data-fixed=""' if panel.categories or panel.rows else ' data-log=""' if y.logarithmic else ""
    fixed += ' data-rows=""' if panel.rows else ""
    fixed += f' data-scaled="{panel.scaled_by}"' if panel.scaled_by else ""
    view = f"0 0 {round(TENTHS * sheet.inner)} {round(TENTHS * height)}"
    texts = _x_texts(panel, [(x.at(v), text) for v, text in xs], height, sheet.inner) if labelled else []
    names = [_text(text, -6.0, y.at(v) + 4.0, "end") for v, text in ys]
    turned = f'<g transform="translate({12.0 - sheet.left:.1f} {height / 2:.1f}) rotate(-90)">'
    return (
        f'<g class="panel" transform="translate({sheet.left:.1f} {top:.1f})" data-title="{escape(panel.y_title)}">'
        f'<rect width="{sheet.inner:.1f}" height="{height:.1f}" fill="#fff"/>'
        f'<path class="grid" d="{grid}" stroke="{GRID}"/><path class="zero" d="{zero}" stroke="{INK}"/>'
        f'<svg class="pane" width="{sheet.inner:.1f}" height="{height:.1f}" viewBox="{view}" '
        f'preserveAspectRatio="none" {ends}{fixed}>{pane_svg(panel, x, y)}</svg>'
        f'<path d="M0 0V{height:.1f}H{sheet.inner:.1f}" fill="none" stroke="{INK}"/>'
        f'<g class="xs"{has_texts}>{"".join(texts)}</g><g class="ys">{"".join(names)}</g>'
        f"{turned}{_text(panel.y_title, 0.0, 0.0, 'middle')}</g></g>"
    )


def _x_ticks(panel: Panel, x: Axis, width: float) -> list[tuple[float, str]]:
    if not panel.categories:
        return x.ticks(max(4, round(width / 90.0)))
    return [(float(i), shorten(name, LONGEST)) for i, name in enumerate(panel.categories)]


def _x_texts(panel: Panel, places: Sequence[tuple[float, str]], height: float, width: float) -> list[str]:
    """Texts at places [px] below a panel of a size [px], upright where they do not fit in a row."""
    if not _upright_room(panel, width):
        return [_text(text, place, height + 15.0, "middle") for place, text in places]
    return [
        f'<g transform="translate({place + 4.0:.1f} {height + 6.0:.1f}) rotate(-90)">{_text(text, 0.0, 0.0, "end")}</g>'
        for place, text in places
    ]


def _text(text: str, x: float, y: float, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _series_named_at_ends(figure: Figure, width: int) -> list[Series]:
    """Lines of the first panel of a wide figure that are steps of a quantity: their names are at their ends."""
    lines = [s for s in figure.panels[0].series if s.ordered > 1 and s.label and "lines" in s.mode]
    lines = [s for s in lines if any(v is not None for v in s.y)]
    return lines if width > NARROW and 1 < len(lines) <= MOST_AT_ENDS and figure.panels[0].has_legend else []


def _names_at_ends(lines: Sequence[Series], y: Axis, x: float, top: float) -> Iterator[str]:
    """Entries next to the ends of lines, apart from one another, right of a panel whose frame ends before x [px]."""
    ends = [(y.at([v for v in series.y if v is not None][-1]), series) for series in lines]
    ends.sort(key=lambda end: end[0])
    places = [min(max(place, 0.0), y.start) for place, _ in ends]
    for i in range(1, len(places)):
        places[i] = max(places[i], places[i - 1] + NAME)
    places[-1:] = [min(place, y.start) for place in places[-1:]]
    for i in reversed(range(len(places) - 1)):
        places[i] = min(places[i], places[i + 1] - NAME)
    for place, (_, series) in zip(places, ends, strict=True):
        entry = f"{_sample(series)}{_text(series.label, SAMPLE, 0.0)}"
        moved = f'transform="translate({x:.1f} {top + place + 4.0:.1f})"'
        yield f'<g class="entry" {_key(series.look, series.family)} {moved}>{entry}</g>'


def _legend(figure: Figure, width: int, elsewhere: Collection[str] = ()) -> tuple[str, float]:
    """Entries in rows above the panels, but for those elsewhere, and where the panels begin [px]."""
    x, y = 8.0, LINE
    parts = []
    entries = {(key, text): sample for (key, text), sample in _entries(figure).items() if text not in elsewhere}
    for (key, text), sample in entries.items():
        text = shorten(text, width - SAMPLE - 16.0)
        entry_width = SAMPLE + text_width(text)
        if x > 8.0 and x + entry_width > width - 8.0:
            x, y = 8.0, y + LINE
        place = f'transform="translate({x:.1f} {y:.1f})"'
        parts.append(f'<g class="entry" {key} {place}>{sample}{_text(text, SAMPLE, 0.0)}</g>')
        x += entry_width + APART
    return "".join(parts), (y + 10.0 if parts else 12.0)


def _entries(figure: Figure) -> dict[tuple[str, str], str]:
    """Samples of the legend entries by key and text; each text occurs once."""
    samples: dict[str, tuple[str, str]] = {}
    for panel in figure.panels:
        solid: list[Boxes | Bars] = [*panel.boxes, *panel.bars] if panel.has_legend else []
        for boxes in solid:
            colour = colour_of(boxes.look, None)
            square = f'<rect x="4" y="-10" width="12" height="11" fill="{colour}" fill-opacity=".3" stroke="{colour}"/>'
            samples.setdefault(boxes.label, ("", square))
        for series in panel.series if panel.has_legend else ():
            samples.setdefault(series.label, (_key(series.look, series.family), _sample(series)))
    return {(key, text): sample for text, (key, sample) in samples.items() if text}


def _sample(series: Series) -> str:
    colour, width, dash = line_of(series)
    dashed = f' stroke-dasharray="{DASHES[dash]}"' if dash in DASHES else ""
    drawn = f'<path d="M0 -4h20" stroke="{colour}" stroke-width="{width}"{dashed}/>' if "lines" in series.mode else ""
    return drawn + ("".join(marker_path(series, "M10 -4h.1")) if "markers" in series.mode else "")
