"""Figure as plain numbers: panels of series over a common axis. `report.figure` turns it into a picture."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

Points = tuple[float | None, ...]

LINES, MARKERS, BOTH = "lines", "markers", "lines+markers"


def points(values: Iterable[float]) -> Points:
    """Coordinates of a series; a gap where not finite."""
    return tuple(float(v) if math.isfinite(v) else None for v in values)


@dataclass(frozen=True)
class Series:
    """One line or one set of markers.

    The look is "measured", "rigid", "rigid fitted", "start", "best", "mean", "paper", "level", or a dash: "solid",
    "dash", "dot", "dashdot".
    """

    label: str  # text of the legend; an empty one keeps the series out of it
    look: str
    x: Points
    y: Points  # as many; None leaves a gap
    mode: str = LINES  # or `MARKERS`, `BOTH`
    family: int | None = None  # series of one family share a colour, a marker and an entry of the legend
    ordered: int = 0  # number of the families where they are steps of a quantity, such as rail pressures; else 0
    low: Points = ()  # ends of error bars about y, or none
    high: Points = ()


@dataclass(frozen=True)
class Band:
    """Area between two lines, such as quartiles; it has the colour of a series of that look, or of that family."""

    look: str
    x: Points
    low: Points
    high: Points
    family: int | None = None
    ordered: int = 0


@dataclass(frozen=True)
class Boxes:
    """Box plots side by side: minimum, first quartile, median, third quartile, maximum of each category.

    `offset` moves them next to another set, in shares of the distance between categories.
    """

    label: str
    look: str
    boxes: tuple[tuple[float, float, float, float, float], ...]
    offset: float = 0.0


@dataclass(frozen=True)
class Bars:
    """Horizontal bars, one for each row of the panel, from `start` to `end`; None leaves one out.

    `low` and `high`, if given, are the ends of an interval about `end`. Bars of one `slot` lie over each other, those
    of several side by side.
    """

    label: str
    look: str
    start: Points
    end: Points
    low: Points = ()
    high: Points = ()
    slot: int = 0


@dataclass(frozen=True)
class Panel:
    """A pair of axes: what the vertical one says, its series, and its share of the height.

    With `scaled_by` the series of that look and the bands set the range of the vertical axis, where there are any; the
    others are cut at the frame.
    With `categories` the horizontal axis counts them from 0 and shows their names. With `rows` the vertical axis does,
    from top to bottom, and `bars` lie in the rows. Without a legend the vertical axis says what the series are.
    """

    y_title: str
    series: tuple[Series, ...]
    share: float = 1.0
    logarithmic: bool = False
    zero_line: bool = False
    bands: tuple[Band, ...] = ()
    boxes: tuple[Boxes, ...] = ()
    categories: tuple[str, ...] = ()
    bars: tuple[Bars, ...] = ()
    rows: tuple[str, ...] = ()
    scaled_by: str = ""
    has_legend: bool = True


@dataclass(frozen=True)
class Figure:
    """Panels above one another over a common horizontal axis."""

    title: str
    caption: str
    x_title: str
    panels: tuple[Panel, ...]


# Heat map as plain numbers: cells over two axes of named places. `report.heat_map` turns it into a picture.


@dataclass(frozen=True)
class HeatMap:
    """Coloured cells with their numbers."""

    title: str
    caption: str
    x_title: str
    y_title: str
    x: tuple[str, ...]  # places along the axis, in equal distances whatever their values
    y: tuple[str, ...]
    values: tuple[Points, ...]  # a row for each place of y; None is an empty cell
    texts: tuple[tuple[str, ...], ...]  # of the cells
    unit: str  # of the values, next to the scale of colours
    diverging: bool = False  # zero lies in the middle of the colours, as of a difference
    largest: float = 0.0  # difference of the last colour; 0 for the largest one there is


Chart = Figure | HeatMap
