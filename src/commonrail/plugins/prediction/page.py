"""Predictions with bands: tables, and displays in notebooks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from commonrail.base.chart import BOTH, LINES, MARKERS, Chart, Figure, Panel, Series, points
from commonrail.base.chart import Band as Area
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import MISSING, count_noun, field_unit, join_words, pressure, significant, to_fixed
from commonrail.calibration.study import Study
from commonrail.data.records import Record, origin_word
from commonrail.plugins.prediction.band import Band
from commonrail.plugins.prediction.run import Prediction
from commonrail.report.analysis import result_html
from commonrail.report.fit.rules import Tile
from commonrail.report.presenter import Array, Arrays, Presenter, in_common_unit

_MM3 = 1e9
LEAST = 0.5e-9  # quantity above which the width of its band is drawn as a share [m³]
TILES = 5  # data sets on the first screen
SETS = 4  # data sets that a sentence names


def coverage_table(record: Record) -> Table:
    """Share of the measured values of each data set that lie inside the bands of a `Prediction.record`."""
    columns: list[Column] = [
        ("data set", lambda r: r[0]["name"]),
        ("use", lambda r: r[0]["role"] or MISSING),
        ("band, %", lambda r: to_fixed(r[1]["level"], 0, 100.0)),
        ("measured values inside", lambda r: MISSING if r[1]["covered"] is None else str(r[1]["covered"])),
        ("of", lambda r: str(r[0]["judged"])),
        ("median half width, % of the prediction", lambda r: significant(r[1]["median_half_width_percent"], 3)),
    ]
    note = f"Bands: {record['estimator']}."
    if any(data["role"] == "fit" for data in record["data"]):
        note += " The fit used the fitted values: only the other values test its bands."
    rows = [(data, band) for data in record["data"] for band in data["bands"]]
    return table_from_columns("Measured values inside the bands", rows, columns, note, 2)


def points_table(record: Record) -> Table:
    """Predicted quantities and their bands of a `Prediction.record` of operating points."""
    (data,) = record["data"]

    def edges(band: Record) -> Callable[[int], str]:
        return lambda i: f"{significant(band['lower'][i], 4, _MM3)} to {significant(band['upper'][i], 4, _MM3)}"

    columns: list[Column] = [
        ("rail pressure, MPa", lambda i: significant(data["points"][i]["rail_pressure"], 6, 1e-6)),
        ("energising time, µs", lambda i: significant(data["points"][i]["energising_time"], 6, 1e6)),
        ("quantity, mm³", lambda i: significant(data["values"][i], 4, _MM3)),
        *((f"{to_fixed(band['level'], 0, 100.0)} % band, mm³", edges(band)) for band in data["bands"]),
    ]
    note = f"Bands: {record['estimator']}."
    return table_from_columns("Predicted quantities", range(len(data["values"])), columns, note, 0)


def prediction_html(prediction: Prediction, study: Study) -> str:
    """Page of predictions for a study."""
    tiles = [_tile(band, max(prediction.levels)) for band in prediction.bands[:TILES]]
    return result_html(
        "Predictions", study, prediction_lines(prediction), tiles, prediction_figures(prediction), _tables(prediction)
    )


def _tile(band: Band, level: float) -> Tile:
    """Width of the widest band of a data set, and the measured values inside."""
    head, words = band.data.name, f"median half width of the {to_fixed(level, 0, 100.0)} % band"
    if band.measured:
        head += f" ({band.data.role.value})"
        words += f"; {band.covered(level)} of {int(band.data.judged.sum())} measured values inside"
    return Tile(head, f"± {to_fixed(band.half_width(level), 1, 100.0)} %", words)


def prediction_figures(prediction: Prediction) -> list[Chart]:
    """Each data set with its widest band: rates over time, quantities over energising time by rail pressure."""
    level = max(prediction.levels)
    return [figure for band in prediction.bands if (figure := _figure(band, level))]


def _figure(band: Band, level: float) -> Figure | None:
    """None where several values share a place, as features do."""
    data, unit = band.data, field_unit(band.data.unit)
    judged = np.flatnonzero(data.judged)
    rails = np.array([point.initial_pressures()[0] for point in data.points])
    axis, mode, groups, name = "time, µs", LINES, [judged], "Thick line"
    if data.bounds is not None:
        x = 0.5e6 * (data.bounds[1:] + data.bounds[:-1])
    else:
        axis, mode, name = "energising time, µs", MARKERS, "Markers"
        x = 1e6 * np.array([point.pulses[-1].duration if point.pulses else 0.0 for point in data.points])
        groups = [judged[rails[judged] == rail] for rail in np.unique(rails[judged])]
    series, bands, widths = [], [], []
    for family, group in enumerate(groups):
        rows = group[np.argsort(x[group])]
        if len(np.unique(x[rows])) < len(rows):
            return None
        colour_group, step = points(x[rows]), (family, len(groups)) if mode == MARKERS else ()
        low, high = (points(unit.factor * edge[rows]) for edge in band.edges[level])
        if len(groups) == 1 or band.measured:
            bands.append(Area("best", colour_group, low, high, *step))
        else:  # overlapping bands are indistinguishable: draw lines for their edges, and their widths below
            series += [Series("", "start", colour_group, edge, LINES, *step) for edge in (low, high)]
            half_widths = 0.5 * (band.edges[level][1] - band.edges[level][0])[rows]
            values = band.values[rows]
            shares = [100.0 * h / v if v > LEAST else None for h, v in zip(half_widths, values, strict=True)]
            widths.append(Series("", "best", colour_group, tuple(shares), BOTH, *step))
        if band.measured:
            measured = np.asarray(data.measured, float)[rows]
            series.append(Series("", "measured", colour_group, points(unit.factor * measured), mode, *step))
        label = pressure(rails[rows[0]]) if mode == MARKERS else "predicted"
        drawn = BOTH if mode == MARKERS and not band.measured else LINES  # a grid has kinks at its points
        series.append(Series(label, "best", colour_group, points(unit.factor * band.values[rows]), drawn, *step))
    look = "dotted" if widths else "shaded"
    caption = f"Lines: predicted; {look}: {to_fixed(level, 0, 100.0)} % band of measured values."
    if widths:
        caption += " Below, half the width of the band over the prediction."
    if band.measured:
        caption += f" {name}: {origin_word({'synthetic': data.synthetic})}."
    panel = Panel(f"{data.kind.replace('quantities', 'quantity')}, {unit.text}", tuple(series), bands=tuple(bands))
    more = (Panel("half width, %", tuple(widths), 0.5, logarithmic=True),) if widths else ()
    return Figure(data.name, caption, axis, (panel, *more))


def prediction_lines(prediction: Prediction) -> list[str]:
    """Measured values inside the widest bands, number of predicted values, and the estimator."""
    level = max(prediction.levels)
    inside = [
        f"{band.covered(level)} of {int(band.data.judged.sum())} values of {band.data.name} ({band.data.role.value})"
        for band in prediction.bands
        if band.measured
    ]
    if len(inside) > SETS:
        inside = [*inside[:SETS], f"{len(inside) - SETS} further data sets"]
    verdict = [f"The {to_fixed(level, 0, 100.0)} % bands hold {join_words(inside)}."] if inside else []
    levels = " and ".join(to_fixed(level, 0, 100.0) for level in prediction.levels)
    sets = [f"{count_noun(len(band.values), 'value')} of {band.data.name}" for band in prediction.bands]
    if len(sets) > SETS:
        sets = [*sets[:SETS], f"{len(sets) - SETS} further data sets"]
    return [*verdict, f"{join_words(sets)} with bands of {levels} %.", f"Bands: {prediction.estimator}."]


def _tables(prediction: Prediction) -> list[Table]:
    """Predicted quantities of operating points, or how many measured values the bands hold."""
    record = prediction.record()
    return [coverage_table(record) if any(band.measured for band in prediction.bands) else points_table(record)]


def _arrays(prediction: Prediction) -> Arrays:
    """Predicted values with the edges of their bands; a column names the units if they differ."""
    bands, axis = prediction.bands, ("value",)
    units = [band.data.unit for band in bands]
    counts = [len(band.values) for band in bands]
    parts = [band.columns(prediction.levels) for band in bands]
    joined = {name: np.concatenate([columns[name] for columns in parts]) for name in parts[0]}
    common = units[0] if len(set(units)) == 1 else ""
    values = {"data_set": Array(axis, np.repeat([band.data.name for band in bands], counts))}
    for name, column in joined.items():
        unit = {"rail_pressure": "Pa", "energising_time": "s", "start": "s", "end": "s"}.get(name, common)
        values[name] = in_common_unit(axis, column, unit) if unit else Array(axis, column)
    if not common:
        values["unit"] = Array(axis, np.repeat(units, counts))
    return Arrays({"value": Array(axis, np.arange(len(joined["predicted"])))}, values, "Predictions with bands")


PREDICTION = Presenter(prediction_lines, _tables, prediction_figures, _arrays)
