"""Distribution of the calibrated injectors of a fleet: histograms, correlations, outliers, values of each injector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import Figure, HeatMap, Panel, Series, points
from commonrail.base.record import Key
from commonrail.base.table import Table, table_from_columns
from commonrail.base.text import quantity, significant, to_signed
from commonrail.plugins.fleet.journal import Entry

BINS = 20  # classes of a histogram
FAR = 3.5  # robust standard deviations from the median beyond which a value is an outlier
MOST_OUTLIERS = 200
MOST_NUMBERS = 60_000  # values of single injectors on the page
FEWEST = 4  # injectors needed for a correlation or an outlier
_TO_SIGMA = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


class Histogram(NamedTuple):
    """Numbers of injectors by position between the bounds: edges (n + 1,) and counts (n,)."""

    edges: tuple[float, ...]
    counts: tuple[int, ...]


class Outlier(NamedTuple):
    """Value far from the median of the fleet, in robust standard deviations; `name`: a parameter [SI] or "J"."""

    injector: str
    name: str
    value: float
    median: float
    deviations: float


class InjectorValues(NamedTuple):
    """Start and best objective of an injector, and its calibrated values."""

    injector: str
    cost: Annotated[tuple[float | None, float], Key("J")]
    values: tuple[float, ...]


class Population(NamedTuple):
    """Distribution of the calibrated injectors.

    Attributes
    ----------
    histograms : mapping of str to Histogram
    correlations : tuple of tuple of float or None
        Pearson's, of the parameters and J; None without variation.
    outliers : tuple of Outlier
        The farthest first.
    each : tuple of InjectorValues
    more : int
        Number of injectors left out of `each`.
    """

    histograms: Mapping[str, Histogram]
    correlations: tuple[tuple[float | None, ...], ...]
    outliers: tuple[Outlier, ...]
    each: tuple[InjectorValues, ...]
    more: int


def describe_population(finished: Sequence[Entry], names: Sequence[str]) -> Population:
    """Return the distribution of the calibrated injectors; `names`: free parameters."""
    parameters = [[entry.result.parameters[name] for name in names] for entry in finished]
    shape = len(finished), len(names)
    values = np.array([[p.best for p in row] for row in parameters], float).reshape(shape)
    places = np.array([[p.position for p in row] for row in parameters], float).reshape(shape)
    costs = np.array([entry.result.best_cost for entry in finished], float)
    each = _list_injectors(finished, values, costs)
    return Population(
        {name: _count(places[:, i]) for i, name in enumerate(names)},
        _correlations(np.column_stack([places, costs])),
        _outliers(finished, ["J", *names], np.column_stack([costs, values])),
        each,
        len(finished) - len(each),
    )


def _count(places: Floats) -> Histogram:
    counts, edges = np.histogram(np.clip(places, 0.0, 1.0), BINS, (0.0, 1.0))
    return Histogram(tuple(edges.tolist()), tuple(counts.tolist()))


def _correlations(columns: Floats) -> tuple[tuple[float | None, ...], ...]:
    """Correlation matrix (d, d) of the columns of (n, d)."""
    if len(columns) < FEWEST:
        return ()
    deviations = columns - columns.mean(axis=0)
    sizes = np.sqrt((deviations**2).sum(axis=0))
    varies = sizes > 1e-9 * np.maximum(np.abs(columns).max(axis=0), 1e-300) * np.sqrt(len(columns))
    matrix = np.full((columns.shape[1],) * 2, np.nan)
    unit = deviations[:, varies] / sizes[varies]
    matrix[np.ix_(varies, varies)] = np.clip(unit.T @ unit, -1.0, 1.0)
    return tuple(tuple(None if np.isnan(v) else round(float(v), 4) for v in row) for row in matrix)


def _outliers(finished: Sequence[Entry], names: Sequence[str], columns: Floats) -> tuple[Outlier, ...]:
    """Values far from the median of the fleet, in units of the scaled median absolute deviation."""
    if len(finished) < FEWEST:
        return ()
    median = np.median(columns, axis=0)
    scatter = _TO_SIGMA * np.median(np.abs(columns - median), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(scatter > 0.0, (columns - median) / scatter, 0.0)
    rows, columns_far = np.nonzero(np.abs(far) > FAR)
    order = np.argsort(-np.abs(far[rows, columns_far]), kind="stable")[:MOST_OUTLIERS]
    return tuple(
        Outlier(finished[i].name, names[j], float(columns[i, j]), float(median[j]), round(float(far[i, j]), 2))
        for i, j in zip(rows[order].tolist(), columns_far[order].tolist(), strict=True)
    )


def _list_injectors(finished: Sequence[Entry], values: Floats, costs: Floats) -> tuple[InjectorValues, ...]:
    """Values of single injectors; only the worst if there are many."""
    most = max(MOST_NUMBERS // max(values.shape[1] + 2, 1), 1)
    shown = np.sort(np.argsort(-costs, kind="stable")[:most]).tolist()
    return tuple(
        InjectorValues(
            finished[i].name,
            (finished[i].result.cost.start, float(costs[i])),
            tuple(float(f"{v:.5g}") for v in values[i].tolist()),
        )
        for i in shown
    )


# Figures and tables of the distribution.


def histograms(population: Population | None, names: Mapping[str, str]) -> list[Figure]:
    """Histogram of each parameter between its bounds; `names`: short names of the parameters."""
    counted = population.histograms if population else {}
    return [_draw_histogram(names.get(name, name), histogram) for name, histogram in counted.items()]


def _draw_histogram(name: str, histogram: Histogram) -> Figure:
    x = points(100.0 * edge for edge in histogram.edges for _ in (0, 1))
    y = (0.0, *(float(count) for count in histogram.counts for _ in (0, 1)), 0.0)
    panel = Panel("injectors", (Series("", "solid", x, y, family=0),))
    return Figure(name, "Number of injectors in each 5 % of the range.", "position between the bounds, %", (panel,))


def correlation_map(population: Population | None, names: Mapping[str, str]) -> HeatMap | None:
    """Correlations of the parameters and J; None without any."""
    if not population or not population.correlations:
        return None
    labels = (*names.values(), "J")
    return HeatMap(
        "Correlations",
        "Pearson's correlation over the fleet, of the positions between the bounds and of J. Near ±1 two parameters "
        "compensate each other, or vary together between the parts.",
        "",
        "",
        labels,
        labels,
        population.correlations,
        tuple(tuple("" if value is None else to_signed(value, 2) for value in row) for row in population.correlations),
        "",
        True,
        1.0,
    )


def outlier_table(population: Population | None, units: Mapping[str, str]) -> Table:
    """Table of the values far from the median of the fleet; `units`: of the parameters."""

    def amount(name: str, value: float) -> str:
        return quantity(value, units[name]) if units.get(name) else significant(value)

    return table_from_columns(
        "Outliers",
        population.outliers if population else (),
        [
            ("injector", lambda row: row.injector),
            ("quantity", lambda row: row.name),
            ("value", lambda row: amount(row.name, row.value)),
            ("median of the fleet", lambda row: amount(row.name, row.median)),
            ("standard deviations", lambda row: to_signed(row.deviations, 1)),
        ],
        "Values beyond 3.5 standard deviations from the median, estimated from the median absolute deviation.",
        2,
    )
