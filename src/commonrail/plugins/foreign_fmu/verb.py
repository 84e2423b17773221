"""Calibration of a foreign FMU in a run folder, and its resumption: progress, result, report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from commonrail.base.errors import InputError
from commonrail.cli.console import Stage, print_json, print_table
from commonrail.cli.fit import end_if_stopped, reported
from commonrail.cli.options import free_run_folder, stem_of
from commonrail.cli.study_kind import RunOptions, StudyKind

if TYPE_CHECKING:
    from commonrail.calibration.search import Progress
    from commonrail.plugins.foreign_fmu.fit import FmuFit
    from commonrail.runs.fit import Listener


def _refuse_workers(options: RunOptions) -> None:
    """Refuse options that have no meaning for an FMU."""
    if options.workers is not None or options.cluster is not None:
        name = "--workers" if options.cluster is None else "--cluster"
        raise InputError(f"{name}: an FMU is simulated in processes of this machine; give their number by --threads.")


def _calibrate(study: Path, out: Path | None, options: RunOptions) -> None:
    from commonrail.plugins.foreign_fmu.run import calibrate_fmu_into
    from commonrail.plugins.foreign_fmu.study import load_fmu_study

    _refuse_workers(options)
    folder, fmu = out or free_run_folder(stem_of(study)), load_fmu_study(study)
    fmu = fmu if options.seed is None else replace(fmu, seed=options.seed)

    def calibrated(listener: Listener) -> FmuFit:
        return calibrate_fmu_into(folder, fmu, processes=options.threads, listener=listener)

    _run(fmu.title, folder, calibrated, options.json)


def _resume(folder: Path, options: RunOptions) -> None:
    from commonrail.plugins.foreign_fmu.run import resume_fmu

    _refuse_workers(options)

    def resumed(listener: Listener) -> FmuFit:
        return resume_fmu(
            folder,
            generations=options.generations,
            as_begun=options.as_begun,
            processes=options.threads,
            listener=listener,
        )

    _run(f"resuming {folder}", folder, resumed, options.json)


STUDY = StudyKind(_resume, _calibrate)


def _stage_of(p: Progress) -> Stage:
    speed = p.simulated / p.seconds if p.seconds > 0.0 else 0.0
    figures = f"best {p.best:.4g}, mean {p.mean:.4g}, {speed:.0f} simulations/s"
    return Stage(p.phase, p.generation, p.generations, figures)


def _run(title: str, folder: Path, search: Callable[[Listener], FmuFit], json: bool) -> None:
    """Search with progress on stderr, and print the record or its figures; exit status 130 if it was stopped."""
    from commonrail.plugins.foreign_fmu.page import fmu_lines, fmu_tables
    from commonrail.plugins.foreign_fmu.run import read_fmu_run

    report, _ = reported(title, folder, search, _stage_of)
    record = read_fmu_run(folder)
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
