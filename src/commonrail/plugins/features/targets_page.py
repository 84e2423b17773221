"""Features as measured data in reports: tables of values and errors in tolerances, and a figure of the errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from commonrail.base.chart import MARKERS, Figure, Panel, Series
from commonrail.base.record import from_record
from commonrail.base.table import BEST_LEGEND, SIGNS, Cell, Part, Table, judge_size, table_from_parts
from commonrail.base.text import field_unit, megapascal, pressure, several, to_fixed, to_signed
from commonrail.data.records import JUDGED, Record, Texts, origin_word
from commonrail.plugins.features.result import choose_decimals
from commonrail.plugins.features.targets import FeatureRow
from commonrail.report.data.view import (
    Merit,
    Models,
    Plotted,
    View,
    column,
    errors_by_label,
    present,
    start_words,
)

_STEPS = (1.0, 2.0)  # [tolerances]
_LEGEND = "{small} within one tolerance, {medium} within two, {large} beyond.".format(**SIGNS)


class FeatureView(View):
    """Tables, figures and sentences of features."""

    def operating_point(self, data: Record) -> Record:
        """Operating point of the features."""
        return data

    def merit(self, data: Sequence[Record], label: str = JUDGED) -> Merit:
        """Root mean square error in tolerances."""
        best, start = (several([d["rms"].get(key) for d in data], lambda v: to_fixed(v, 2)) for key in (label, "start"))
        return Merit(best, f"tolerances, rms error of the features{start_words(start, '')}".replace(" )", ")"))

    def leading(self, data: Sequence[Record]) -> tuple[str, list[Mapping[str, Any]]]:
        """Root mean square errors of the features."""
        return "the least error of the features", [d["rms"] for d in data]

    def tables(self, data: Sequence[Record], texts: Texts) -> list[Table]:
        """Features of each data set: values by label, and the errors of the calibrated model."""
        return [_values_table(d, [label for label in texts if self.has(d, label)], texts) for d in data]

    def compared_tables(self, data: Sequence[Record], labels: Sequence[str]) -> list[Table]:
        """Errors of the features by model, in tolerances."""
        return [_errors_table(d, labels) for d in data]

    def figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Errors of the features in tolerances."""
        return [_figure(data, plotted.models)]

    compared_figures = figures


def _rows(data: Record) -> list[FeatureRow]:
    return [from_record(FeatureRow, row) for row in data["rows"]]


def _format(row: FeatureRow, value: object) -> str:
    return to_fixed(value, choose_decimals(row.unit), field_unit(row.unit).factor)


def _values_table(data: Record, labels: Sequence[str], texts: Texts) -> Table:
    def errors(row: FeatureRow) -> Iterator[str | Cell]:
        error = row.error(JUDGED)
        difference = None if error is None else (row.models[JUDGED] - row.measured) * field_unit(row.unit).factor
        yield to_signed(difference, choose_decimals(row.unit))
        yield Cell(to_signed(error, 2), judge_size(error, _STEPS))

    parts = (
        _HEAD,
        Part((origin_word(data), "tolerance"), lambda row: (_format(row, row.measured), _format(row, row.tolerance))),
        Part([texts[label] for label in labels], lambda row: [_format(row, row.models.get(label)) for label in labels]),
        Part(("error", "error, tolerances"), errors),
    )
    title = f"Features of {data['name']} ({data['role']}), {pressure(data['rail_pressure'])}"
    note = f"Errors are {texts[JUDGED]} − {origin_word(data)}. {_LEGEND}"
    return table_from_parts(title, _rows(data), parts, note, 2)


def _errors_table(data: Record, labels: Sequence[str]) -> Table:
    parts = (
        _HEAD,
        column(origin_word(data), lambda row: _format(row, row.measured)),
        errors_by_label(labels, FeatureRow.error, lambda error: to_signed(error, 2), _STEPS),
    )
    title = f"Errors of the features in tolerances: {data['name']}, {megapascal(data['rail_pressure'])} MPa"
    return table_from_parts(title, _rows(data), parts, f"{_LEGEND} {BEST_LEGEND}", 2)


def _figure(data: Record, models: Models) -> Figure:
    """Errors in tolerances, one place per feature."""
    rows = _rows(data)
    places = tuple(float(i) for i in range(len(rows)))
    series = [
        Series(model.text, model.look, places, tuple(row.error(label) for row in rows), MARKERS, model.family)
        for label, model in models.items()
    ]
    return Figure(
        f"Features of {data['name']}",
        f"Simulated − {origin_word(data)}, in units of the tolerance; the number is that of the injection.",
        "",
        (Panel("error, tolerances", present(series), zero_line=True, categories=tuple(row.name for row in rows)),),
    )


_HEAD = Part(("feature", "unit"), lambda row: (row.name, field_unit(row.unit).text))

VIEW = FeatureView()
