"""Interface by which reports show a kind of measured data."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from commonrail.base import registry
from commonrail.base.chart import Figure, Points, Series
from commonrail.base.errors import InputError
from commonrail.base.table import Part, Table, mark_least
from commonrail.base.text import MISSING, number
from commonrail.data.records import JUDGED, Record, Texts, Traces


class Shown(NamedTuple):
    """Look of a model in figures: text of the legend, and look and family of its `Series`."""

    text: str
    look: str
    family: int | None = None


Models = Mapping[str, Shown]  # by label, in order


class Plotted(NamedTuple):
    """Content of figures in addition to a record: models, and time series by data set."""

    models: Models
    traces: Traces


class Merit(NamedTuple):
    """Figure of merit on the first page of a report: the figure with its unit, and a description.

    For several data sets, `figure` is the worst; `others` lists the figure of each.
    """

    figure: str
    words: str
    others: str = ""


class FitError(NamedTuple):
    """Error of a calibrated model on data, relative to the measured values or `in_tolerances` of the study."""

    size: float
    in_tolerances: bool = False
    tolerance: float = 0.0


class View(ABC):
    """Content of reports on records of one kind: tables, figures and sentences, as plain data."""

    def has(self, data: Record, label: str) -> bool:
        """True if a model has any number for the data set, by default for any of its rows."""
        return any(number(row.get(label)) is not None for row in data["rows"])

    @abstractmethod
    def operating_point(self, data: Record) -> Record:
        """One of the data set's operating points, to simulate it again."""

    def operating_points(self, data: Record) -> Sequence[Record]:
        """All of the data set's operating points."""
        return [self.operating_point(data)]

    @abstractmethod
    def merit(self, data: Sequence[Record], label: str = JUDGED) -> Merit:
        """Error of a model on data sets, and of the start values if there are any."""

    def fit_error(self, data: Record) -> FitError | None:
        """Error of the calibrated model on a data set, by default in tolerances; None without a figure."""
        size = number(data.get("rms", {}).get(JUDGED))
        return None if size is None else FitError(size, in_tolerances=True)

    def quantity_merit(self, data: Sequence[Record]) -> Merit | None:
        """Error of the quantity per stroke, where `merit` does not say it."""
        return None

    def quantities(self, data: Record) -> list[tuple[float, float | None]]:
        """Measured and calibrated quantities per stroke [m³]."""
        return []

    @abstractmethod
    def leading(self, data: Sequence[Record]) -> tuple[str, list[Mapping[str, Any]]]:
        """Measure of the best model of a comparison, and the errors by label of each data set."""

    @abstractmethod
    def tables(self, data: Sequence[Record], texts: Texts) -> list[Table]:
        """Tables of a calibration; errors and shares refer to the label "best", whatever its text."""

    @abstractmethod
    def compared_tables(self, data: Sequence[Record], labels: Sequence[str]) -> list[Table]:
        """Tables of a comparison: a column for each model, the least error of each row marked."""

    @abstractmethod
    def figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Figures of one data set of a calibration."""

    @abstractmethod
    def compared_figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Figures of one data set of a comparison."""


def view_of(kind: str) -> View:
    """View of a kind of data, a part of the group "views".

    Raises `InputError` if it is missing, and `PluginError` if an installed package registers something else.
    """
    if (entry := registry.find("views", kind)) is None:
        raise InputError(f'There is no view of the data "{kind}"; install or update the package that has it.')
    return entry.load_as(View, "a View")  # type: ignore[type-abstract]


# Columns of tables with models side by side.


def column(head: str, cell: Callable[[Any], str]) -> Part:
    """One column."""
    return Part((head,), lambda row: (cell(row),))


def by_label(texts: Mapping[str, str], cell: Callable[[Any, str], str]) -> Part:
    """A column for each label, headed by its text."""
    return Part([*texts.values()], lambda row: [cell(row, label) for label in texts])


def errors_by_label(
    labels: Sequence[str],
    error: Callable[[Any, str], float | None],
    text: Callable[[float | None], str],
    steps: Sequence[float] = (),
) -> Part:
    """A column of errors for each label, the least of a row marked; see `mark_least`."""
    return Part(labels, lambda row: mark_least([error(row, label) for label in labels], text, steps))


# Words and series of reports on records.


def worst_of(
    data: Sequence[Record], errors: Sequence[float | None], text: Callable[[float | None], str]
) -> tuple[Record, str, str]:
    """Data set with the largest or a missing error, words that name it, and the errors of all if there are several."""
    sizes = [float("inf") if error is None else abs(error) for error in errors]
    worst = data[sizes.index(max(sizes))]
    if len(data) == 1:
        return worst, str(worst["name"]), ""
    others = "; ".join(f"{d['name']} {text(error)}" for d, error in zip(data, errors, strict=True))
    return worst, f"worst of {len(data)}: {worst['name']}", others


def start_words(start: str, unit: str) -> str:
    """Words after a figure of merit that give the figure of the start values; empty where it is missing."""
    return "" if start == MISSING else f" (start {start} {unit})"


def scale_values(rows: Sequence[Record], key: str, scale: float) -> Points:
    """Values of the rows for a series; None for a missing number.

    `scale`: factor on the values.
    """
    values = (number(row.get(key)) for row in rows)
    return tuple(None if value is None else value * scale for value in values)


def present(series: Sequence[Series]) -> tuple[Series, ...]:
    """Series without models that have no finite value, whose legend entry would have no curve."""
    return tuple(s for s in series if any(y is not None for y in s.y))
