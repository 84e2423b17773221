"""The page of a comparison: sentences, tables, figures, models."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from commonrail.display.text import listed, number, significant
from commonrail.files.comparison_folder import COMPARISON
from commonrail.files.run_folder import TRACES
from commonrail.files.traces_file import read_traces
from commonrail.kinds.records import Record, Traces
from commonrail.report.comparison_tables import comparison_tables, difference_table
from commonrail.report.draw import figure_html
from commonrail.report.figures import comparison_figures
from commonrail.report.headline import synthetic_notes
from commonrail.report.html import render
from commonrail.report.record import by_kind
from commonrail.report.result_kind import ResultKind

__all__ = ["comparison_commands", "comparison_html", "comparison_lines"]


def _page(record: Record, folder: Path) -> str:
    return comparison_html(record, read_traces(folder / TRACES), folder.as_posix() or "DIR")


KEYS = ("title", "labels", "models", "differences", "studies", "data")
RESULT = ResultKind(COMPARISON, "comparison", "compare", _page, KEYS)


def comparison_html(record: Record, traces: Traces, folder: str = "DIR") -> str:
    """The page of a comparison; `folder` is its name for the command lines in it."""
    drawn = enumerate(comparison_figures(record, traces))
    return render(
        "comparison.html",
        kind="Comparison",
        record=record,
        lines=comparison_lines(record),
        tables=comparison_tables(record),
        figures=[(figure, figure_html(figure, f"figure-{i}")) for i, figure in drawn],
        differences=difference_table(record),
        synthetic=synthetic_notes(record),
        commands=comparison_commands(record, folder),
        facts=_facts(record),
    )


def comparison_lines(record: Record) -> list[str]:
    """Sentences on models and data, the nearest model to each data set, and points without a number."""
    labels, data = list(record["labels"]), record["data"]
    counts = (_counted(len(labels), "model"), _counted(len(data), "data set"))
    lines = [f"{counts[0]} on {counts[1]}; nothing was fitted."]
    if len(labels) > 1:
        for view, own in by_kind(data):
            lines += _nearest(*view.leading(own), [d["name"] for d in own], labels)
    failed = sum(len(failures) for d in data for failures in d.get("failures", {}).values())
    if failed:
        lines.append(f"{_counted(failed, 'point')} could not be simulated or judged; the last table says why.")
    return lines


def comparison_commands(record: Record, folder: str) -> list[tuple[str, str]]:
    """Purpose and command line; the first only if the models and studies were named on one."""
    arguments = [model.get("argument", "") for model in record["models"]]
    files = [study.get("file", "") for study in record["studies"]]
    commands = []
    if all(arguments) and all(files):
        options = " ".join(f"--data {shlex.quote(file)}" for file in files)
        models = " ".join(shlex.quote(argument) for argument in arguments)
        commands.append(("Compare again", f"commonrail compare {models} {options} --out NEW-DIR"))
    return [*commands, ("Make this report again", f"commonrail report {shlex.quote(folder)}")]


def _nearest(what: str, errors: Sequence[Record], names: Sequence[str], labels: Sequence[str]) -> list[str]:
    """Sentence on which model has the least error of which data sets.

    Parameters
    ----------
    what : str
        What the best model has.
    errors : sequence of mapping
        Errors by label, of each data set.
    names : sequence of str
        Of the data sets.
    labels : sequence of str
    """
    won: dict[str, list[str]] = {}
    for name, own in zip(names, errors, strict=True):
        found = {label: value for label in labels if (value := number(own.get(label))) is not None}
        if found:
            won.setdefault(min(found, key=lambda label: found[label]), []).append(name)
    if not won:
        return []
    order = sorted(won, key=lambda label: -len(won[label]))
    first, *others = (f"“{label}”{{}} on {listed(won[label])}" for label in order)
    return ["; ".join([first.replace("{}", f" has {what}"), *(part.replace("{}", "") for part in others)]) + "."]


def _counted(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def _facts(record: Record) -> list[tuple[str, str]]:
    steps = dict.fromkeys(f"{significant(study['time_step'], 4, 1e6)} µs" for study in record["studies"])
    titles = [f"{s['title']}{' (' + s['file'] + ')' if s.get('file') else ''}" for s in record["studies"]]
    return [
        ("Data of", "; ".join(titles)),
        ("Time step", listed(list(steps))),
        ("Software", ", ".join(f"{name} {version}" for name, version in record.get("software", {}).items())),
    ]
