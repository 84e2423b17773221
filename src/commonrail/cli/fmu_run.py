"""Calibration of a foreign FMU in a run folder, and its resumption: progress, result, report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from commonrail.cli.console import print_json, print_table
from commonrail.cli.progress import Stage
from commonrail.cli.study_run import end_if_stopped, reported
from commonrail.errors import InputError

if TYPE_CHECKING:
    from commonrail.calibration.search import Progress
    from commonrail.foreign.fit import FmuFit
    from commonrail.store.run import Listener

__all__ = ["FmuOutcome", "print_fmu", "refuse_workers", "resume_fmu_run", "run_fmu"]


class FmuOutcome(NamedTuple):
    """Run folder, its report and the record."""

    folder: Path
    report: Path
    record: dict[str, Any]


def refuse_workers(workers: int | None, cluster: str | None) -> None:
    """Refuse options that have no meaning for an FMU.

    Raises
    ------
    InputError
    """
    if workers is not None or cluster is not None:
        name = "--workers" if cluster is None else "--cluster"
        raise InputError(f"{name}: an FMU is simulated in processes of this machine; give their number by --threads.")


def run_fmu(source: Path, folder: Path, seed: int | None, processes: int | None) -> FmuOutcome:
    """Calibrate the FMU of a study file in a new run folder, with progress on stderr.

    Parameters
    ----------
    source : Path
        Study file.
    folder : Path
        New or empty.
    seed : int or None
        None: that of the file.
    processes : int or None
        None: all processors.

    Raises
    ------
    InputError, OutputError, StudyError, SimulationError
        As `commonrail.foreign.run.calibrate_fmu_into`.
    """
    from commonrail.foreign.run import calibrate_fmu_into
    from commonrail.foreign.study_file import load_fmu_study

    study = load_fmu_study(source)
    study = study if seed is None else replace(study, seed=seed)

    def calibrated(listener: Listener) -> FmuFit:
        return calibrate_fmu_into(folder, study, processes=processes, listener=listener)

    return _told(study.title, folder, calibrated)


def resume_fmu_run(folder: Path, *, as_begun: bool, processes: int | None) -> FmuOutcome:
    """Resume a calibration of an FMU, with its progress on stderr.

    Parameters
    ----------
    folder : Path
        Of the run.
    as_begun : bool
        Accept files outside the folder that have changed.
    processes : int or None
        None: all processors.

    Raises
    ------
    StudyError, OutputError
        As `commonrail.foreign.run.resume_fmu`.
    """
    from commonrail.foreign.run import resume_fmu

    def resumed(listener: Listener) -> FmuFit:
        return resume_fmu(folder, as_begun=as_begun, processes=processes, listener=listener)

    return _told(f"resuming {folder}", folder, resumed)


def _told(title: str, folder: Path, work: Callable[[Listener], FmuFit]) -> FmuOutcome:
    from commonrail.foreign.run import read_fmu_run

    report, _ = reported(title, folder, work, _stage_of)
    return FmuOutcome(folder, report, read_fmu_run(folder))


def _stage_of(p: Progress) -> Stage:
    speed = p.simulated / p.seconds if p.seconds > 0.0 else 0.0
    figures = f"best {p.best:.4g}, mean {p.mean:.4g}, {speed:.0f} simulations/s"
    return Stage(p.phase, p.generation, p.generations, figures)


def print_fmu(outcome: FmuOutcome, json: bool) -> None:
    """Print the figures of a calibration of an FMU; exit status 130 if it was stopped.

    Parameters
    ----------
    outcome : FmuOutcome
    json : bool
        Print the record instead of tables.
    """
    from commonrail.report.foreign import fmu_lines, fmu_tables

    folder, report, record = outcome
    if json:
        print_json({"kind": "fmu calibration", "run": str(folder), "report": str(report), "result": record})
    else:
        if record["synthetic"]:
            click.echo(f"SYNTHETIC: {record['synthetic']}")
        for table in fmu_tables(record):
            print_table(table)
        for line in fmu_lines(record):
            click.echo(line)
        click.echo(f"report: {report}")
    end_if_stopped(record["status"], folder)
