"""Report of a quantity map and its inverse: sentences, heat maps, curves, and special cells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, pairwise

import numpy as np

from commonrail.base.arrays import Floats, Ints
from commonrail.base.chart import BOTH, LINES, MARKERS, Band, Figure, HeatMap, Panel, Series, points
from commonrail.base.table import Table, table_from_columns
from commonrail.base.text import count_noun, join_words, megapascal, pressure, quantity, significant, to_fixed
from commonrail.data.records import MICROSECOND, MM3, MPA
from commonrail.physics.injector import Injector
from commonrail.plugins.maps.adjust import WORDS
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.difference import Comparison, difference
from commonrail.plugins.maps.inverse import TOLERANCE
from commonrail.plugins.maps.response import FALL
from commonrail.plugins.maps.run import InjectionMap
from commonrail.plugins.maps.table import describe_conditions
from commonrail.report.figure import drawings
from commonrail.report.fit.rules import CARE, GOOD, Tile
from commonrail.report.html import render
from commonrail.report.presenter import Array, Arrays, Presenter, in_common_unit

TIME = "energising_time"
ZOOM = 10e-9  # largest quantity of the enlarged curves [m³]
ISO_LINES = 8  # number of lines of equal quantity
ERRORS = (0.05, 0.15)  # relative errors at which measured points change colour
CURVES = 8  # number of rail pressures with a curve
MARKS = {CellState.SEVERAL: "‡", CellState.JUMP: "*", CellState.BEYOND: "†", CellState.FAILED: "–"}
REFERENCE = "At the reference density; cells without a number could not be simulated."
LEGEND = (
    "† unreachable, by the stated rule; ‡ several energising times deliver the quantity; * the quantity jumps past it."
)


def map_html(maps: Mapping[str, InjectionMap], compared: Comparison | None = None) -> str:
    """Report of one map, the first compared with measured data, or of two with their difference; maps by label."""
    heats, curves = map_figures(maps, compared)
    first = next(iter(maps.values()))
    return page(
        f"Quantity map: {' and '.join(maps)}",
        [m.injector for m in maps.values()],
        map_lines(maps, compared),
        curves,
        map_tables(maps, compared),
        facts=[("Conditions", "; ".join(describe_conditions(first)))],
        tiles=_tiles(first, compared),
        heats=heats,
        model=next(iter(maps)),
        kind="Map",
        notes=map_notes(maps),
    )


def page(
    title: str,
    injectors: Sequence[Injector],
    lines: Sequence[str],
    curves: Sequence[Figure],
    tables: Sequence[Table],
    *,
    facts: Sequence[tuple[str, str]],
    heats: Sequence[HeatMap] = (),
    tiles: Sequence[Tile] = (),
    kind: str = "Sweep",
    model: str = "",
    notes: Sequence[str] = (),
) -> str:
    """Page of maps or of a sweep; its first map is at the top, or its first curve where it has no map.

    A click on a cell of a map names the command that simulates `model` there.
    """
    drawn_maps, drawn_curves = list(drawings(heats, name="map")), list(drawings(curves, 380))
    first = next(iter([*drawn_maps, *drawn_curves]), None)
    return render(
        "map.html",
        package=__package__,
        title=title,
        kind=kind,
        synthetic=[injector.synthetic for injector in injectors if injector.synthetic],
        lines=lines,
        notes=notes,
        heats=drawn_maps[1:],
        tiles=tiles,
        first=first,
        curves=drawn_curves if drawn_maps else drawn_curves[1:],
        model=model,
        tables=tables,
        commands=[],
        facts=facts,
    )


def map_lines(maps: Mapping[str, InjectionMap], compared: Comparison | None = None) -> list[str]:
    """Sentences: error against measured data, size of the map, accuracy of its cells, and exceptions."""
    lines = []
    if compared is not None:
        large, small = significant(100.0 * compared.rms_large, 3), significant(compared.rms_small * MM3, 3)
        what = f"{len(compared.measured.volume)} measured quantities of {compared.source}"
        lines.append(f"Against {what}: rms {large} % above 3 mm³, {small} mm³ below.")
    return lines + [sentence for label, m in maps.items() for sentence in _lines(label if len(maps) > 1 else "", m)]


def map_notes(maps: Mapping[str, InjectionMap]) -> list[str]:
    """Sentences on the simulations and on the needle."""
    return [
        f"{label}: {m.simulations} injections were simulated; {int(m.inverse_ballistic.sum())} of all "
        f"{count_noun(m.inverse.state.size, 'cell')} are ballistic, reached or not: the needle turns round below its "
        "largest lift."
        for label, m in maps.items()
    ]


def _lines(label: str, m: InjectionMap) -> list[str]:
    inverse = m.inverse
    searched = np.isin(inverse.state, (CellState.REACHED, CellState.SEVERAL))
    miss = np.abs(inverse.delivered - m.axes.quantity)[searched]
    opening = f"{label}: " if label else ""
    lines = [
        f"{opening}{count_noun(len(m.axes.rail_pressure), 'rail pressure')} × "
        f"{count_noun(len(m.axes.quantity), 'quantity', 'quantities')}; {searched.sum()} of "
        f"{count_noun(inverse.state.size, 'cell')} have simulated energising times, which deliver their quantity "
        f"within {to_fixed(miss.max(initial=0.0), 3, MM3)} mm³."
    ]
    counts = {
        CellState.BEYOND: "hold a quantity that the longest energising time does not deliver",
        CellState.SEVERAL: "have several energising times",
        CellState.JUMP: "hold a quantity that is jumped past",
        CellState.FAILED: "could not be simulated",
    }
    exceptions = [f"{m.count(state)} {words}" for state, words in counts.items() if m.count(state)]
    if exceptions:
        lines.append(f"Of the cells{f' of {label}' if label else ''} {join_words(exceptions)}.")
    return [*lines, *_band_sentences(m), opening + _monotonicity(m)]


def _monotonicity(m: InjectionMap) -> str:
    if not m.falls:
        return f"Monotone: the quantity never falls by more than {to_fixed(FALL, 2, MM3)} mm³ with longer energising."
    pressures = join_words([megapascal(p) for p in sorted({fall.rail_pressure for fall in m.falls})])
    return (
        f"Not monotone: the quantity falls with longer energising at {count_noun(len(m.falls), 'place')}, at "
        f"{pressures} MPa; the table names them."
    )


def map_tables(maps: Mapping[str, InjectionMap], compared: Comparison | None = None) -> list[Table]:
    """Tables of falls, special cells, and largest differences."""
    tables = [_costs_table(maps), _falls_table(maps), _special_cells_table(maps), _pressure_falls_table(maps)]
    if compared is not None:
        tables.append(_comparison_table(compared))
    return [table for table in tables if table.rows]


def _costs_table(maps: Mapping[str, InjectionMap]) -> Table:
    return table_from_columns(
        "Quantity errors of the adjustments",
        [(label, cost) for label, m in maps.items() for cost in m.costs],
        [
            ("model", lambda r: r[0]),
            ("map", lambda r: "energising time" if r[1].inverse else "quantity"),
            ("step", lambda r: WORDS[r[1].step]),
            ("rms, mm³", lambda r: significant(r[1].rms, 3, MM3)),
            ("largest, mm³", lambda r: significant(r[1].largest, 3, MM3)),
            ("rail pressure, MPa", lambda r: megapascal(r[1].rail_pressure) if r[1].largest else ""),
            ("at", lambda r: quantity(r[1].at, "m3" if r[1].inverse else "s") if r[1].largest else ""),
        ],
        "Over all cells: quantity after the step minus quantity before it; simulated at both energising times.",
        3,
    )


def _falls_table(maps: Mapping[str, InjectionMap]) -> Table:
    return table_from_columns(
        "Places where the quantity falls with longer energising",
        [(label, fall) for label, m in maps.items() for fall in m.falls],
        [
            ("model", lambda r: r[0]),
            ("rail pressure, MPa", lambda r: megapascal(r[1].rail_pressure)),
            ("from, µs", lambda r: to_fixed(r[1].start, 1, MICROSECOND)),
            ("to, µs", lambda r: to_fixed(r[1].end, 1, MICROSECOND)),
            ("largest, mm³", lambda r: to_fixed(r[1].high, 2, MM3)),
            ("smallest, mm³", lambda r: to_fixed(r[1].low, 2, MM3)),
        ],
        f"Found on all simulated energising times, every 12.5 µs up to 500 µs; falls below {FALL * MM3:g} mm³ are not "
        "listed.",
    )


def _special_cells_table(maps: Mapping[str, InjectionMap]) -> Table:
    rows = []
    for label, m in maps.items():
        for (i, j), state in np.ndenumerate(m.inverse.state):
            if CellState(int(state)) in MARKS:
                rows.append((label, m.axes.rail_pressure[i], m.axes.quantity[j], m.inverse, (i, j)))
    return table_from_columns(
        "Special cells",
        rows,
        [
            ("model", lambda r: r[0]),
            ("meaning", lambda r: CellState(r[3].state[r[4]]).sentence),
            ("rail pressure, MPa", lambda r: megapascal(r[1])),
            ("quantity, mm³", lambda r: significant(r[2], 4, MM3)),
            ("energising time, µs", lambda r: to_fixed(r[3].energising_time[r[4]], 1, MICROSECOND)),
            ("delivered, mm³", lambda r: to_fixed(r[3].delivered[r[4]], 3, MM3)),
        ],
        f"All other cells deliver their quantity within {TOLERANCE * MM3:g} mm³"
        + (", before the adjustments." if any(m.costs for m in maps.values()) else "."),
        2,
        inputs=("meaning",),  # the sentences above count these
    )


def _pressure_falls_table(maps: Mapping[str, InjectionMap]) -> Table:
    rows = []
    for label, m in maps.items():
        for i, j in np.argwhere(m.falls_with_pressure):
            rows.append((label, m.axes.rail_pressure[i], m.axes.energising_time[j], m.volume[i - 1, j], m.volume[i, j]))
    return table_from_columns(
        "Cells whose quantity falls with the rail pressure",
        rows,
        [
            ("model", lambda r: r[0]),
            ("rail pressure, MPa", lambda r: megapascal(r[1])),
            ("energising time, µs", lambda r: to_fixed(r[2], 1, MICROSECOND)),
            ("at the pressure before, mm³", lambda r: to_fixed(r[3], 2, MM3)),
            ("here, mm³", lambda r: to_fixed(r[4], 2, MM3)),
        ],
        "At a higher rail pressure the valve opens later, and a short energising can inject less.",
    )


def _comparison_table(compared: Comparison) -> Table:
    measured = compared.measured
    rows = zip(*(v.tolist() for v in (*measured, compared.simulated)), strict=True)
    return table_from_columns(
        "Measured and simulated quantities",
        list(rows),
        [
            ("rail pressure, MPa", lambda r: megapascal(r[0])),
            ("energising time, µs", lambda r: to_fixed(r[1], 1, MICROSECOND)),
            ("measured, mm³", lambda r: to_fixed(r[2], 2, MM3)),
            ("simulated, mm³", lambda r: to_fixed(r[3], 2, MM3)),
            ("difference, mm³", lambda r: to_fixed(r[3] - r[2], 2, MM3)),
        ],
        f"Measured: {compared.source}.",
        0,
    )


def map_figures(
    maps: Mapping[str, InjectionMap], compared: Comparison | None = None
) -> tuple[list[HeatMap], list[Figure]]:
    """Heat maps and curves of maps."""
    labels = list(maps)
    first = maps[labels[0]]
    heats = list(_heats(first, labels[0]))
    if len(labels) == 2:
        times, volumes = difference(first, maps[labels[1]])
        what, caption = f"{labels[1]} less {labels[0]}", "Unreachable quantities by the stated rule in both."
        title, other = f"Difference of the energising times, {what}", f"Difference of the quantities, {what}"
        heats.append(_heat(first, "quantity", times, title, caption, 1, diverging=True))
        heats.append(_heat(first, TIME, volumes, other, REFERENCE, 2, diverging=True))
    quantities = [_curves(first, compared, largest) for largest in (np.inf, ZOOM)]
    return heats, [_iso_lines(first, compared), *quantities, _inverse_curves(first)]


def _heats(m: InjectionMap, label: str) -> Iterator[HeatMap]:
    """Energising times, quantities, and half widths of the widest band, if the map has bands."""
    inverse = m.inverse
    yield _heat(m, "quantity", inverse.energising_time, f"Energising time of {label}", LEGEND, states=inverse.state)
    yield _heat(m, TIME, m.volume, f"Injected quantity of {label}", REFERENCE, 1)
    if m.bands is not None:
        level = max(m.bands.quantity)
        caption = f"Share of measured quantities that are expected inside. Bands: {m.bands.estimator}."
        sources = (("quantity", "Inverse", m.bands.delivered), (TIME, "Quantity map", m.bands.quantity))
        for over, what, edges in sources:
            title = f"{what} of {label}: half width of the {to_fixed(level, 0, 100.0)} % band"
            yield _heat(m, over, _half_widths(edges[level]), title, caption, None)


def _heat(
    m: InjectionMap,
    over: str,
    values: Floats,
    title: str,
    caption: str,
    decimals: int | None = 0,
    *,
    states: Ints | None = None,
    diverging: bool = False,
) -> HeatMap:
    """Heat map of values (pressures, y) over an axis of the map: energising times [s] or volumes [m³].

    `decimals` sets the number format; half widths of bands have two significant digits, which is all that is known.
    A mark in a cell shows its state.
    """
    unit, scale = ("mm³", MM3) if over == TIME or decimals is None else ("µs", MICROSECOND)
    y_title, y_scale = ("energising time, µs", MICROSECOND) if over == TIME else ("quantity, mm³", MM3)
    marks = np.zeros(values.shape, np.int64) if states is None else states
    cells = (scale * values).T.tolist()

    def text(value: float, state: int) -> str:
        if decimals is None:
            return significant(value, 2) if np.isfinite(value) else ""
        return f"{to_fixed(value, decimals)}{MARKS.get(CellState(state), '')}"

    return HeatMap(
        f"{title}, {unit}",
        caption,
        "rail pressure, MPa",
        y_title,
        _names(m.axes.rail_pressure, MPA),
        _names(getattr(m.axes, over), y_scale),
        tuple(map(points, cells)),
        tuple(tuple(map(text, *row)) for row in zip(cells, marks.T.tolist(), strict=True)),
        unit,
        diverging,
    )


def _names(values: Floats, scale: float) -> tuple[str, ...]:
    return tuple(significant(v, 6, scale) for v in values.tolist())


def _half_widths(edges: tuple[Floats, Floats]) -> Floats:
    return np.asarray(0.5 * (edges[1] - edges[0]))


def _band_sentences(m: InjectionMap) -> list[str]:
    """Sentence on the widest band of a map and its cell; empty without bands."""
    if m.bands is None:
        return []
    level = max(m.bands.quantity)
    half = _half_widths(m.bands.delivered[level])
    if not np.isfinite(half).any():
        return ["No cell of the inverse has a band."]
    i, j = np.unravel_index(int(np.nanargmax(half)), half.shape)
    median, largest = (significant(float(value), 2, MM3) for value in (np.nanmedian(half), half[i, j]))
    return [
        f"{to_fixed(level, 0, 100.0)} % of measured quantities are expected within ±{median} mm³ of the inverse's "
        f"quantities in the median, within ±{largest} mm³ at most ({significant(m.axes.quantity[j], 4, MM3)} mm³ at "
        f"{megapascal(m.axes.rail_pressure[i])} MPa)."
    ]


def _band_about(m: InjectionMap, row: int, step: tuple[int, int], largest: float) -> tuple[Band, ...]:
    """Area of the widest band around the curve of a rail pressure, up to the largest quantity shown [m³].

    `step`: number of the pressure, and number of curves.
    """
    if m.bands is None:
        return ()
    low, high = (edge[row] for edge in m.bands.quantity[max(m.bands.quantity)])
    drawn = np.isfinite(low) & np.isfinite(high) & (m.volume[row] <= largest)
    x = points(m.axes.energising_time[drawn] * MICROSECOND)
    return (Band("solid", x, points(low[drawn] * MM3), points(high[drawn] * MM3), *step),) if x else ()


def _choose_pressures(m: InjectionMap, compared: Comparison | None = None) -> Sequence[int]:
    """Rail pressures with a curve: the measured ones, or some evenly spaced ones."""
    count = len(m.lines)
    if compared is not None:
        measured = [np.isclose(compared.measured.rail_pressure, line.rail_pressure).any() for line in m.lines]
        return np.flatnonzero(measured).tolist() or _choose_pressures(m)
    return sorted({round(i * (count - 1) / max(min(CURVES, count) - 1, 1)) for i in range(min(CURVES, count))})


def _curves(m: InjectionMap, compared: Comparison | None, largest: float) -> Figure:
    """Curves of quantity over energising time with every simulated point; enlarged if `largest` is given."""
    series: list[Series] = []
    bands: list[Band] = []
    rows = _choose_pressures(m, compared)
    for family, row in enumerate(rows):
        step = family, len(rows)
        bands += _band_about(m, row, step, largest)
        line = m.lines[row]
        shown = np.flatnonzero(~(line.volume > largest))
        shown = shown[: int(np.argmax(np.diff(shown, append=-1) != 1)) + 1] if np.isfinite(largest) else shown
        x, y = line.time[shown] * MICROSECOND, line.volume[shown] * MM3
        look = ("solid", "dash")[family % 2]
        series.append(Series(pressure(line.rail_pressure), look, points(x), points(y), LINES, *step))
        if compared is not None:
            measured = compared.measured
            at = np.isclose(measured.rail_pressure, line.rail_pressure) & (measured.volume <= largest)
            x, y = measured.energising_time[at] * MICROSECOND, measured.volume[at] * MM3
            series.append(Series("", "measured", points(x), points(y), MARKERS, *step))
    zoomed = np.isfinite(largest)
    return Figure(
        "Small quantities" if zoomed else "Quantity over energising time",
        "Each line is a rail pressure and joins all simulated points"
        + ("; markers are measured" if compared else "")
        + ("; areas are the 90 % bands of measured quantities." if bands else "."),
        "energising time, µs",
        (Panel("quantity, mm³", tuple(series), bands=tuple(bands)),),
    )


def _iso_lines(m: InjectionMap, compared: Comparison | None) -> Figure:
    """Lines of equal quantity over rail pressure and energising time, the ballistic limit, and measured points."""
    reached = np.isin(m.inverse.state, (CellState.REACHED, CellState.SEVERAL))
    columns = np.flatnonzero(reached.sum(axis=0) > 1)
    drawn = columns[np.unique(np.linspace(0, len(columns) - 1, min(ISO_LINES, len(columns))).round().astype(int))]
    rails = points(m.axes.rail_pressure * MPA)
    series = []
    for family, j in enumerate(drawn.tolist()):
        times = np.where(reached[:, j], m.inverse.energising_time[:, j], np.nan)
        label = f"{significant(m.axes.quantity[j], 4, MM3)} mm³"
        look = ("solid", "dash")[family % 2]
        series.append(Series(label, look, rails, points(times * MICROSECOND), family=family, ordered=len(drawn)))
    limit = [_ballistic_limit(m, i) for i in range(len(m.axes.rail_pressure))]
    if np.isfinite(limit).any():
        series.append(Series("ballistic below", "level", rails, points(np.array(limit) * MICROSECOND)))
    caption = "Each line is an injected quantity. Below the dotted line the needle turns round below its largest lift."
    if compared is not None:
        series += _comparison_series(compared)
        caption += f" Markers are measured: {compared.source}."
    return Figure(
        "Lines of equal quantity", caption, "rail pressure, MPa", (Panel("energising time, µs", tuple(series)),)
    )


def _ballistic_limit(m: InjectionMap, row: int) -> float:
    """Middle between the longest ballistic energising time of the map and the next [s]; NaN if one is missing."""
    ballistic = np.flatnonzero(m.ballistic[row])
    times = m.axes.energising_time
    if not len(ballistic) or ballistic[-1] + 1 == len(times):
        return float("nan")
    return float(0.5 * (times[ballistic[-1]] + times[ballistic[-1] + 1]))


def _comparison_series(compared: Comparison) -> Iterator[Series]:
    """Measured points, coloured by the relative error of the simulated quantity."""
    measured = compared.measured
    error = np.full(measured.volume.shape, np.nan)  # undefined for a measured zero
    np.divide(np.abs(compared.simulated - measured.volume), measured.volume, error, where=measured.volume > 0.0)
    for (low, high), family in zip(pairwise((0.0, *ERRORS, np.inf)), (2, 1, 7), strict=True):
        at = (error >= low) & (error < high)
        text = f"above {100 * low:g} %" if high == np.inf else f"{100 * low:g} to {100 * high:g} %"
        if at.any():
            x, y = measured.rail_pressure[at] * MPA, measured.energising_time[at] * MICROSECOND
            yield Series(f"error {text}", "measured", points(x), points(y), MARKERS, family)


def _tiles(m: InjectionMap, compared: Comparison | None) -> list[Tile]:
    reached = int(np.isin(m.inverse.state, (CellState.REACHED, CellState.SEVERAL)).sum())
    falls = len(m.falls)
    tiles = [
        Tile("cells", f"{reached} of {m.inverse.state.size}", "deliver their quantity"),
        Tile(
            "ballistic",
            f"{int(m.inverse_ballistic.sum())} of {m.inverse.state.size}",
            "cells, whether or not they deliver their quantity",
        ),
        Tile(
            "with longer energising",
            f"falls at {count_noun(falls, 'place')}" if falls else "never falls",
            f"by more than {to_fixed(FALL, 2, MM3)} mm³",
            CARE if falls else GOOD,
        ),
    ]
    if compared is not None:
        words = f"rms above 3 mm³, {significant(compared.rms_small, 3, MM3)} mm³ below; {compared.source}"
        tiles.insert(0, Tile("against measured", f"{significant(100.0 * compared.rms_large, 3)} %", words))
    return tiles


def _inverse_curves(m: InjectionMap) -> Figure:
    series, rows = [], _choose_pressures(m)
    for family, row in enumerate(rows):
        simulated = m.inverse.state[row] != CellState.BEYOND
        x, y = m.axes.quantity[simulated] * MM3, m.inverse.energising_time[row, simulated] * MICROSECOND
        series.append(
            Series(
                pressure(m.axes.rail_pressure[row]),
                ("solid", "dash")[family % 2],
                points(x),
                points(y),
                BOTH,
                family,
                len(rows),
            )
        )
    return Figure(
        "Energising time over quantity",
        "The inverse map without its unreachable cells.",
        "quantity, mm³",
        (Panel("energising time, µs", tuple(series)),),
    )


def _arrays(m: InjectionMap) -> Arrays:
    forward, back = ("rail_pressure", "energising_time"), ("rail_pressure", "quantity")
    names = np.vectorize(lambda state: CellState(int(state)).name)
    units = {"rail_pressure": "Pa", "energising_time": "s", "quantity": "m3"}
    axes = {name: in_common_unit((name,), getattr(m.axes, name), unit) for name, unit in units.items()}
    values = {
        "injected_volume": in_common_unit(forward, m.volume, "m3"),
        "ballistic": Array(forward, m.ballistic),
        "time_for_quantity": in_common_unit(back, m.inverse.energising_time, "s"),
        "state": Array(back, names(m.inverse.state)),
    }
    if m.bands is not None:
        sources = (("injected_volume", forward, m.bands.quantity), ("delivered", back, m.bands.delivered))
        for stem, axis, edges in sources:
            for level, pair in edges.items():
                for side, volume in zip(("lower", "upper"), pair, strict=True):
                    values[f"{stem}_{100.0 * level:g}_{side}"] = in_common_unit(axis, volume, "m3")
    return Arrays(axes, values, f"Quantity map of {m.injector.name}")


INJECTION_MAP = Presenter(
    lambda m: [*map_lines({m.injector.name: m}), *map_notes({m.injector.name: m})],
    lambda m: map_tables({m.injector.name: m}),
    lambda m: list(chain(*map_figures({m.injector.name: m}))),
    _arrays,
)
