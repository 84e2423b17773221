"""Run a reproduction into a folder: repetitions, record, curves, figures for print, report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from commonrail.cli.console import say
from commonrail.cli.progress import Bar, Stage
from commonrail.cli.study_run import Outcome
from commonrail.files.atomic import writing

if TYPE_CHECKING:
    from commonrail.analysis.seeds import SeedProgress

__all__ = ["run_reproduction"]

TIME_STEP = 1e-6


def run_reproduction(truth: str, count: int, folder: Path, threads: int | None, quick: bool) -> Outcome:
    """Repeat the paper's study into a new folder, with its progress on stderr.

    Parameters
    ----------
    truth : str
        Name of a truth, or its file.
    count : int
        Number of repetitions, with seeds 1 to `count`.
    folder : Path
        New or empty.
    threads : int or None
        None: all processors.
    quick : bool
        Noted in the record.

    Raises
    ------
    InputError
        If the truth cannot be read, or the folder is not empty or cannot be written.
    SimulationError
        If the truth cannot be simulated; the empty folder is removed.
    """
    from commonrail.analysis.virtual_bench import Bench
    from commonrail.files.injector_file import load_injector
    from commonrail.files.reproduction_folder import write_reproduction
    from commonrail.files.run_folder import new_run_folder
    from commonrail.files.truth_file import load_truth
    from commonrail.report.build import write_report
    from commonrail.report.paper import draw_plates
    from commonrail.reproduction.record import reproduction_record
    from commonrail.reproduction.run import reproduce
    from commonrail.workers.interrupt import held_interrupts

    declared = load_truth(truth)
    bench = Bench(declared, load_injector(declared.injector), TIME_STEP)
    with held_interrupts():  # once the repetitions have ended, they are written whatever keys are pressed
        with new_run_folder(folder):
            with Bar(f"{count} repetitions of the paper's study on the virtual test bench (synthetic)") as bar:
                outcome = reproduce(bench, range(1, count + 1), threads=threads, progress=lambda p: bar.show(_stage(p)))
            record = reproduction_record(outcome, quick)
            with writing(folder):
                write_reproduction(folder, outcome, record)
        with writing(folder):
            lacking = draw_plates(folder)
        if lacking:
            say(lacking)
        return Outcome(folder, write_report(folder), record)


def _stage(p: SeedProgress) -> Stage:
    return Stage("generations", p.generation, p.generations, f"{p.done} of {p.seeds} repetitions")
