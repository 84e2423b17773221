"""commonrail calibrate: fit the free parameters of a study to its data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from commonrail.cli.options import ClusterAddress, Json, StudyFile, Threads, WorkerCount, open_workers
from commonrail.cli.output import free_run_folder

__all__ = ["calibrate"]


def calibrate(
    study: StudyFile,
    *,
    out: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="New run folder; runs/<study>-<n> by default."),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the study's.")] = None,
    threads: Threads = None,
    workers: WorkerCount = None,
    cluster: ClusterAddress = None,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Count warnings as errors: nothing is run, or the exit status is 2 after it."),
    ] = False,
    json: Json = False,
) -> None:
    """Fit a study and write a run folder.

    Ctrl-C ends the search in order: the best values so far are judged and written, and the exit
    status is 130. Whatever stops a run, `commonrail resume RUN` goes on with it.

    \b
    Example:
      commonrail calibrate cases/paper/study.toml --out runs/paper --seed 1
    """
    from commonrail.cli.study_run import print_outcome, run_study
    from commonrail.files.study_file import load_study

    loaded = load_study(study)
    if seed is not None:
        loaded = replace(loaded, seed=seed)
    with open_workers(workers, cluster) as crew:
        outcome = run_study(loaded, out or free_run_folder(_stem(study)), threads, crew, strict=strict)
    print_outcome(outcome, json, strict=strict)


def _stem(study: Path) -> str:
    """Name for runs: a file that is called study says less than its folder."""
    return study.absolute().parent.name if study.stem == "study" else study.stem
