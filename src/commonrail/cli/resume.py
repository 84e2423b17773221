"""commonrail resume: go on with a run that was stopped, or add generations to one that was finished."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from commonrail.cli.options import ClusterAddress, Json, Threads, WorkerCount, open_workers

__all__ = ["resume"]


def resume(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder; it may have been moved or copied.")],
    *,
    generations: Annotated[
        int, typer.Option(min=0, metavar="N", help="Add so many generations to those of the study.")
    ] = 0,
    as_begun: Annotated[
        bool, typer.Option("--as-begun", help="Go on although the files that were copied into RUN have changed since.")
    ] = False,
    threads: Threads = None,
    workers: WorkerCount = None,
    cluster: ClusterAddress = None,
    json: Json = False,
) -> None:
    """Go on with a run that was stopped, or lengthen one.

    It may have been stopped by Ctrl-C, a crash, a power cut or a full disk: the result is that of a run
    that was never stopped, to the last bit. A finished run is written anew, or goes on with
    --generations.

    \b
    Example:
      commonrail resume runs/paper-1 --generations 30
    """
    from commonrail.cli.study_run import print_outcome, resume_study

    with open_workers(workers, cluster) as crew:
        outcome = resume_study(run, generations=generations, as_begun=as_begun, threads=threads, workers=crew)
    print_outcome(outcome, json)
