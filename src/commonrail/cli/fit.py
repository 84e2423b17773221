"""A fit in its run folder on the command line: progress, report, figures, end."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Callable, Mapping
from itertools import accumulate, chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from commonrail.base.errors import StudyError
from commonrail.base.stages import telling
from commonrail.base.text import command, count_noun, quantity
from commonrail.cli.console import Bar, Stage, columns_of, print_json, print_lines, print_table, say, shown_by, wrapped
from commonrail.cli.guard import INTERRUPTED

if TYPE_CHECKING:
    from commonrail.calibration.search import Progress
    from commonrail.calibration.study import Study
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
    return reported(
        f"{study.title}: {points}, steps of {quantity(study.time_step, 's')} (seconds for one curve, minutes for many)",
        folder,
        lambda listener: calibrate_into(
            folder, study, threads=threads, workers=workers, listener=listener, strict=strict
        ),
    )


def reported(
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
        with Bar(title) as bar, telling(shown_by(bar, JUDGED_SOON)):
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


def print_outcome(outcome: Outcome, json: bool, *, full: bool = False, strict: bool = False, live: bool = True) -> None:
    """Print the verdict of a run, with `full` its tables too, or its record; exit status 130 if it was stopped.

    With `live` the main chart of its report is made one that simulates, unless it was stopped.

    `StudyError` if `strict` and the run has given a warning; its files are written.
    """
    from commonrail.calibration.record import CalibrationRecord, read_as
    from commonrail.report.fit.verdict import verdict

    record, warnings = outcome.record, outcome.record["warnings"]
    if json:
        places = {"run": str(outcome.folder), "report": str(outcome.report)}
        judged = verdict(read_as(CalibrationRecord, record), str(outcome.folder)).record()
        print_json({"kind": "calibration", **places, "verdict": judged, "result": record})
    else:
        if full:
            _print_tables(record)
        if record["synthetic"]:
            print_lines([f"SYNTHETIC: {record['synthetic']}"])
        print_card(record, str(outcome.folder))
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


def _print_tables(record: Mapping[str, Any]) -> None:
    """Print all tables and sentences of a calibration."""
    from commonrail.calibration.record import CalibrationRecord, read_as
    from commonrail.report.fit.certainty import certainty_lines, likelihood_tables
    from commonrail.report.fit.tables import parameter_table, tables_of
    from commonrail.report.fit.verdict import baseline_lines, convergence_lines, judgement_lines, judgement_tables

    fit = read_as(CalibrationRecord, record)
    tables = (
        *tables_of(fit.data),
        parameter_table(fit.parameters, fit.certainty),
        *likelihood_tables(fit.certainty),
        *judgement_tables(fit),
    )
    for table in tables:
        print_table(table)
    print_lines(convergence_lines(fit))
    print_lines(certainty_lines(fit.certainty))
    print_lines(baseline_lines(fit.data))
    print_lines(judgement_lines(fit))


COLOURS = {"good": "green", "care": "yellow", "bad": "red"}  # of the levels of a verdict
LINES, STEPS = 15, 3  # lines of the card in a terminal, and commands in it


def print_card(record: Mapping[str, Any], run: str) -> None:
    """Print verdict, figures, reasons and next commands of a calibration in some `LINES`, reasons cut first."""
    from commonrail.calibration.record import CalibrationRecord, read_as
    from commonrail.report.fit.verdict import tiles, verdict

    fit = read_as(CalibrationRecord, record)
    judged, figures = verdict(fit, run), tiles(fit)
    bar = click.style("┃", fg=COLOURS[judged.level])
    title = wrapped(f"┃ {judged.headline}", "┃ ")
    click.echo("\n".join(f"{bar}{click.style(line[1:], bold=True)}" for line in title))
    for tile in figures:
        figure = click.style(f"{tile.figure:<20}", fg=COLOURS.get(tile.level))
        click.echo(f"{bar} {tile.sign or ' '} {tile.head:<11}{figure} {_one_line(tile.words, 37)}")
    steps = []
    for number, step in enumerate(judged.steps[:STEPS], start=1):
        steps += [*wrapped(f"{number} {step.text}", "  "), *(click.style(c, bold=True) for c in _command(step.command))]
    room = max(LINES - len(title) - len(figures) - len(steps), 2)
    reasons = [wrapped(f"- {reason}", "  ") for reason in (*judged.reasons[1:], *judged.notes)]
    shown = max(sum(size <= room for size in accumulate(map(len, reasons))), 1)
    lines = list(chain.from_iterable(reasons[:shown]))
    if len(reasons) > shown:
        lines.append(f"  … {count_noun(len(reasons) - shown, 'more reason')} in the report")
    click.echo("\n".join([*lines, *steps]))


def _command(command: str) -> list[str]:
    """Lines of a command, which a shell takes as one; a terminal would break it within an option."""
    if os.name == "nt" or not sys.stdout.isatty():
        return [f"  {command}"] if command else []
    width = columns_of(sys.stdout) - 2  # that of the sign at the end
    found = textwrap.wrap(command, width, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)
    return [f"{line} \\" for line in found[:-1]] + found[-1:]


def _one_line(text: str, before: int) -> str:
    """Text cut between words to the line of a terminal of which so many columns are taken; in a file the whole text."""
    if not sys.stdout.isatty():
        return text
    return textwrap.shorten(text, max(columns_of(sys.stdout) - before, 20), placeholder=" …")


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
