"""report.html of a folder, whatever kind of result it holds, and the page of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from commonrail.base.arguments import file_path
from commonrail.base.arrays import Floats
from commonrail.base.chart import Figure
from commonrail.base.errors import InputError
from commonrail.base.output import write_text
from commonrail.base.text import duration, number, significant
from commonrail.calibration.optimisers.registry import size_in_words
from commonrail.data.records import Record
from commonrail.report.draw.figure import drawings, figure_html, small_html
from commonrail.report.fit.certainty import certainty_lines, certainty_tables
from commonrail.report.fit.figures import convergence_figure, error_maps, figures_of
from commonrail.report.fit.record import rerun_lines
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
        convergence=_convergence(record),
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


def _convergence(record: Record) -> tuple[Figure, str] | None:
    if len(record["generations"]) < 2:
        return None
    figure = convergence_figure(record["generations"])
    return figure, figure_html(figure, "convergence")


def _search(settings: Mapping[str, Any]) -> str:
    """Settings of the search."""
    polish = f"; {settings['polish']} least-squares refinements" if settings["polish"] else ""
    initial = settings.get("initial", "")
    first = f"; first population {_FIRST.get(initial, initial)}" if initial else ""
    return f"{settings['method']}, {size_in_words(settings)}{first}{polish}"


_FIRST = {
    "feasible": "drawn from what is feasible",
    "uniform": "drawn from the whole box",
    "reference": "the start values, the rest drawn from what is feasible",
}


def _facts(record: Record) -> list[tuple[str, str]]:
    """Numbers that say how the result came about."""
    counts, clock = record["evaluations"], record["clock"]
    names = {"slots": "candidates proposed", "simulated": "simulated", "failed": "failed"}
    evaluations = [f"{counts[key]:,} {words}" for key, words in names.items()]
    speed = f"{counts['injections']:,} injections; {significant(clock['simulations_per_second'], 3)} injections/s"
    bits = ", the same bits on every x86-64 processor" if record["same_bits"] else ""
    scale = record.get("loss_scale")
    robust = [("Loss", f"soft L1 of scale {significant(scale, 4)}")] if scale else []
    return [
        ("Search", _search(record["optimiser"])),
        *robust,
        ("Evaluations", "; ".join(evaluations)),
        ("Simulations", speed),
        ("Time of the search", duration(clock["seconds"])),
        ("Ended", f"{record['status']}: {record['reason'] or 'the optimiser was done'}"),
        ("Seed", str(record["seed"])),
        ("Time step", f"{significant(record['time_step'], 4, 1e6)} µs, {record['precision']}{bits}"),
        ("Software", ", ".join(f"{name} {number}" for name, number in record["software"].items())),
    ]
