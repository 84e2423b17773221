"""commonrail calibrate: fit the free parameters of a study, of an FMU too, to its data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from commonrail.cli.grammar import Option, verb
from commonrail.cli.options import ClusterAddress, Json, StudyFile, Threads, WorkerCount, open_workers
from commonrail.cli.output import free_run_folder, stem_of

__all__ = ["calibrate"]


@verb
def calibrate(
    study: StudyFile,
    *,
    out: Annotated[
        Path | None,
        Option(metavar="RUN", help="New run folder. [default: runs/<study>-<n>]"),
    ] = None,
    seed: Annotated[
        int | None, Option(min=0, help="Seed of the random numbers. [default: as in the study file]")
    ] = None,
    threads: Threads = None,
    workers: WorkerCount = None,
    cluster: ClusterAddress = None,
    strict: Annotated[
        bool,
        Option(
            "--strict", help="Treat warnings as errors: before the fit nothing is run, after it the exit status is 2."
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Fit a study and write a run folder.

    The study of an FMU is fitted too; --threads is then the number of processes that simulate it.
    Ctrl-C stops the search: the best values so far are scored and written, and the exit status is 130.
    `commonrail resume RUN` resumes a run, however it was stopped.

    \b
    Example:
      commonrail calibrate cases/paper/study.toml --out runs/paper --seed 1
    """
    from commonrail.cli.study_kind import RunOptions, kind_of_study
    from commonrail.cli.study_run import print_outcome, run_study
    from commonrail.files.study_file import load_study

    kind = kind_of_study(study)
    if kind and kind.calibrate:
        kind.calibrate(study, out, RunOptions(seed, threads=threads, workers=workers, cluster=cluster, json=json))
        return
    loaded = load_study(study)
    if seed is not None:
        loaded = replace(loaded, seed=seed)
    with open_workers(workers, cluster) as crew:
        outcome = run_study(loaded, out or free_run_folder(stem_of(study)), threads, crew, strict=strict)
    print_outcome(outcome, json, strict=strict)
