"""Injectors of a fleet beside one another: classes, correlations, outliers, and each one's values."""

from __future__ import annotations

from typing import Any

from commonrail.display.chart import Figure, Panel, Series, points
from commonrail.display.heat_map import HeatMap
from commonrail.display.table import Table, tabulated
from commonrail.display.text import quantity, signed, significant
from commonrail.kinds.records import Record

__all__ = ["correlation_map", "each_injector", "histograms", "outlier_table"]


def histograms(record: Record, names: dict[str, str]) -> list[Figure]:
    """Histogram of each parameter between its bounds.

    Parameters
    ----------
    record : mapping
        Of the fleet.
    names : dict of str to str
        Short name of each parameter.
    """
    found = record.get("population", {}).get("histograms", {})
    return [_histogram(names.get(name, name), one) for name, one in found.items()]


def _histogram(name: str, found: Record) -> Figure:
    edges, counts = found["edges"], found["counts"]
    x = points(100.0 * edge for edge in edges for _ in (0, 1))
    y = (0.0, *(float(count) for count in counts for _ in (0, 1)), 0.0)
    panel = Panel("injectors", (Series("", "solid", x, y, family=0),))
    return Figure(
        name, "Number of injectors in each class of 5 % of the range.", "place between the bounds, %", (panel,)
    )


def correlation_map(record: Record, names: dict[str, str]) -> HeatMap | None:
    """Correlations of the parameters with one another and with J; None where there are none.

    Parameters
    ----------
    record : mapping
        Of the fleet.
    names : dict of str to str
        Short name of each parameter.
    """
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
        tuple(tuple("" if value is None else signed(value, 2) for value in row) for row in matrix),
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

    return tabulated(
        "Outliers",
        record.get("population", {}).get("outliers", []),
        [
            ("injector", "injector"),
            ("of", "name"),
            ("value", lambda row: amount(row, "value")),
            ("median of the fleet", lambda row: amount(row, "median")),
            ("standard deviations", lambda row: signed(row["deviations"], 1)),
        ],
        "Beyond 3.5 standard deviations from the median, by the median absolute deviation.",
        2,
    )


def each_injector(record: Record) -> dict[str, Any]:
    """Names, units and values that the page shows of an injector on demand; empty if none is calibrated."""
    found = record.get("population")
    if not found or not found["each"]:
        return {}
    parameters = [
        {
            "name": p["name"],
            "unit": p["unit"].removesuffix("1"),
            "median": p["best"]["median"],
            "lower": p["lower"],
            "upper": p["upper"],
        }
        for p in record["parameters"]
    ]
    return {"parameters": parameters, "each": found["each"], "more": found["more"]}
