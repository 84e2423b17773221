"""The page of a quantity map and its inverse: sentences, heat maps, curves, and the cells that are named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import BOTH, MARKERS, Band, Figure, HeatMap, Panel, Series, points
from commonrail.base.table import Table, tabulated
from commonrail.base.text import counted, fixed, listed, significant
from commonrail.plugins.maps.bands import band_about, band_heats, band_sentences
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.difference import Comparison, difference
from commonrail.plugins.maps.inverse import TOLERANCE
from commonrail.plugins.maps.response import FALL
from commonrail.plugins.maps.run import InjectionMap
from commonrail.plugins.maps.table import notes_of
from commonrail.report.draw.figure import drawings
from commonrail.report.html import render
from commonrail.report.presenter import Array, Arrays, Presenter, in_common_unit

MPA, MM3, MICRO = 1e-6, 1e9, 1e6
ZOOM = 10e-9  # largest quantity of the enlarged curves [m³]
CURVES = 8  # rail pressures whose curves are drawn
MARKS = {CellState.SEVERAL: "‡", CellState.JUMP: "*", CellState.BEYOND: "†", CellState.FAILED: "–"}
LEGEND = (
    "† unreachable, by the stated rule; ‡ several energising times deliver the quantity; * the quantity jumps past it."
)


def map_html(found: Mapping[str, InjectionMap], compared: Comparison | None = None) -> str:
    """Page of one map, or of two with their difference.

    Parameters
    ----------
    found : mapping of str to InjectionMap
        By label.
    compared : Comparison, optional
        Of the first map with measured data.
    """
    maps, curves = map_figures(found, compared)
    first = next(iter(found.values()))
    synthetic = [m.injector.synthetic for m in found.values() if m.injector.synthetic]
    heats = drawings(maps, name="map")
    return render(
        "map.html",
        package=__package__,
        title=f"Quantity map: {' and '.join(found)}",
        kind="Map",
        record={},
        synthetic=synthetic,
        lines=map_lines(found, compared),
        heats=heats,
        curves=drawings(curves, 460),
        tables=map_tables(found, compared),
        commands=[],
        facts=[("Conditions", note) for note in notes_of(first)],
    )


def map_lines(found: Mapping[str, InjectionMap], compared: Comparison | None = None) -> list[str]:
    """Sentences: size of the map, what its cells deliver, and which cells are named.

    Parameters
    ----------
    found : mapping of str to InjectionMap
    compared : Comparison, optional
    """
    lines = [sentence for label, m in found.items() for sentence in _lines(label if len(found) > 1 else "", m)]
    if compared is not None:
        large, small = significant(100.0 * compared.rms_large, 3), significant(compared.rms_small * MM3, 3)
        count = len(compared.measured.volume)
        lines.append(
            f"Against {count} measured quantities of {compared.source}: rms {large} % above 3 mm³, {small} mm³ below."
        )
    return lines


def _lines(label: str, m: InjectionMap) -> list[str]:
    inverse = m.inverse
    searched = np.isin(inverse.state, (CellState.REACHED, CellState.SEVERAL))
    miss = np.abs(inverse.delivered - m.axes.quantity)[searched]
    opening = f"{label}: " if label else ""
    lines = [
        f"{opening}{counted(len(m.axes.rail_pressure), 'rail pressure')} × "
        f"{counted(len(m.axes.quantity), 'quantity', 'quantities')}; {searched.sum()} of "
        f"{counted(inverse.state.size, 'cell')} were simulated until they deliver their quantity, within "
        f"{fixed(miss.max(initial=0.0), 3, MM3)} mm³ ({m.simulations} injections)."
    ]
    counts = {
        CellState.BEYOND: "hold a quantity that the longest energising time does not deliver",
        CellState.SEVERAL: "have several energising times",
        CellState.JUMP: "hold a quantity that is jumped past",
        CellState.FAILED: "could not be simulated",
    }
    named = [f"{m.count(state)} {words}" for state, words in counts.items() if m.count(state)]
    if m.inverse_ballistic.any():
        named.append(f"{int(m.inverse_ballistic.sum())} are ballistic: the needle turns round below its largest lift")
    if named:
        lines.append(f"Of the cells {listed(named)}.")
    return [*lines, *band_sentences(m), _monotonicity(m)]


def _monotonicity(m: InjectionMap) -> str:
    if not m.falls:
        return f"Monotone: the quantity never falls by more than {fixed(FALL, 2, MM3)} mm³ with longer energising."
    pressures = sorted({fall.rail_pressure for fall in m.falls})
    return (
        f"Not monotone: the quantity falls with longer energising at {counted(len(m.falls), 'place')}, "
        f"at {listed([significant(p, 4, MPA) for p in pressures])} MPa; the table names them."
    )


def map_tables(found: Mapping[str, InjectionMap], compared: Comparison | None = None) -> list[Table]:
    """Falls, cells that are named, and largest differences.

    Parameters
    ----------
    found : mapping of str to InjectionMap
    compared : Comparison, optional
    """
    tables = [_falls(found), _named_cells(found), _falls_with_pressure(found)]
    if compared is not None:
        tables.append(_measured_table(compared))
    return [table for table in tables if table.rows]


def _falls(found: Mapping[str, InjectionMap]) -> Table:
    rows = [(label, fall) for label, m in found.items() for fall in m.falls]
    return tabulated(
        "Places where the quantity falls with longer energising",
        rows,
        [
            ("model", lambda r: r[0]),
            ("rail pressure, MPa", lambda r: significant(r[1].rail_pressure, 4, MPA)),
            ("from, µs", lambda r: fixed(r[1].start, 1, MICRO)),
            ("to, µs", lambda r: fixed(r[1].end, 1, MICRO)),
            ("largest, mm³", lambda r: fixed(r[1].high, 2, MM3)),
            ("smallest, mm³", lambda r: fixed(r[1].low, 2, MM3)),
        ],
        f"Found on all simulated energising times, every 12.5 µs up to 500 µs; falls below {FALL * MM3:g} mm³ are not "
        "listed.",
    )


def _named_cells(found: Mapping[str, InjectionMap]) -> Table:
    rows = []
    for label, m in found.items():
        for (i, j), state in np.ndenumerate(m.inverse.state):
            if CellState(int(state)) in MARKS:
                rows.append((label, m.axes.rail_pressure[i], m.axes.quantity[j], m.inverse, (i, j)))
    return tabulated(
        "Cells that are named",
        rows,
        [
            ("model", lambda r: r[0]),
            ("meaning", lambda r: CellState(r[3].state[r[4]]).sentence),
            ("rail pressure, MPa", lambda r: significant(r[1], 4, MPA)),
            ("quantity, mm³", lambda r: significant(r[2], 4, MM3)),
            ("energising time, µs", lambda r: fixed(r[3].energising_time[r[4]], 1, MICRO)),
            ("delivered, mm³", lambda r: fixed(r[3].delivered[r[4]], 3, MM3)),
        ],
        f"All other cells deliver their quantity within {TOLERANCE * MM3:g} mm³.",
        2,
    )


def _falls_with_pressure(found: Mapping[str, InjectionMap]) -> Table:
    rows = []
    for label, m in found.items():
        for i, j in np.argwhere(m.falls_with_pressure):
            rows.append((label, m.axes.rail_pressure[i], m.axes.energising_time[j], m.volume[i - 1, j], m.volume[i, j]))
    return tabulated(
        "Cells whose quantity falls with the rail pressure",
        rows,
        [
            ("model", lambda r: r[0]),
            ("rail pressure, MPa", lambda r: significant(r[1], 4, MPA)),
            ("energising time, µs", lambda r: fixed(r[2], 1, MICRO)),
            ("at the pressure before, mm³", lambda r: fixed(r[3], 2, MM3)),
            ("here, mm³", lambda r: fixed(r[4], 2, MM3)),
        ],
        "At a higher rail pressure the valve opens later, so that a short energising can inject less.",
    )


def _measured_table(compared: Comparison) -> Table:
    measured = compared.measured
    rows = zip(*(v.tolist() for v in (*measured, compared.simulated)), strict=True)
    return tabulated(
        "Measured and simulated quantities",
        list(rows),
        [
            ("rail pressure, MPa", lambda r: significant(r[0], 4, MPA)),
            ("energising time, µs", lambda r: fixed(r[1], 1, MICRO)),
            ("measured, mm³", lambda r: fixed(r[2], 2, MM3)),
            ("simulated, mm³", lambda r: fixed(r[3], 2, MM3)),
            ("difference, mm³", lambda r: fixed(r[3] - r[2], 2, MM3)),
        ],
        f"Measured: {compared.source}.",
        0,
    )


def map_figures(
    found: Mapping[str, InjectionMap], compared: Comparison | None = None
) -> tuple[list[HeatMap], list[Figure]]:
    """Heat maps and curves of maps.

    Parameters
    ----------
    found : mapping of str to InjectionMap
    compared : Comparison, optional
    """
    labels = list(found)
    first = found[labels[0]]
    heats = [_inverse_heat(first, labels[0]), _quantity_heat(first, labels[0]), *band_heats(first, labels[0])]
    if len(labels) == 2:
        times, volumes = difference(first, found[labels[1]])
        what = f"{labels[1]} less {labels[0]}"
        heats += [_inverse_difference(first, times, what), _quantity_difference(first, volumes, what)]
    curves = [_curves(first, compared), _curves(first, compared, ZOOM), _inverse_curves(first)]
    return heats, curves


def _names(values: Floats, scale: float) -> tuple[str, ...]:
    return tuple(significant(v, 6, scale) for v in values.tolist())


def _inverse_heat(m: InjectionMap, label: str) -> HeatMap:
    values = m.inverse.energising_time.T * MICRO
    texts = tuple(
        tuple(f"{fixed(v, 0)}{MARKS.get(CellState(s), '')}" for v, s in zip(row, states, strict=True))
        for row, states in zip(values.tolist(), m.inverse.state.T.tolist(), strict=True)
    )
    return HeatMap(
        f"Energising time of {label}, µs",
        LEGEND,
        "rail pressure, MPa",
        "quantity, mm³",
        _names(m.axes.rail_pressure, MPA),
        _names(m.axes.quantity, MM3),
        tuple(points(row) for row in values.tolist()),
        texts,
        "µs",
    )


def _quantity_heat(m: InjectionMap, label: str) -> HeatMap:
    return _heat(m, m.volume.T * MM3, f"Injected quantity of {label}, mm³", 1)


def _quantity_difference(m: InjectionMap, volumes: Floats, what: str) -> HeatMap:
    return _heat(m, volumes.T * MM3, f"Difference of the quantities, {what}, mm³", 2, diverging=True)


def _heat(m: InjectionMap, values: Floats, title: str, decimals: int, diverging: bool = False) -> HeatMap:
    return HeatMap(
        title,
        "At the reference density; cells without a number could not be simulated.",
        "rail pressure, MPa",
        "energising time, µs",
        _names(m.axes.rail_pressure, MPA),
        _names(m.axes.energising_time, MICRO),
        tuple(points(row) for row in values.tolist()),
        tuple(tuple(fixed(v, decimals) for v in row) for row in values.tolist()),
        "mm³",
        diverging,
    )


def _inverse_difference(m: InjectionMap, times: Floats, what: str) -> HeatMap:
    values = times.T * MICRO
    return HeatMap(
        f"Difference of the energising times, {what}, µs",
        "Unreachable quantities by the stated rule in both.",
        "rail pressure, MPa",
        "quantity, mm³",
        _names(m.axes.rail_pressure, MPA),
        _names(m.axes.quantity, MM3),
        tuple(points(row) for row in values.tolist()),
        tuple(tuple(fixed(v, 1) for v in row) for row in values.tolist()),
        "µs",
        True,
    )


def _chosen(m: InjectionMap, compared: Comparison | None = None) -> Sequence[int]:
    """Rail pressures whose curves are drawn: the measured ones, or some evenly among all."""
    count = len(m.lines)
    if compared is not None:
        measured = [np.isclose(compared.measured.rail_pressure, line.rail_pressure).any() for line in m.lines]
        return np.flatnonzero(measured).tolist() or _chosen(m)
    return sorted({round(i * (count - 1) / max(min(CURVES, count) - 1, 1)) for i in range(min(CURVES, count))})


def _curves(m: InjectionMap, compared: Comparison | None, largest: float = np.inf) -> Figure:
    """Quantities over energising time, every simulated point; enlarged if there is a largest quantity."""
    series: list[Series] = []
    bands: list[Band] = []
    for family, row in enumerate(_chosen(m, compared)):
        bands += band_about(m, row, family, largest)
        line = m.lines[row]
        shown = np.flatnonzero(~(line.volume > largest))
        shown = shown[: int(np.argmax(np.diff(shown, append=-1) != 1)) + 1] if np.isfinite(largest) else shown
        label = f"{significant(line.rail_pressure, 4, MPA)} MPa"
        series.append(
            Series(label, "solid", points(line.time[shown] * MICRO), points(line.volume[shown] * MM3), family=family)
        )
        if compared is not None:
            measured = compared.measured
            at = np.isclose(measured.rail_pressure, line.rail_pressure) & (measured.volume <= largest)
            x, y = measured.energising_time[at] * MICRO, measured.volume[at] * MM3
            series.append(Series("", "measured", points(x), points(y), MARKERS, family))
    zoomed = np.isfinite(largest)
    return Figure(
        "Small quantities" if zoomed else "Quantity over energising time",
        "Each line is a rail pressure and joins all simulated points"
        + ("; markers are measured" if compared else "")
        + ("; areas are the 90 % bands of measured quantities." if bands else "."),
        "energising time, µs",
        (Panel("quantity, mm³", tuple(series), bands=tuple(bands)),),
    )


def _inverse_curves(m: InjectionMap) -> Figure:
    series = []
    for family, row in enumerate(_chosen(m)):
        simulated = m.inverse.state[row] != CellState.BEYOND
        x, y = m.axes.quantity[simulated] * MM3, m.inverse.energising_time[row, simulated] * MICRO
        label = f"{significant(m.axes.rail_pressure[row], 4, MPA)} MPa"
        series.append(Series(label, "solid", points(x), points(y), BOTH, family))
    return Figure(
        "Energising time over quantity",
        "The inverse map without its unreachable cells.",
        "quantity, mm³",
        (Panel("energising time, µs", tuple(series)),),
    )


def _arrays(found: InjectionMap) -> Arrays:
    forward, back = ("rail_pressure", "energising_time"), ("rail_pressure", "quantity")
    names = np.vectorize(lambda state: CellState(int(state)).name)
    axes = {
        "rail_pressure": in_common_unit(("rail_pressure",), found.axes.rail_pressure, "Pa"),
        "energising_time": in_common_unit(("energising_time",), found.axes.energising_time, "s"),
        "quantity": in_common_unit(("quantity",), found.axes.quantity, "m3"),
    }
    values = {
        "injected_volume": in_common_unit(forward, found.volume, "m3"),
        "ballistic": Array(forward, found.ballistic),
        "time_for_quantity": in_common_unit(back, found.inverse.energising_time, "s"),
        "state": Array(back, names(found.inverse.state)),
    }
    if found.bands is not None:
        for stem, axis, edges in (
            ("injected_volume", forward, found.bands.quantity),
            ("delivered", back, found.bands.delivered),
        ):
            for level, pair in edges.items():
                for side, volume in zip(("lower", "upper"), pair, strict=True):
                    values[f"{stem}_{100.0 * level:g}_{side}"] = in_common_unit(axis, volume, "m3")
    return Arrays(axes, values, f"Quantity map of {found.injector.name}")


def _all_figures(found: InjectionMap) -> list[HeatMap | Figure]:
    heats, curves = map_figures({found.injector.name: found})
    return [*heats, *curves]


INJECTION_MAP = Presenter(
    lambda m: map_lines({m.injector.name: m}), lambda m: map_tables({m.injector.name: m}), _all_figures, _arrays
)
