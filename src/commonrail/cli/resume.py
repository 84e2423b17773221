"""commonrail resume: resume a stopped run, of a family or an FMU too, or extend a finished one by generations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import ClusterAddress, Json, Threads, WorkerCount, open_workers

__all__ = ["resume"]


@verb
def resume(
    run: Annotated[Path, Argument(metavar="RUN", help="Run folder, which may have been moved or copied.")],
    *,
    generations: Annotated[
        int, Option(min=0, metavar="N", help="Number of generations to add to those of the run.")
    ] = 0,
    as_begun: Annotated[
        bool, Option("--as-begun", help="Use the copies in RUN although the files outside have changed since.")
    ] = False,
    threads: Threads = None,
    workers: WorkerCount = None,
    cluster: ClusterAddress = None,
    json: Json = False,
) -> None:
    """Resume a stopped run, or extend a finished one.

    A run may be stopped by Ctrl-C, a crash, a power cut or a full disk. The result of the resumed run has
    the same bits as that of a run that was never stopped. Of a finished run the results are written again;
    --generations extends it.

    \b
    Example:
      commonrail resume runs/paper-1 --generations 30
    """
    from commonrail.cli.study_kind import RunOptions, kind_of_run
    from commonrail.cli.study_run import print_outcome, resume_study

    if kind := kind_of_run(run):
        options = RunOptions(
            generations=generations, as_begun=as_begun, threads=threads, workers=workers, cluster=cluster, json=json
        )
        kind.resume(run, options)
        return
    with open_workers(workers, cluster) as crew:
        outcome = resume_study(run, generations=generations, as_begun=as_begun, threads=threads, workers=crew)
    print_outcome(outcome, json)
