"""Heat map as plain numbers: cells over two axes of named places. `report.draw_map` turns it into a picture."""

from __future__ import annotations

from dataclasses import dataclass

from commonrail.display.chart import Points

__all__ = ["HeatMap"]


@dataclass(frozen=True)
class HeatMap:
    """Coloured cells with their numbers.

    Attributes
    ----------
    title, caption, x_title, y_title : str
    x, y : tuple of str
        Places along the axes, in equal distances whatever their values.
    values : tuple of Points
        A row for each place of y; None is an empty cell.
    texts : tuple of tuple of str
        What is written into the cells.
    unit : str
        Of the values, beside the scale of colours.
    diverging : bool
        Whether zero lies in the middle of the colours, as of a difference.
    largest : float
        Difference of the last colour; 0 for the largest one there is.
    """

    title: str
    caption: str
    x_title: str
    y_title: str
    x: tuple[str, ...]
    y: tuple[str, ...]
    values: tuple[Points, ...]
    texts: tuple[tuple[str, ...], ...]
    unit: str
    diverging: bool = False
    largest: float = 0.0
