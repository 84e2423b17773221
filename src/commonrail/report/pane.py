"""Content of one panel of a figure as SVG: bands, boxes, bars, lines and markers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from markupsafe import escape

from commonrail.arrays import Floats
from commonrail.display.chart import Band, Bars, Boxes, Panel, Points, Series
from commonrail.report.axis import Axis

__all__ = ["DASHES", "TENTHS", "colour_of", "line_of", "marker_path", "marker_style", "pane_svg"]


TENTHS = 10  # coordinates are whole tenths of a pixel
PASSES = 5  # each may move a line by a tenth of a pixel
INK = "#1d2733"

# Told apart in grey by dash and width, and by the colour-blind (Okabe and Ito's palette).
LOOKS: dict[str, tuple[str, float, str]] = {  # colour, width [px], dash
    "measured": ("#6b7785", 3.0, "solid"),
    "rigid": ("#b07d00", 1.4, "dot"),
    "rigid fitted": ("#8f4a7d", 1.4, "longdashdot"),
    "start": ("#0072b2", 1.6, "dash"),
    "best": ("#c1272d", 1.8, "solid"),
    "mean": ("#0072b2", 1.6, "dash"),
    "paper": ("#00795c", 1.6, "dashdot"),
    "level": ("#6b7785", 1.2, "dot"),
}
_FAMILY_LINES: dict[str, tuple[float, str]] = {
    "start": (1.2, "dot"),
    "best": (1.8, "solid"),
    "measured": (1.8, "solid"),
}
FAMILIES = ("#0072b2", "#d55e00", "#00795c", "#8f4a7d", "#7a6a00", "#3a3a3a", "#5b8fb9", "#a6312b")
DASHES = {"dash": "7 4", "dot": "2 3", "dashdot": "7 3 2 3", "longdashdot": "11 3 2 3"}
# Filled disc, filled square, ring and frame: drawn as ends of lines, so that an enlarged panel does not enlarge them.
_MARKERS = (("round", False), ("square", False), ("round", True), ("square", True))
SIZES = {"markers": 7.5, "lines+markers": 5.0}
_KEEPS_ITS_WIDTH = 'vector-effect="non-scaling-stroke"'


def colour_of(look: str, family: int | None) -> str:
    """Colour of a series, a band or boxes."""
    return LOOKS[look][0] if family is None else FAMILIES[family % len(FAMILIES)]


def line_of(series: Series) -> tuple[str, float, str]:
    """Colour, width [px] and dash of a series."""
    if series.family is None:
        return LOOKS[series.look]
    width, dash = _FAMILY_LINES.get(series.look, (1.6, series.look))
    return colour_of(series.look, series.family), width, dash


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
    name = f' data-name="{escape(series.label)}"'
    if "lines" in series.mode and (path := _path(places)):
        colour, width, dash = line_of(series)
        dashed = f' stroke-dasharray="{DASHES[dash]}"' if dash in DASHES else ""
        yield (
            f'<path class="curve"{name} d="{path}" fill="none" stroke="{colour}" stroke-width="{width}"{dashed} '
            f'stroke-linejoin="round" {_KEEPS_ITS_WIDTH}/>'
        )
    if "markers" in series.mode and len(points := places[np.isfinite(places).all(axis=1)]):
        yield from marker_path(series, "".join(f"M{i} {j}h1" for i, j in points.astype(int).tolist()), name)


def marker_style(series: Series) -> tuple[str, str, float, bool]:
    """Colour, kind of end, size [px] of the markers of a series, and whether they are hollow."""
    cap, hollow = _MARKERS[(series.family or 0) % len(_MARKERS)]
    size = SIZES[series.mode] * (0.85 if cap == "square" else 1.0)
    return line_of(series)[0], cap, size, hollow


def marker_path(series: Series, path: str, attributes: str = "") -> Iterator[str]:
    """Markers as ends of lines of hardly any length at the places of a path.

    Parameters
    ----------
    series : Series
    path : str
        "M1 2h1" for each marker; an end of no length at all is not printed.
    attributes : str
        Of the first element.
    """
    colour, cap, size, hollow = marker_style(series)
    kept = f'fill="none" stroke-linecap="{cap}" {_KEEPS_ITS_WIDTH}'
    yield f'<path class="marks"{attributes} d="{path}" stroke="{colour}" stroke-width="{size:g}" {kept}/>'
    if hollow:
        yield f'<path d="{path}" stroke="#fff" stroke-width="{size - 3.2:g}" {kept}/>'


def _places(xs: Points, ys: Points, x: Axis, y: Axis) -> Floats:
    """Whole tenths of a pixel (points, 2); NaN where a point has no number, or none on a logarithmic axis."""
    found = np.stack([x.places(xs), y.places(ys)], axis=1)
    found[np.isnan(found).any(axis=1)] = np.nan
    return np.asarray(np.round(np.clip(TENTHS * found, -1e6, 1e6)))


def _path(places: Floats) -> str:
    """Path through places, with gaps; a point that lies on the line between its neighbours is left out."""
    sound = np.isfinite(places).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], sound, [False]]).astype(int)))
    return "".join(_stretch(places[a:b]) for a, b in edges.reshape(-1, 2))


def _stretch(places: Floats) -> str:
    places = _thinned(places).astype(int)
    steps = np.diff(places, axis=0).tolist()
    drawn = "".join(f"{'' if i < 0 else ' '}{i}{'' if j < 0 else ' '}{j}" for i, j in steps)
    return f"M{places[0, 0]} {places[0, 1]}l{drawn.strip() or '0 0'}"


def _thinned(places: Floats) -> Floats:
    """Without points within a tenth of a pixel of the line between their neighbours."""
    for _ in range(PASSES):
        if len(places) < 3:
            break
        before, here, after = places[:-2], places[1:-1], places[2:]
        along, away = after - before, here - before
        length = np.maximum(np.hypot(*along.T), 1.0)
        off = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]) / length
        ahead = (along * away).sum(axis=1) >= 0.0
        spare = (off < 1.0) & ahead & ((along * (after - here)).sum(axis=1) >= 0.0)
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
    return f'<path d="{_stretch(around)}z" fill="{colour_of(band.look, band.family)}" fill-opacity=".16"/>'


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
    """Bars in rows 0, 1, … of the vertical axis; `slot` is the number of the bars in a row, and how many there are."""
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
