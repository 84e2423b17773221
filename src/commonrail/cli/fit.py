"""Calibration of a study into a run folder, and its resumption: progress, result, report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click

from commonrail.base.errors import StudyError
from commonrail.base.text import counted
from commonrail.base.units import to_text
from commonrail.cli.console import Bar, Stage, print_json, print_table, say
from commonrail.cli.guard import INTERRUPTED

if TYPE_CHECKING:
    from commonrail.calibration.search import Progress
    from commonrail.calibration.study import Study
    from commonrail.runs.fit import Listener
    from commonrail.workers.workers import Workers

_Result = TypeVar("_Result")


class Outcome(NamedTuple):
    """Run folder, report and the record in result.json."""

    folder: Path
    report: Path
    record: dict[str, Any]

    @property
    def interrupted(self) -> bool:
        """Return whether the search was stopped by a signal."""
        return bool(self.record["status"] == "interrupted")


def run_study(
    study: Study, folder: Path, threads: int | None, workers: Workers | None = None, *, strict: bool = False
) -> Outcome:
    """Calibrate a study into a new folder, with progress and warnings on stderr.

    Without `threads` all processors are used, without `workers` this process simulates. Raises `InputError` if the
    folder is not empty, `OutputError` if it cannot be written, and `StudyError` if the study cannot be run, or is
    `strict` and gives a warning; the folder is removed if nothing was simulated.
    """
    from commonrail.runs.fit import calibrate_into

    def work(listener: Listener) -> object:
        return calibrate_into(folder, study, threads=threads, workers=workers, listener=listener, strict=strict)

    return outcome_of(f"{study.title}: steps of {to_text(study.time_step, 's')}", folder, work)


def outcome_of(title: str, folder: Path, work: Callable[[Listener], object]) -> Outcome:
    """Outcome of work that fills a run folder, with its progress on stderr."""
    from commonrail.runs.folder import read_result

    return Outcome(folder, reported(title, folder, work)[0], read_result(folder))


def reported(
    title: str, folder: Path, work: Callable[[Listener], _Result], stage: Callable[[Progress], Stage] | None = None
) -> tuple[Path, _Result]:
    """Report of a run folder and the result of the search that fills it, with its progress on stderr.

    `stage` makes the stage for the bar, by default `stage_of`.
    """
    from commonrail.report.page import write_report
    from commonrail.runs.fit import Listener
    from commonrail.workers.interrupt import held_interrupts

    shown = stage_of if stage is None else stage
    with held_interrupts():  # once the search has ended, its report is written whatever keys are pressed
        with Bar(title) as bar:
            result = work(Listener(lambda p: bar.show(shown(p)), bar.note))
        return write_report(folder), result


def print_outcome(outcome: Outcome, json: bool, *, strict: bool = False) -> None:
    """Print the figures of a run; exit status 130 if it was stopped.

    `json`: print the record instead of tables. `strict`: treat warnings as errors. Raises `StudyError` if `strict` and
    the run has given a warning; its files are written.
    """
    from commonrail.report.fit.certainty import certainty_lines, certainty_tables
    from commonrail.report.fit.tables import parameter_table, tables_of
    from commonrail.report.fit.verdict import baseline_lines, convergence_lines, judgement_lines, judgement_tables

    warnings = outcome.record["warnings"]
    if json:
        places = {"run": str(outcome.folder), "report": str(outcome.report)}
        print_json({"kind": "calibration", **places, "result": outcome.record})
    else:
        if outcome.record["synthetic"]:
            click.echo(f"SYNTHETIC: {outcome.record['synthetic']}")
        record = outcome.record
        for table in (
            *tables_of(record["data"]),
            parameter_table(record["parameters"], record.get("certainty")),
            *certainty_tables(record),
            *judgement_tables(record),
        ):
            print_table(table)
        lines = (
            convergence_lines(record),
            certainty_lines(record),
            baseline_lines(record["data"]),
            judgement_lines(record),
        )
        for line in (line for group in lines for line in group):
            click.echo(line)
        click.echo(f"report: {outcome.report}{_mention(warnings)}")
    end_if_stopped(outcome.record["status"], outcome.folder)
    if strict and warnings:
        raise StudyError(
            f"{outcome.folder} is written, and has {counted(len(warnings), 'warning')}; the first: "
            f"{warnings[0]['sentence']}"
        )


def end_if_stopped(status: str, folder: Path) -> None:
    """End the command with exit status 130 and a sentence if a search was stopped by a signal."""
    if status == "interrupted":
        say(
            f"commonrail: interrupted; the best values so far are in {folder}. `commonrail resume {folder}` resumes "
            "the run."
        )
        raise SystemExit(INTERRUPTED)


def _mention(warnings: Sequence[Any]) -> str:
    return f" ({counted(len(warnings), 'warning')} at its top)" if warnings else ""


def stage_of(p: Progress) -> Stage:
    """Stage of a search for the bar."""
    return Stage(p.phase, p.generation, p.generations, _figures(p))


def _figures(p: Progress) -> str:
    speed = p.simulated / p.seconds if p.seconds > 0.0 else 0.0
    return f"best {p.best:.4g}, mean {p.mean:.4g}, {speed:.0f} injections/s"
