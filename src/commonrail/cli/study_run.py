"""Calibrate one study into a run folder: search, identification, files, report."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from commonrail.cli.console import say
from commonrail.cli.progress import Bar, Stage
from commonrail.files.atomic import writing

if TYPE_CHECKING:
    from commonrail.calibration.run import Calibration, Progress
    from commonrail.calibration.study import Study
    from commonrail.calibration.workers import Workers

__all__ = ["Outcome", "run_study"]


class Outcome(NamedTuple):
    """Run folder, report and the record in result.json."""

    folder: Path
    report: Path
    record: dict[str, Any]

    @property
    def interrupted(self) -> bool:
        """Whether the user stopped the search."""
        return bool(self.record["status"] == "interrupted")


def run_study(study: Study, folder: Path, threads: int | None, workers: Workers | None = None) -> Outcome:
    """Calibrate a study into a new folder, telling the progress on stderr.

    Raises
    ------
    InputError
        If the folder is not empty or cannot be written.
    StudyError
        If the study cannot be run; the empty folder is taken away again.
    """
    from commonrail.calibration.interrupt import held_interrupts
    from commonrail.calibration.run import calibrate
    from commonrail.files.run_folder import create_run_folder, read_run, write_run
    from commonrail.report.build import write_report

    create_run_folder(folder)
    with held_interrupts():  # once the search has ended, its result is written whatever keys are pressed
        try:
            with Bar(study.title) as bar:
                calibration = calibrate(study, threads=threads, progress=lambda p: bar.show(_stage(p)), workers=workers)
            identified = _identified(calibration, threads)
            with writing(folder):
                write_run(folder, calibration, identified)
        except BaseException:
            with suppress(OSError):
                folder.rmdir()  # only if nothing was written
            raise
        return Outcome(folder, write_report(folder), read_run(folder)[0])


def _identified(calibration: Calibration, threads: int | None) -> Mapping[str, Mapping[str, Any]]:
    from commonrail.analysis.identifiability import identify

    say("judging which parameters the data pin down ...")
    try:
        return identify(calibration, threads)
    except KeyboardInterrupt:
        say("commonrail: stopped; the result is written without that judgement.")
        return {}


def _stage(p: Progress) -> Stage:
    return Stage(p.phase, p.generation, p.generations, _figures(p))


def _figures(p: Progress) -> str:
    speed = p.simulated / p.seconds if p.seconds > 0.0 else 0.0
    return f"best {p.best:.4g}, mean {p.mean:.4g}, {speed:.0f} injections/s"
