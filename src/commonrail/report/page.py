"""report.html of a folder, whatever kind of result it holds, and the page of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from commonrail.base.arguments import file_path
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.output import write_text
from commonrail.base.text import number, significant
from commonrail.data.records import Record
from commonrail.report.draw.figure import drawings, small_html
from commonrail.report.fit.certainty import certainty_lines, certainty_tables
from commonrail.report.fit.figures import error_maps, figures_of
from commonrail.report.fit.record import rerun_lines
from commonrail.report.fit.search import convergence_section, search_facts
from commonrail.report.fit.tables import parameter_rows, tables_of
from commonrail.report.fit.verdict import (
    combination_table,
    headline,
    judgement_lines,
    judgement_tables,
    parameter_lines,
    synthetic_notes,
    verdict,
    warning_lines,
)
from commonrail.report.html import render
from commonrail.report.result_kind import ResultKind, kind_of
from commonrail.runs.folder import RESULT, TRACES, refuse_foreign
from commonrail.runs.traces import read_traces

BENCH = "bench.html"  # page with sliders, which a report links where it lies beside
MANY = 6  # figures; more are set beside one another, below a table of contents


def write_report(folder: str | Path) -> Path:
    """Write ``report.html`` from what a run folder holds.

    Parameters
    ----------
    folder : str or Path
        Folder that ``commonrail calibrate``, ``family``, ``compare``, ``reproduce`` or a plug-in's verb left.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    InputError
        If it is not a run folder or was left by another version.
    ConfigurationError
        If it is no path.
    OutputError
        If the report cannot be written.
    """
    folder = file_path(folder, "folder")
    if not folder.is_dir():
        raise InputError(
            f"{folder}: this is no folder; name one that `commonrail calibrate`, `family`, `compare` or "
            "`reproduce` left."
        )
    kind = kind_of(folder)
    with kind.refusing_broken(folder):
        page = kind.page(kind.read(folder), folder)
    path = folder / "report.html"
    write_text(path, page)
    return path


def _page(record: Record, folder: Path) -> str:
    refuse_foreign(folder, record)
    bench = (folder / BENCH).is_file()
    return report_html(record, read_traces(folder / TRACES), folder.as_posix() or "RUN", bench)


KEYS = ("title", "seed", "status", "injector", "parameters", "objective", "data", "generations")
CALIBRATION = ResultKind(RESULT, "calibration", "calibrate", _page, KEYS)


def report_html(
    record: Record, traces: Mapping[str, Mapping[str, Floats]], run: str = "RUN", bench: bool = False
) -> str:
    """Page of a calibration from its record and its curves by data set.

    `run` is the folder's name for the command lines in the page; with `bench` a page with sliders lies beside, to be
    linked.
    """
    figures = figures_of(record, traces)
    many = len(figures) > MANY
    by_effect = sorted(record["parameters"], key=lambda p: number(p.get("effect")) or 0.0, reverse=True)
    return render(
        "report.html",
        kind="Calibration",
        record=record,
        dated=str(record["clock"]["ended"]).replace("T", " ").replace("+00:00", " UTC"),
        verdict=verdict(record, run),
        many=many,
        contents=[(figure.title, f"small-{i}") for i, figure in enumerate(figures, start=1)] if many else [],
        heats=drawings(error_maps(record), name="error"),
        lines=headline(record),
        tables=tables_of(record["data"], record["labels"]),
        figures=[(f, small_html(f, f"figure-{i}")) for i, f in enumerate(figures)] if many else drawings(figures),
        convergence=convergence_section(record),
        judgement_lines=judgement_lines(record),
        judgement_tables=[*judgement_tables(record), *filter(None, [combination_table(record)])],
        certainty_lines=certainty_lines(record),
        certainty_tables=certainty_tables(record),
        parameters=parameter_rows(by_effect, record.get("certainty")),
        parameter_lines=parameter_lines(record["parameters"]),
        synthetic=synthetic_notes(record),
        warnings=warning_lines(record),
        commands=rerun_lines(record, run),
        bench=BENCH if bench else "",
        facts=_facts(record),
    )


def _facts(record: Record) -> list[tuple[str, str]]:
    bits = ", the same bits on every x86-64 processor" if record["same_bits"] else ""
    step = f"{significant(record['time_step'], 4, 1e6)} µs, {record['precision']}{bits}"
    return search_facts(record, more=[("Time step", step)])
