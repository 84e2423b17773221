"""A fit in its run folder on the command line: progress, report, figures, end."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from commonrail.base.errors import StudyError
from commonrail.base.stages import telling
from commonrail.base.text import command, count_noun, quantity
from commonrail.cli.console import (
    Bar,
    Stage,
    columns_of,
    print_json,
    print_lines,
    print_synthetic,
    print_table,
    say,
    short_form,
    show_stages_on,
    wrap_line,
)
from commonrail.cli.guard import INTERRUPTED

if TYPE_CHECKING:
    from commonrail.base.table import Table
    from commonrail.calibration.record import CalibrationRecord
    from commonrail.calibration.search import Progress
    from commonrail.calibration.study import Study
    from commonrail.report.fit.rules import Tile
    from commonrail.runs.fit import Listener
    from commonrail.runs.folder import Results
    from commonrail.workers.workers import Workers

JUDGED_SOON = 30.0  # time of a judgement whose stages need not be shown [s]


class Outcome(NamedTuple):
    """Run folder, report and the record of the result; `judged` is false if Ctrl-C has stopped the judgement.

    `results` are those of a calibration that has just been written.
    """

    folder: Path
    report: Path
    record: dict[str, Any]
    judged: bool = True
    results: Results | None = None

    @property
    def interrupted(self) -> bool:
        """Return whether the search was stopped by a signal."""
        return bool(self.record["status"] == "interrupted")


def run_study(
    study: Study, folder: Path, threads: int | None, workers: Workers | None = None, *, strict: bool = False
) -> Outcome:
    """Calibrate a study into a new folder, with progress and warnings on stderr; as `runs.calibrate_into`."""
    from commonrail.runs.fit import calibrate_into

    points = count_noun(sum(len(data.points) for data in study.data), "operating point")
    return run_and_report(
        f"{study.title}: {points}, steps of {quantity(study.time_step, 's')} (seconds for one curve, minutes for many)",
        folder,
        lambda listener: calibrate_into(
            folder, study, threads=threads, workers=workers, listener=listener, strict=strict
        ),
    )


def run_and_report(
    title: str, folder: Path, work: Callable[[Listener], object], stage: Callable[[Progress], Stage] | None = None
) -> Outcome:
    """Run a fit of any kind in its folder, with its progress on stderr, and write its report, without a live chart.

    `stage` says how far a search is for the bar with the title, by default `stage_of`.
    """
    from commonrail.base.hooks import hold_interrupts
    from commonrail.report.page import write_report, write_report_of
    from commonrail.report.result_kind import kind_of
    from commonrail.runs.fit import Listener
    from commonrail.runs.folder import RESULT

    shown, judged = stage_of if stage is None else stage, True
    written: list[Results] = []
    with hold_interrupts():  # once the search has ended, its report is written whatever keys are pressed
        with Bar(title) as bar, telling(show_stages_on(bar, JUDGED_SOON)):
            try:
                work(Listener(lambda p: bar.show(shown(p)), bar.note, written.append))
            except KeyboardInterrupt:
                if not (folder / RESULT).is_file():
                    raise
                judged = False
        if written and judged:
            report = write_report_of(written[0], folder, live=False)
            return Outcome(folder, report, written[0].record, results=written[0])
        report = write_report(folder, live=False)
        return Outcome(folder, report, dict(kind_of(folder).read(folder)), judged)


def print_outcome(outcome: Outcome, json: bool, *, strict: bool = False, live: bool = True) -> None:
    """Print the verdict of a run, in full its tables too, or its record; exit status 130 if it was stopped.

    With `live` the main chart of its report is made one that simulates, unless it was stopped.

    `StudyError` if `strict` and the run has given a warning; its files are written.
    """
    from commonrail.calibration.record import CalibrationRecord, read_as
    from commonrail.report.fit.verdict import verdict

    record, warnings = outcome.record, outcome.record["warnings"]
    fit = read_as(CalibrationRecord, record)
    if json:
        places = {"run": str(outcome.folder), "report": str(outcome.report)}
        judged = verdict(fit, str(outcome.folder)).record()
        print_json({"kind": "calibration", **places, "verdict": judged, "result": record})
    else:
        print_fit(outcome)
        top = f" ({count_noun(len(warnings), 'warning')} at its top)" if warnings else ""
        click.echo(f"report: {outcome.report}{top}")
    end_if_stopped(outcome)
    if live:
        make_live(outcome)
    if strict and warnings:
        raise StudyError(
            f"{outcome.folder} is written, and has {count_noun(len(warnings), 'warning')}; the first: "
            f"{warnings[0]['sentence']}"
        )


def print_fit(outcome: Outcome) -> None:
    """Print verdict, figures, reasons and next commands of a calibration, in full its tables too."""
    from commonrail.calibration.record import CalibrationRecord, read_as

    fit, short = read_as(CalibrationRecord, outcome.record), short_form()
    if short is None:
        _print_in_full(fit)
    print_synthetic(outcome.record["synthetic"])
    print_card(fit, str(outcome.folder))
    if short is not None:
        short.tables += [table.title for table in _tables(fit)]


def make_live(outcome: Outcome) -> None:
    """Write the report of a run again with a main chart that simulates, where it can; Ctrl-C leaves it as it is.

    The first of a variant is compiled for some time, so the verdict and a report without it are there before.
    """
    from commonrail.report.page import write_report, write_report_of
    from commonrail.report.result_kind import kind_of

    if outcome.results is not None:
        write_report_of(outcome.results, outcome.folder)
    elif outcome.report.is_file() and kind_of(outcome.folder).still:
        write_report(outcome.folder)


def _tables(fit: CalibrationRecord) -> tuple[Table, ...]:
    """All tables of a calibration."""
    from commonrail.report.fit.certainty import likelihood_tables
    from commonrail.report.fit.tables import parameter_table, tables_of
    from commonrail.report.fit.verdict import judgement_tables

    return (
        *tables_of(fit.data),
        parameter_table(fit.parameters, fit.certainty),
        *likelihood_tables(fit.certainty),
        *judgement_tables(fit),
    )


def _print_in_full(fit: CalibrationRecord) -> None:
    """Print all tables and sentences of a calibration."""
    from commonrail.report.fit.certainty import certainty_lines
    from commonrail.report.fit.verdict import baseline_lines, convergence_lines, judgement_lines

    for table in _tables(fit):
        print_table(table)
    print_lines(convergence_lines(fit))
    print_lines(certainty_lines(fit.certainty))
    print_lines(baseline_lines(fit.data))
    print_lines(judgement_lines(fit))


COLOURS = {"good": "green", "care": "yellow", "bad": "red"}  # of the levels of a verdict
BEFORE_WORDS = 36  # columns of a tile's sign, name and figure
FEWEST_WORDS = 24  # columns below which the words of a tile go below its figure


def print_card(fit: CalibrationRecord, run: str) -> None:
    """Print verdict, figures, reasons and next commands of a calibration; in a short form those that fit."""
    from commonrail.report.fit.verdict import tiles, verdict

    judged, short = verdict(fit, run), short_form()
    bar = click.style("┃", fg=COLOURS[judged.level])
    title = [f"{bar}{click.style(line[1:], bold=True)}" for line in wrap_line(f"┃ {judged.headline}", "┃ ")]
    figures = list(chain.from_iterable(_tile_lines(tile, bar) for tile in tiles(fit)))
    reasons = [wrap_line(f"- {reason}", "  ") for reason in (*judged.reasons[1:], *judged.notes)]
    steps = [
        [*wrap_line(f"{number} {step.text}", "  "), *(click.style(c, bold=True) for c in _command(step.command))]
        for number, step in enumerate(judged.steps, start=1)
    ]
    if short:
        first_step = sum(map(len, steps[:1]))
        short.lines -= len(figures) + first_step
        reasons = short.take("reason", reasons, least=1)
        short.lines += first_step
        steps = short.take("step", steps, least=1)
    click.echo("\n".join([*title, *figures, *chain.from_iterable((*reasons, *steps))]))


def _tile_lines(tile: Tile, bar: str) -> list[str]:
    """Lines of a figure: sign, name, figure, and its words, broken where the terminal ends."""
    figure = click.style(f"{tile.figure:<20}", fg=COLOURS.get(tile.level))
    line = f"{bar} {tile.sign or ' '} {tile.head:<11}{figure}"
    if not sys.stdout.isatty():
        return [f"{line} {tile.words}"]
    room = columns_of(sys.stdout) - BEFORE_WORDS
    if room >= FEWEST_WORDS:
        first, *others = textwrap.wrap(tile.words, room) or [""]
        return [f"{line} {first}", *(f"{bar}{' ' * (BEFORE_WORDS - 1)}{other}" for other in others)]
    return [line, *(f"{bar}     {other}" for other in textwrap.wrap(tile.words, room + BEFORE_WORDS - 6))]


def _command(command: str) -> list[str]:
    """Lines of a command, which a shell takes as one; a terminal would break it within an option."""
    if os.name == "nt" or not sys.stdout.isatty():
        return [f"  {command}"] if command else []
    width = columns_of(sys.stdout) - 2  # that of the sign at the end
    lines = textwrap.wrap(command, width, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)
    return [f"{line} \\" for line in lines[:-1]] + lines[-1:]


def end_if_stopped(outcome: Outcome) -> None:
    """End the command with exit status 130 and a sentence if a search or its judgement was stopped by a signal."""
    if outcome.interrupted:
        say(
            f"commonrail: interrupted; the best values so far are in {outcome.folder}. "
            f"`{command('resume', outcome.folder)}` resumes the run."
        )
        raise SystemExit(INTERRUPTED)
    if not outcome.judged:
        say(
            f"commonrail: interrupted; the fit is in {outcome.folder}, but not how well the data determine it. "
            f"`{command('resume', outcome.folder)}` judges that."
        )
        raise SystemExit(INTERRUPTED)


def stage_of(p: Progress, counted: str = "injections") -> Stage:
    """Stage of a search for the bar."""
    speed = p.simulated / p.seconds if p.seconds > 0.0 else 0.0
    figures = f"best {p.best:.4g}, mean {p.mean:.4g}, {speed:.0f} {counted}/s"
    return Stage(p.phase, p.generation, p.generations, figures)
