"""Folder and page of an analysis, such as a sensitivity or a tolerance study: a record, a table of it, a report."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from commonrail.base.chart import Bars, Chart
from commonrail.base.csv_output import write_csv
from commonrail.base.output import write_set, write_text
from commonrail.base.record import Interval
from commonrail.base.table import Table
from commonrail.base.text import MISSING, command, duration, join_words, significant
from commonrail.calibration.study import Study
from commonrail.data.records import Record
from commonrail.report.figure import drawings
from commonrail.report.fit.rules import Tile
from commonrail.report.html import render
from commonrail.report.page import write_report
from commonrail.runs.folder import new_folder, write_record

SHOWN = 16  # rows of a table or figure; all are in the CSV file
HEIGHT_OF_A_ROW = 18  # of a figure with bars [px]
MARKS = "Marks: M measured, C ECU, F fitted, E estimate."


class Analysis(Protocol):
    """Result of an analysis."""

    def record(self) -> dict[str, Any]:
        """JSON-able form [SI]."""

    def rows(self) -> list[dict[str, Any]]:
        """Rows of a table [SI]; keys that only some have are columns too, and None is an empty cell."""


Result = TypeVar("Result", bound=Analysis)


def run_into(folder: Path | None, table: str, run: Callable[[], Result], texts: Mapping[str, str] = {}) -> Result:
    """Run an analysis, and write record, table, report and further texts into a new folder, if there is to be one.

    The record has the name of the table, such as "tolerance.csv", with the ending ``.json``. There is no folder if
    nothing comes of the analysis.
    """
    if folder is None:
        return run()
    with new_folder(folder) as place:
        result = run()
        _write(place, table, result)
        for file, text in texts.items():
            write_text(place / file, text)
        write_report(place)
    return result


def _write(folder: Path, table: str, result: Analysis) -> None:
    record, rows = result.record(), result.rows()
    record_file = Path(table).with_suffix(".json").name
    notes = (record["title"], "simulated, not measured; SI units", *synthetic_lines(record))
    heads = list(dict.fromkeys(key for row in rows for key in row))
    with write_set(folder):
        write_record(folder / record_file, record)
        write_csv(folder / table, notes, heads, ([_cell(row.get(head)) for head in heads] for row in rows))


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def synthetic_lines(record: Record) -> list[str]:
    """Sentence on synthetic data or assumptions, for tables and terminals; none without them."""
    return [f"SYNTHETIC: {record['synthetic']}"] if record["synthetic"] else []


def analysis_html(
    template: str, package: str, record: Record, folder: Path, facts: Sequence[tuple[str, str]], **values: Any
) -> str:
    """Page of a record that lies in a folder; facts on time and software join the others."""
    seconds = record["clock"]["seconds"]
    speed = f"{significant(record['injections'] / seconds, 3)} simulations/s" if seconds else MISSING
    versions = ", ".join(f"{name} {version}" for name, version in record["software"].items())
    return render(
        template,
        package=package,
        record=record,
        synthetic=[record["synthetic"]] if record["synthetic"] else [],
        commands=[("Make this report again", command("report", folder.as_posix()))],
        facts=[*facts, ("Time", f"{duration(seconds)}, {speed}"), ("Software", versions)],
        **values,
    )


def result_html(
    kind: str,
    study: Study,
    lines: Sequence[str],
    tiles: Sequence[Tile],
    figures: Sequence[Chart],
    tables: Sequence[Table],
    notes: Sequence[str] = (),
) -> str:
    """Page of what follows from a study's fit, such as a measuring plan; `notes` are below its tables."""
    drawn = list(drawings(figures, 380))
    return render(
        "result.html",
        title=f"{kind}: {study.title}",
        kind=kind,
        synthetic=[study.synthetic] if study.synthetic else [],
        lines=lines,
        tiles=tiles,
        first=drawn[0] if drawn else None,
        figures=drawn[1:],
        tables=tables,
        notes=notes,
        commands=[],
        facts=[("Injector", study.injector.title), ("Data", join_words([data.name for data in study.data]))],
    )


def interval_bars(label: str, look: str, intervals: Iterable[Interval | None], scale: float, slot: int = 0) -> Bars:
    """Bars from zero to estimates with their intervals, times a scale; a missing one is left out."""
    scaled = [(scale * i.value, scale * i.low, scale * i.high) for i in intervals if i is not None]
    value, low, high = zip(*scaled, strict=True)
    return Bars(label, look, (0.0,) * len(scaled), value, low, high, slot=slot)


def bar_height(rows: int) -> int:
    """Height of a figure with bars [px]."""
    return 100 + HEIGHT_OF_A_ROW * rows
