"""report.html of a folder, whatever kind of result it holds, and the page of a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path

from markupsafe import Markup

from commonrail.base import registry
from commonrail.base.arguments import file_path
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError, PluginError, StudyError
from commonrail.base.hooks import note
from commonrail.base.output import write_text
from commonrail.base.text import significant
from commonrail.calibration.record import CalibrationRecord, read_as
from commonrail.data.records import Record, Traces
from commonrail.report.figure import drawings, figure_html, small_drawings, small_html
from commonrail.report.fit.certainty import certainty_lines, likelihood_tables
from commonrail.report.fit.diagnostics import (
    autocorrelation_figure,
    by_effect,
    loading_matrix,
    pair_figures,
    parity_figure,
)
from commonrail.report.fit.figures import error_maps, figures_of
from commonrail.report.fit.record import rerun_lines
from commonrail.report.fit.search import convergence_section, search_facts
from commonrail.report.fit.tables import interval_head, parameter_rows, tables_of
from commonrail.report.fit.verdict import (
    headline,
    judgement_lines,
    judgement_tables,
    synthetic_notes,
    tiles,
    verdict,
)
from commonrail.report.html import render
from commonrail.report.result_kind import ResultKind, kind_of
from commonrail.runs.folder import RESULT, Results, final_text, read_results
from commonrail.runs.journal import JOURNAL, best_course, held_run

BENCH = "bench.html"  # page with sliders, linked by a report next to it
MAIN_HEIGHT = 420  # of the chart on the first screen [px]
FOREST = 9  # parameters on the first screen
OPEN, LONG = 2, 12  # tables of errors that are not folded, and their rows at most
SQUARE = 360  # height of the chart whose axes are alike [px]
FEW = 10  # columns of a heat map that is shown next to others


def write_report(folder: str | Path, live: bool = True) -> Path:
    """Write ``report.html`` from the contents of a run folder.

    Parameters
    ----------
    folder : str or Path
        Folder that ``commonrail calibrate``, ``type``, ``compare``, ``lab reproduce`` or a plug-in's verb left.
    live : bool, optional
        Whether the main chart of a calibration simulates in the page, where a plug-in can make it do so.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    InputError
        If it is not a run folder or was left by another version.
    ConfigurationError
        If it is not a path.
    OutputError
        If the report cannot be written.
    """
    folder = file_path(folder, "folder")
    if not folder.is_dir():
        raise InputError(
            f"{folder}: this is no folder; name one that `commonrail calibrate`, `type`, `compare` or "
            "`lab reproduce` left."
        )
    kind = kind_of(folder)
    with kind.refusing_broken(folder):
        make = kind.still if kind.still and not live else kind.page
        page = make(kind.read(folder), folder)
    return _write(folder, page)


def write_report_of(results: Results, folder: Path, live: bool = True) -> Path:
    """Write ``report.html`` of a calibration from the results that were just written into its folder."""
    return _write(folder, _results_page(results, folder, live))


def _write(folder: Path, page: str) -> Path:
    path = folder / "report.html"
    with held_run(folder) if (folder / JOURNAL).is_file() else nullcontext():
        write_text(path, final_text(page, folder))
    return path


def _page(record: Record, folder: Path, live: bool = True) -> str:
    return _results_page(read_results(folder, record), folder, live)


def _results_page(results: Results, folder: Path, live: bool) -> str:
    record = results.record
    return report_html(
        record,
        results.traces,
        folder.as_posix() or "RUN",
        bench=(folder / BENCH).is_file(),
        course=_course(folder),
        draws=results.draws,
        live=_live(record, folder) if live else "",
        openings=[
            opening.call(folder) for name, opening in registry.entries("openings").items() if (folder / name).is_file()
        ],
    )


def _live(record: Record, folder: Path) -> str:
    """HTML of the parts that make the page simulate; a warning names one of an installed package that fails."""
    html = ""
    for plugin in registry.entries("live").values():
        try:
            html += plugin.call(record, folder)
        except PluginError as error:
            note(str(error))
    return Markup(html)


def _course(folder: Path) -> Floats | None:
    """Best candidates after each generation; None where the journal is missing or cannot be read."""
    with suppress(StudyError):
        return best_course(folder) if (folder / JOURNAL).is_file() else None
    return None


KEYS = ("title", "seed", "status", "injector", "parameters", "objective", "data", "generations")
CALIBRATION = ResultKind(RESULT, "calibration", "calibrate", _page, KEYS, still=partial(_page, live=False))


def report_html(
    record: Record,
    traces: Traces,
    run: str = "RUN",
    *,
    bench: bool = False,
    course: Floats | None = None,
    draws: Mapping[str, Floats] = {},
    live: str = "",
    openings: Sequence[tuple[str, Sequence[str]]] = (),
) -> str:
    """Page of a calibration from its record and its curves by data set.

    `run` is the folder's name for the command lines in the page; with `bench` a page with sliders next to it is
    linked. `course` are the best candidates after each generation (generations, d), `draws` those of a posterior by
    parameter, both in SI. `live` is HTML that the page ends with, which lets its main chart simulate. `openings` are
    titles and sentences that the page begins with.
    """
    fit = read_as(CalibrationRecord, record)
    data, parameters, certainty = fit.data, fit.parameters, fit.certainty
    figures, heats = figures_of(data, fit.labels, traces), error_maps(data)
    parity, autocorrelation = parity_figure(data), autocorrelation_figure(data, traces)
    checks = [(parity, small_html(parity, "parity", SQUARE))] if parity else []
    numbered = enumerate(tables_of(data, fit.labels))
    tables = [(table, i < OPEN and len(table.rows) <= LONG) for i, table in numbered]
    rows = parameter_rows(by_effect(parameters), certainty)
    return render(
        "report.html",
        kind="Calibration",
        record=record,
        dated=fit.clock.ended[:10],
        verdict=verdict(fit, run),
        tiles=tiles(fit),
        main=[(figure, figure_html(figure, "figure-0", MAIN_HEIGHT)) for figure in figures[:1]],
        forest=rows[:FOREST],
        interval_head=interval_head(certainty),
        synthetic=synthetic_notes(fit.synthetic, data),
        warnings=[warning.sentence for warning in fit.warnings],
        bench=BENCH if bench else "",
        live=live,
        lines=headline(fit),
        openings=openings,
        tables=[table for table, is_open in tables if is_open],
        folded=[table for table, is_open in tables if not is_open],
        titles=dict.fromkeys(table.title.partition(":")[0] for table, is_open in tables if not is_open),
        figures=[*checks, *small_drawings(filter(None, [autocorrelation, *figures[1:]]), "figure")],
        heats=drawings([h for h in heats if len(h.x) > FEW], name="error"),
        small_heats=small_drawings([h for h in heats if len(h.x) <= FEW], "error-small"),
        parameters=rows,
        cures={p.name: p.cure for p in (certainty.parameters if certainty else ()) if p.cure},
        loadings=drawings(filter(None, [loading_matrix(fit)]), name="loading"),
        pairs=small_drawings(pair_figures(parameters, draws), "pair"),
        judgement_lines=judgement_lines(fit),
        judgement_tables=[*judgement_tables(fit), *likelihood_tables(certainty)],
        certainty_lines=certainty_lines(certainty),
        convergence=convergence_section(fit.generations, parameters, course),
        commands=rerun_lines(fit, run),
        facts=_facts(fit),
    )


def _facts(record: CalibrationRecord) -> list[tuple[str, str]]:
    bits = ", the same bits on every x86-64 processor" if record.same_bits else ""
    step = f"{significant(record.time_step, 4, 1e6)} µs, {record.precision}{bits}"
    return search_facts(record, more=[("Time step", step)])
