"""Calibrate a foreign FMU into a run folder, or resume it: progress, result, report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from commonrail.base.errors import InputError
from commonrail.cli.console import print_json, print_synthetic, print_text
from commonrail.cli.fit import end_if_stopped, run_and_report, stage_of
from commonrail.cli.options import free_run_folder, stem_of
from commonrail.cli.study_kind import RunOptions, StudyKind


def _refuse_workers(options: RunOptions) -> None:
    """Refuse options that do not apply to an FMU."""
    if options.workers is not None or options.cluster is not None:
        name = "--workers" if options.cluster is None else "--cluster"
        raise InputError(f"{name}: an FMU is simulated in processes of this machine; give their number by --threads.")


def _calibrate(study: Path, out: Path | None, options: RunOptions) -> None:
    from commonrail.plugins.foreign_fmu.run import calibrate_fmu_into
    from commonrail.plugins.foreign_fmu.study import load_fmu_study

    _refuse_workers(options)
    folder, fmu = out or free_run_folder(stem_of(study)), load_fmu_study(study)
    fmu = fmu if options.seed is None else replace(fmu, seed=options.seed)

    _run(fmu.title, folder, partial(calibrate_fmu_into, folder, fmu, processes=options.threads), options.json)


def _resume(folder: Path, options: RunOptions) -> None:
    from commonrail.plugins.foreign_fmu.run import resume_fmu

    _refuse_workers(options)
    settings: dict[str, Any] = {
        "generations": options.generations,
        "as_begun": options.as_begun,
        "processes": options.threads,
    }
    _run(f"resuming {folder}", folder, partial(resume_fmu, folder, **settings), options.json)


STUDY = StudyKind(_resume, _calibrate)


def _run(title: str, folder: Path, search: Callable[..., object], json: bool) -> None:
    """Search with progress on stderr, then print the result; exit status 130 if stopped."""
    from commonrail.plugins.foreign_fmu.page import fmu_lines, fmu_tables

    stage = partial(stage_of, counted="simulations")
    outcome = run_and_report(title, folder, lambda listener: search(listener=listener), stage)
    record = outcome.record
    if json:
        places = {"run": str(folder), "report": str(outcome.report)}
        print_json({"kind": "fmu calibration", **places, "result": record})
    else:
        print_synthetic(record["synthetic"])
        print_text(fmu_lines(record), fmu_tables(record))
        click.echo(f"report: {outcome.report}")
    end_if_stopped(outcome)
