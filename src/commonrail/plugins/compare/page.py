"""The page of a comparison: sentences, tables, figures, models."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from commonrail.base.chart import Figure
from commonrail.base.record import from_record
from commonrail.base.table import Part, Table, table_from_parts
from commonrail.base.text import count_noun, join_words, number, pressure, quantity, significant, to_fixed
from commonrail.data.records import MICROSECOND, Record, Traces
from commonrail.plugins.compare.file import RECORD, ComparedData, ComparisonRecord
from commonrail.plugins.compare.run import Failure
from commonrail.report.data.view import Plotted
from commonrail.report.figure import drawings
from commonrail.report.fit.record import by_kind, shown_of
from commonrail.report.fit.rules import Tile
from commonrail.report.fit.verdict import synthetic_notes
from commonrail.report.html import render
from commonrail.report.presenter import Presenter
from commonrail.report.result_kind import ResultKind
from commonrail.runs.folder import TRACES
from commonrail.runs.traces import read_traces

# Tables of a comparison: data, failed points, differing parameters.


def comparison_tables(record: ComparisonRecord) -> list[Table]:
    """Tables of the data sets of a comparison, and of its failed points."""
    labels, kinds = list(record.labels), by_kind(record.data_records)
    tables = [table for view, data in kinds for table in view.compared_tables(data, labels)]
    failed = failure_table(record.data)
    return [*tables, failed] if failed.rows else tables


def difference_table(record: ComparisonRecord) -> Table:
    """Table of the parameters that differ between the models."""
    parts = (
        Part(("parameter", "meaning"), lambda d: (d.name, d.meaning)),
        Part([*record.labels], lambda d: [quantity(d.values.get(label), d.unit) for label in record.labels]),
    )
    return table_from_parts("Parameters that differ", record.differences, parts, "", 2)


def failure_table(data: Sequence[ComparedData]) -> Table:
    """Table of the points without a number, with reasons."""
    rows: dict[tuple[str, str, str], list[Failure]] = {}
    for d in data:
        for label, failures in d.failures.items():
            for failure in failures:
                rows.setdefault((d.name, label, failure.sentence), []).append(failure)
    heads = ("data set", "model", "points", "reason", "number of points")
    cells = ((name, label, _points(points), reason, str(len(points))) for (name, label, reason), points in rows.items())
    return table_from_parts("Points without a number", cells, (Part(heads, lambda row: row),), "", 4)


def _points(failures: Sequence[Failure]) -> str:
    """Describe points: "80 MPa: 1000, 1400 µs; 120 MPa: 250 µs"."""
    by_rail: dict[str, list[str]] = {}
    for f in failures:
        by_rail.setdefault(pressure(f.rail_pressure), []).append(to_fixed(f.energising_time, 0, MICROSECOND))
    return "; ".join(f"{rail}: {', '.join(times)} µs" for rail, times in by_rail.items())


def _page(record: Record, folder: Path) -> str:
    return comparison_html(record, read_traces(folder / TRACES), folder.as_posix())


RESULT = ResultKind(
    RECORD, "comparison", "compare", _page, ("title", "labels", "models", "differences", "studies", "data")
)
COMPARISON = Presenter(lambda c: [f"{len(c.models)} models on {len(c.data)} data sets: {', '.join(c.models)}"])


def comparison_html(record: Record, traces: Traces, folder: str = "DIR") -> str:
    """Return the page of a comparison; `folder`: its name in the command lines of the page."""
    comparison = from_record(ComparisonRecord, record)
    figures = list(drawings(comparison_figures(comparison, traces)))
    return render(
        "comparison.html",
        __package__,
        kind="Comparison",
        record=record,
        lines=comparison_lines(comparison),
        tables=comparison_tables(comparison),
        tiles=comparison_tiles(comparison),
        first=figures[0] if figures else None,
        figures=figures[1:],
        differences=difference_table(comparison),
        synthetic=synthetic_notes(comparison.synthetic, comparison.data_records),
        commands=comparison_commands(comparison, folder),
        facts=_facts(comparison),
    )


def comparison_tiles(record: ComparisonRecord) -> list[Tile]:
    """Error of each model on each kind of data."""
    return [
        Tile(f"error of {label}", *view.merit(kind_data, label)[:2])
        for view, kind_data in by_kind(record.data_records)
        for label in record.labels
    ]


def comparison_figures(record: ComparisonRecord, traces: Traces) -> list[Figure]:
    """Figures of the data sets: each model has its colour, marker and dash."""
    plotted, kinds = Plotted(shown_of(record.labels, compared=True), traces), by_kind(record.data_records)
    return [f for view, data in kinds for d in data for f in view.compared_figures(d, plotted)]


def comparison_lines(record: ComparisonRecord) -> list[str]:
    """Sentences: the best model for each data set, number of models and data, points without a number."""
    labels, data, lines = list(record.labels), record.data, list[str]()
    if len(labels) > 1:
        for view, kind_data in by_kind(record.data_records):
            lines += _nearest(*view.leading(kind_data), [d["name"] for d in kind_data], labels)
    lines.append(f"{count_noun(len(labels), 'model')} on {count_noun(len(data), 'data set')}; nothing was fitted.")
    failed = sum(len(failures) for d in data for failures in d.failures.values())
    if failed:
        lines.append(f"{count_noun(failed, 'point')} could not be simulated or judged; see the last table for reasons.")
    return lines


def comparison_commands(record: ComparisonRecord, folder: str) -> list[tuple[str, str]]:
    """Purposes and command lines; the first only if models and studies came from a command line."""
    arguments = [model.argument for model in record.models]
    files = [study.file for study in record.studies]
    commands = []
    if all(arguments) and all(files):
        options = " ".join(f"--data {shlex.quote(file)}" for file in files)
        models = " ".join(shlex.quote(argument) for argument in arguments)
        commands.append(("Compare again", f"commonrail compare {models} {options} --out NEW-DIR"))
    return [*commands, ("Make this report again", f"commonrail report {shlex.quote(folder)}")]


def _nearest(what: str, errors: Sequence[Record], names: Sequence[str], labels: Sequence[str]) -> list[str]:
    """Say which model has the least error on which data sets.

    `what`: error measure in words; `errors`: by label, for each data set; `names`: of the data sets.
    """
    nearest: dict[str, list[str]] = {}
    for name, by_label in zip(names, errors, strict=True):
        values = {label: value for label in labels if (value := number(by_label.get(label))) is not None}
        if values:
            nearest.setdefault(min(values, key=values.__getitem__), []).append(name)
    if not nearest:
        return []
    first, *others = sorted(nearest.items(), key=lambda item: -len(item[1]))
    parts = [f"“{first[0]}” has {what} on {join_words(first[1])}"]
    return ["; ".join(parts + [f"“{label}” on {join_words(names)}" for label, names in others]) + "."]


def _facts(record: ComparisonRecord) -> list[tuple[str, str]]:
    steps = dict.fromkeys(f"{significant(study.time_step, 4, 1e6)} µs" for study in record.studies)
    return [
        ("Data of", "; ".join(f"{s.title}{f' ({s.file})' if s.file else ''}" for s in record.studies)),
        ("Time step", join_words(list(steps))),
        ("Software", ", ".join(f"{name} {version}" for name, version in record.software.items())),
    ]
