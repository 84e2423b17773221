"""Bands of measured quantities about a map: a sentence, heat maps of their half widths, and areas about curves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from commonrail.arrays import Floats
from commonrail.display.chart import Band, points
from commonrail.display.heat_map import HeatMap
from commonrail.display.text import fixed, significant
from commonrail.maps.quantity_map import Edges, InjectionMap, MapBands

__all__ = ["band_about", "band_heats", "band_sentences"]


MPA, MM3, MICRO = 1e-6, 1e9, 1e6
DIGITS = 2  # significant ones of a half width: more would pretend that bands are known so well


def band_sentences(m: InjectionMap) -> list[str]:
    """Sentence on the widest band of a map and where it is; none where the map has no bands."""
    if m.bands is None:
        return []
    level = _widest(m.bands)
    half = _half(m.bands.delivered, level)
    if not np.isfinite(half).any():
        return ["No cell of the inverse has a band."]
    i, j = np.unravel_index(int(np.nanargmax(half)), half.shape)
    return [
        f"{fixed(level, 0, 100.0)} % of measured quantities are expected within "
        f"±{significant(float(np.nanmedian(half)), DIGITS, MM3)} mm³ of the inverse's quantities in the median, within "
        f"±{significant(float(half[i, j]), DIGITS, MM3)} mm³ at most "
        f"({significant(m.axes.quantity[j], 4, MM3)} mm³ at {significant(m.axes.rail_pressure[i], 4, MPA)} MPa)."
    ]


def band_heats(m: InjectionMap, label: str) -> list[HeatMap]:
    """Half widths of the widest band, of the inverse and of the quantity map; none where the map has no bands.

    Parameters
    ----------
    m : InjectionMap
    label : str
        Of the model.
    """
    if m.bands is None:
        return []
    level = _widest(m.bands)
    title = f"{{}} of {label}: half width of the {fixed(level, 0, 100.0)} % band, mm³"
    caption = f"Share of measured quantities that are expected inside. Bands: {m.bands.estimator}."
    rails = m.axes.rail_pressure.tolist()
    quantities = tuple(significant(v, 6, MM3) for v in m.axes.quantity.tolist())
    times = tuple(significant(v, 6, MICRO) for v in m.axes.energising_time.tolist())
    empty = HeatMap(
        "", caption, "rail pressure, MPa", "", tuple(significant(v, 6, MPA) for v in rails), (), (), (), "mm³"
    )
    inverse = replace(empty, title=title.format("Inverse"), y_title="quantity, mm³", y=quantities)
    forward = replace(empty, title=title.format("Quantity map"), y_title="energising time, µs", y=times)
    return [_filled(inverse, _half(m.bands.delivered, level)), _filled(forward, _half(m.bands.quantity, level))]


def band_about(m: InjectionMap, row: int, family: int, largest: float) -> tuple[Band, ...]:
    """Area of the widest band about the curve of a rail pressure, at the energising times of the axis.

    Parameters
    ----------
    m : InjectionMap
    row : int
        Of the rail pressure.
    family : int
        Of the curve.
    largest : float
        Largest quantity that is drawn [m³].
    """
    if m.bands is None:
        return ()
    low, high = (edge[row] for edge in m.bands.quantity[_widest(m.bands)])
    shown = np.isfinite(low) & np.isfinite(high) & (m.volume[row] <= largest)
    x = points(m.axes.energising_time[shown] * MICRO)
    return (Band("solid", x, points(low[shown] * MM3), points(high[shown] * MM3), family),) if x else ()


def _widest(bands: MapBands) -> float:
    return max(bands.quantity)


def _half(edges: Edges, level: float) -> Floats:
    low, high = edges[level]
    return np.asarray(0.5 * (high - low))


def _filled(heat: HeatMap, half: Floats) -> HeatMap:
    """Heat map with half widths (pressures, y) [m³] in its cells."""
    values = half.T * MM3
    texts = tuple(tuple(significant(v, DIGITS) if np.isfinite(v) else "" for v in row) for row in values.tolist())
    return replace(heat, values=tuple(points(row) for row in values.tolist()), texts=texts)
