"""report.html of a run folder: of a calibration (of an FMU too), a joint fit, a comparison or a reproduction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from jinja2 import UndefinedError

from commonrail.arguments import file_path
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.registry import size_in_words
from commonrail.display.chart import Figure
from commonrail.display.text import duration, number, significant
from commonrail.errors import InputError
from commonrail.files.analysis_folder import SENSITIVITY, TOLERANCE, read_analysis
from commonrail.files.atomic import replacing, write_text, writing
from commonrail.files.comparison_folder import COMPARISON, read_comparison
from commonrail.files.record_file import FAMILY_RECORD, FMU_RECORD, REPRODUCTION_RECORD
from commonrail.files.run_folder import RESULT, TRACES, read_run
from commonrail.kinds.records import Record
from commonrail.report.certainty import certainty_lines, certainty_tables
from commonrail.report.draw import drawings, figure_html, small_html
from commonrail.report.draw_map import heat_map_html
from commonrail.report.error_map import error_maps
from commonrail.report.figures import convergence_figure, figures_of
from commonrail.report.headline import headline, parameter_lines, synthetic_notes, warning_lines
from commonrail.report.html import render
from commonrail.report.judgement import combination_table, judgement_lines, judgement_tables
from commonrail.report.parameters import parameter_rows
from commonrail.report.record import check_record, texts_of
from commonrail.report.rerun import rerun_lines
from commonrail.report.tables import tables_of
from commonrail.report.verdict import verdict

__all__ = ["BENCH", "draw_plates", "report_html", "write_report"]


BENCH = "bench.html"  # page with sliders, which a report links where it lies beside
MANY = 6  # figures; more are set beside one another, below a table of contents

NO_PLATES = (
    "figures for print (SVG, PDF) are left out, because they need matplotlib: install it with "
    "pip install 'commonrail[plates]', then `commonrail report {}` draws them"
)
_BROKEN = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError, UndefinedError)


def write_report(folder: str | Path) -> Path:
    """Write ``report.html`` from what a run folder holds.

    Parameters
    ----------
    folder : str or Path
        Folder that ``commonrail calibrate``, ``family``, ``compare`` or ``reproduce`` left.

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
    name, verb, make = next((k for k in _KINDS if (folder / k[0]).is_file()), _KINDS[-1])
    with _complete(folder, name, verb):
        page = make(folder)
    path = folder / "report.html"
    write_text(path, page)
    return path


def draw_plates(folder: Path) -> str:
    """Draw the figures for print of a reproduction's folder, those that are missing.

    Parameters
    ----------
    folder : Path
        Run folder; one of another kind has no such figures.

    Returns
    -------
    str
        Empty, or a sentence with the extra that is to be installed.

    Raises
    ------
    InputError
        If the folder is not whole.
    OutputError
        If they cannot be written.
    """
    if not (folder / REPRODUCTION_RECORD).is_file() or _has_plates(folder):
        return ""
    if find_spec("matplotlib") is None:
        return NO_PLATES.format(folder)
    from commonrail.files.reproduction_folder import read_reproduction
    from commonrail.report.plates import make_plates
    from commonrail.report.reproduction import PLATE_FOLDER

    plates = folder / PLATE_FOLDER
    with _complete(folder, REPRODUCTION_RECORD, "reproduce"):
        drawn = make_plates(*read_reproduction(folder))
    with writing(plates):
        plates.mkdir(exist_ok=True)
    for file, content in drawn.items():
        with replacing(plates / file, "wb") as stream:
            stream.write(content)
    return ""


@contextmanager
def _complete(folder: Path, name: str, verb: str) -> Iterator[None]:
    """Turn what a broken record leads to into a sentence."""
    try:
        yield
    except _BROKEN as error:
        raise InputError(
            f"{folder}: {name} or {TRACES} is incomplete ({type(error).__name__}: {error}); {verb} again."
        ) from error


def _calibrated(folder: Path) -> str:
    record, traces = read_run(folder)
    bench = (folder / BENCH).is_file()
    return report_html(check_record(record, str(folder)), traces, folder.as_posix() or "RUN", bench)


def _compared(folder: Path) -> str:
    from commonrail.report.comparison import comparison_html

    record, traces = read_comparison(folder)
    return comparison_html(check_record(record, str(folder), "comparison"), traces, folder.as_posix() or "DIR")


def _reproduced(folder: Path) -> str:
    from commonrail.files.reproduction_folder import read_reproduction
    from commonrail.report.reproduction import check_reproduction, reproduction_html

    record, traces = read_reproduction(folder)
    run = folder.as_posix() or "RUN"
    return reproduction_html(check_reproduction(record, str(folder)), traces, run, _has_plates(folder))


def _sensitive(folder: Path) -> str:
    from commonrail.report.sensitivity import sensitivity_html

    record = check_record(read_analysis(folder, SENSITIVITY), str(folder), "sensitivity")
    return sensitivity_html(record, folder.as_posix() or "DIR")


def _tolerated(folder: Path) -> str:
    from commonrail.report.tolerance import tolerance_html

    record = check_record(read_analysis(folder, TOLERANCE), str(folder), "tolerance")
    return tolerance_html(record, folder.as_posix() or "DIR")


def _fitted_together(folder: Path) -> str:
    from commonrail.family.run import read_family_run
    from commonrail.report.family import family_html

    record, traces = read_family_run(folder)
    return family_html(check_record(record, str(folder), "family"), traces, folder.as_posix() or "RUN")


def _of_fmu(folder: Path) -> str:
    from commonrail.foreign.run import read_fmu_run
    from commonrail.report.foreign import fmu_html

    record = check_record(read_fmu_run(folder), str(folder), "fmu calibration")
    return fmu_html(record, folder.as_posix() or "RUN")


def _has_plates(folder: Path) -> bool:
    from commonrail.report.reproduction import PLATE_FOLDER, PLATES

    return all((folder / PLATE_FOLDER / f"{name}.{kind}").is_file() for name in PLATES for kind in ("svg", "pdf"))


# File that tells a folder's kind, the verb that leaves it, and what makes its page.
_KINDS: tuple[tuple[str, str, Callable[[Path], str]], ...] = (
    (COMPARISON, "compare", _compared),
    (SENSITIVITY.record, SENSITIVITY.verb, _sensitive),
    (TOLERANCE.record, TOLERANCE.verb, _tolerated),
    (REPRODUCTION_RECORD, "reproduce", _reproduced),
    (FAMILY_RECORD, "family", _fitted_together),
    (FMU_RECORD, "calibrate", _of_fmu),
    (RESULT, "calibrate", _calibrated),
)


def report_html(
    record: Record, traces: Mapping[str, Mapping[str, Floats]], run: str = "RUN", bench: bool = False
) -> str:
    """Page of a result.

    Parameters
    ----------
    record, traces : mapping
        Record, and curves by data set.
    run : str
        The folder's name, for the command lines in the page.
    bench : bool
        A page with sliders lies beside, to be linked.
    """
    figures = figures_of(record, traces)
    many = len(figures) > MANY
    return render(
        "report.html",
        kind="Calibration",
        record=record,
        dated=_dated(record),
        verdict=verdict(record, run),
        many=many,
        contents=_contents(record, figures) if many else [],
        heats=[(heat, heat_map_html(heat, f"error-{i}")) for i, heat in enumerate(error_maps(record))],
        lines=headline(record),
        tables=tables_of(record["data"], texts_of(record)),
        figures=[(f, small_html(f, f"figure-{i}")) for i, f in enumerate(figures)] if many else drawings(figures),
        convergence=_convergence(record),
        judgement_lines=judgement_lines(record),
        judgement_tables=[*judgement_tables(record), *filter(None, [combination_table(record)])],
        certainty_lines=certainty_lines(record),
        certainty_tables=certainty_tables(record),
        parameters=parameter_rows(sorted(record["parameters"], key=_effect, reverse=True), record.get("certainty")),
        parameter_lines=parameter_lines(record["parameters"]),
        synthetic=synthetic_notes(record),
        warnings=warning_lines(record),
        commands=rerun_lines(record, run),
        bench=BENCH if bench else "",
        facts=_facts(record),
    )


def _effect(parameter: Record) -> float:
    """Effect of a parameter on the data, by which the page ranks it."""
    return number(parameter.get("effect")) or 0.0


def _dated(record: Record) -> str:
    """Day and time at which the search ended; empty in a record without them."""
    return str(record.get("clock", {}).get("ended", "")).replace("T", " ").replace("+00:00", " UTC")


def _contents(record: Record, figures: Sequence[Figure]) -> list[tuple[str, str]]:
    """Name and anchor of each figure of a long page."""
    return [(figure.title, f"small-{i}") for i, figure in enumerate(figures, start=1)]


def _convergence(record: Record) -> tuple[Figure, str] | None:
    if len(record["generations"]) < 2:
        return None
    figure = convergence_figure(record["generations"])
    return figure, figure_html(figure, "convergence")


def _search(settings: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """Settings of the search; none in a record of before they were kept."""
    if settings is None:
        return []
    polish = f"; {settings['polish']} least-squares refinements" if settings["polish"] else ""
    initial = settings.get("initial", "")
    first = f"; first population {_FIRST.get(initial, initial)}" if initial else ""
    return [("Search", f"{settings.get('method', 'differential evolution')}, {size_in_words(settings)}{first}{polish}")]


_FIRST = {
    "feasible": "drawn from what is feasible",
    "uniform": "drawn from the whole box",
    "reference": "the start values, the rest drawn from what is feasible",
}


def _facts(record: Record) -> list[tuple[str, str]]:
    """Numbers that say how the result came about."""
    counts: Mapping[str, Any] = record.get("evaluations", {})
    software = record.get("software", {})
    names = {"slots": "candidates proposed", "simulated": "simulated", "failed": "failed"}
    evaluations = [f"{counts[key]:,} {words}" for key, words in names.items() if key in counts]
    clock = record.get("clock", record)  # its keys stood in the record itself once
    speed = f"{significant(clock.get('simulations_per_second'), 3)} injections/s"
    if "injections" in counts:
        speed = f"{counts['injections']:,} injections; {speed}"
    bits = ", the same bits on every x86-64 processor" if record.get("same_bits") else ""
    scale = record.get("loss_scale")
    robust = [("Loss", f"soft L1 of scale {significant(scale, 4)}")] if scale else []
    return [
        *_search(record.get("optimiser")),
        *robust,
        ("Evaluations", "; ".join(evaluations)),
        ("Simulations", speed),
        ("Time of the search", duration(clock.get("seconds"))),
        ("Ended", f"{record['status']}: {record.get('reason') or 'the optimiser was done'}"),
        ("Seed", str(record["seed"])),
        ("Time step", f"{significant(record.get('time_step'), 4, 1e6)} µs, {record.get('precision', 'f64')}{bits}"),
        ("Software", ", ".join(f"{name} {number}" for name, number in software.items())),
    ]
