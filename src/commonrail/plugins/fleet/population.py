"""Calibrated injectors of a fleet beside one another: classes, correlations, outliers, and each one's values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import Figure, HeatMap, Panel, Series, points
from commonrail.base.table import Table, table_from_columns
from commonrail.base.text import quantity, shown_unit, significant, to_signed
from commonrail.data.records import Record
from commonrail.plugins.fleet.journal import Entry

BINS = 20  # classes of a histogram
FAR = 3.5  # robust standard deviations from the median beyond which a value is an outlier
MOST_OUTLIERS = 200
MOST_NUMBERS = 60_000  # values of single injectors that the page holds
FEWEST = 4  # injectors from which a correlation or an outlier is told
_TO_SIGMA = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


def population_record(finished: Sequence[Entry], names: Sequence[str]) -> dict[str, Any]:
    """Histograms, correlations, outliers and values of the injectors that are calibrated, by free parameters' names.

    "histograms" of the places between the bounds have "edges" and "counts"; "correlations", Pearson's, are of the
    parameters and J, None where something does not vary; "outliers", the farthest first; "each", injectors with their J
    and values, and whether there are "more".
    """
    values = np.array([[e.record["parameters"][name]["best"] for name in names] for e in finished], float)
    places = np.array([[e.record["parameters"][name]["position"] for name in names] for e in finished], float)
    costs = np.array([e.record["J"]["best"] for e in finished], float)
    shape = len(finished), len(names)
    values, places = values.reshape(shape), places.reshape(shape)
    return {
        "histograms": {name: _histogram(places[:, i]) for i, name in enumerate(names)},
        "correlations": _correlations(np.column_stack([places, costs])),
        "outliers": _outliers(finished, ["J", *names], np.column_stack([costs, values])),
        **_each(finished, values, costs),
    }


def _histogram(places: Floats) -> Mapping[str, Any]:
    counts, edges = np.histogram(np.clip(places, 0.0, 1.0), BINS, (0.0, 1.0))
    return {"edges": edges.tolist(), "counts": counts.tolist()}


def _correlations(columns: Floats) -> list[list[float | None]]:
    """Matrix (d, d) of the columns of (n, d)."""
    if len(columns) < FEWEST:
        return []
    deviations = columns - columns.mean(axis=0)
    sizes = np.sqrt((deviations**2).sum(axis=0))
    varies = sizes > 1e-9 * np.maximum(np.abs(columns).max(axis=0), 1e-300) * np.sqrt(len(columns))
    matrix = np.full((columns.shape[1],) * 2, np.nan)
    unit = deviations[:, varies] / sizes[varies]
    matrix[np.ix_(varies, varies)] = np.clip(unit.T @ unit, -1.0, 1.0)
    return [[None if np.isnan(v) else round(float(v), 4) for v in row] for row in matrix]


def _outliers(finished: Sequence[Entry], names: Sequence[str], columns: Floats) -> list[dict[str, Any]]:
    """Values far from the median of the fleet, by the median absolute deviation."""
    if len(finished) < FEWEST:
        return []
    median = np.median(columns, axis=0)
    scatter = _TO_SIGMA * np.median(np.abs(columns - median), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(scatter > 0.0, (columns - median) / scatter, 0.0)
    rows, columns_far = np.nonzero(np.abs(far) > FAR)
    order = np.argsort(-np.abs(far[rows, columns_far]), kind="stable")[:MOST_OUTLIERS]
    return [
        {
            "injector": finished[i].name,
            "name": names[j],
            "value": float(columns[i, j]),
            "median": float(median[j]),
            "deviations": round(float(far[i, j]), 2),
        }
        for i, j in zip(rows[order].tolist(), columns_far[order].tolist(), strict=True)
    ]


def _each(finished: Sequence[Entry], values: Floats, costs: Floats) -> dict[str, Any]:
    """Values of single injectors; of many the worst."""
    most = max(MOST_NUMBERS // max(values.shape[1] + 2, 1), 1)
    shown = np.sort(np.argsort(-costs, kind="stable")[:most])
    each = [
        {
            "injector": finished[i].name,
            "J": [finished[i].record["J"]["start"], float(costs[i])],
            "values": [float(f"{v:.5g}") for v in values[i].tolist()],
        }
        for i in shown.tolist()
    ]
    return {"each": each, "more": len(finished) - len(each)}


# Injectors of a fleet beside one another: classes, correlations, outliers, and each one's values.


def histograms(record: Record, names: dict[str, str]) -> list[Figure]:
    """Histogram of each parameter between its bounds; `names` are short names of the parameters."""
    histogram_records = record.get("population", {}).get("histograms", {})
    return [_population_histogram(names.get(name, name), histogram) for name, histogram in histogram_records.items()]


def _population_histogram(name: str, histogram: Record) -> Figure:
    edges, counts = histogram["edges"], histogram["counts"]
    x = points(100.0 * edge for edge in edges for _ in (0, 1))
    y = (0.0, *(float(count) for count in counts for _ in (0, 1)), 0.0)
    panel = Panel("injectors", (Series("", "solid", x, y, family=0),))
    return Figure(
        name, "Number of injectors in each class of 5 % of the range.", "place between the bounds, %", (panel,)
    )


def correlation_map(record: Record, names: dict[str, str]) -> HeatMap | None:
    """Correlations of the parameters with one another and with J; None where there are none."""
    matrix = record.get("population", {}).get("correlations", [])
    if not matrix:
        return None
    labels = (*names.values(), "J")
    return HeatMap(
        "Correlations",
        "Pearson's correlation over the fleet of the places between the bounds, and of J. Near ±1 two parameters "
        "compensate each other, or the parts vary together.",
        "",
        "",
        labels,
        labels,
        tuple(tuple(row) for row in matrix),
        tuple(tuple("" if value is None else to_signed(value, 2) for value in row) for row in matrix),
        "",
        True,
        1.0,
    )


def outlier_table(record: Record) -> Table:
    """Values far from those of the fleet."""
    units = {p["name"]: p["unit"] for p in record["parameters"]} | {"J": ""}

    def amount(row: Record, key: str) -> str:
        unit = units.get(row["name"], "")
        return quantity(row[key], unit) if unit else significant(row[key])

    return table_from_columns(
        "Outliers",
        record.get("population", {}).get("outliers", []),
        [
            ("injector", "injector"),
            ("of", "name"),
            ("value", lambda row: amount(row, "value")),
            ("median of the fleet", lambda row: amount(row, "median")),
            ("standard deviations", lambda row: to_signed(row["deviations"], 1)),
        ],
        "Beyond 3.5 standard deviations from the median, by the median absolute deviation.",
        2,
    )


def each_injector(record: Record) -> dict[str, Any]:
    """Names, units and values that the page shows of an injector on demand; empty if none is calibrated."""
    population = record.get("population")
    if not population or not population["each"]:
        return {}
    units = [shown_unit(p["upper"] or p["best"]["median"], p["unit"]) for p in record["parameters"]]
    parameters = [
        {
            "name": p["name"],
            "unit": unit,
            "median": factor * p["best"]["median"],
            **{end: None if p[end] is None else factor * p[end] for end in ("lower", "upper")},
        }
        for p, (unit, factor) in zip(record["parameters"], units, strict=True)
    ]
    each = [
        {**injector, "values": [factor * v for v, (_, factor) in zip(injector["values"], units, strict=True)]}
        for injector in population["each"]
    ]
    return {"parameters": parameters, "each": each, "more": population["more"]}
