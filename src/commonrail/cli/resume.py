"""commonrail resume: resume a stopped run, of a family or an FMU too, or extend a finished one by generations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import ClusterAddress, Json, Threads, WorkerCount, open_workers
from commonrail.errors import InputError

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
    from commonrail.cli.family_run import print_family, resume_run
    from commonrail.cli.study_run import print_outcome, resume_study
    from commonrail.family.run import TYPE, is_family_run
    from commonrail.foreign.run import is_fmu_run

    if is_fmu_run(run):
        from commonrail.cli.fmu_run import print_fmu, refuse_workers, resume_fmu_run

        refuse_workers(workers, cluster)
        if generations:
            raise InputError(f"--generations: {run} is the run of an FMU; state them in a new study file.")
        print_fmu(resume_fmu_run(run, as_begun=as_begun, processes=threads), json)
        return
    if is_family_run(run):
        if generations:
            raise InputError(f"--generations: {run} is the run of a family; state them in a new family file.")
        with open_workers(workers, cluster) as crew:
            joint = resume_run(run, as_begun=as_begun, threads=threads, workers=crew)
        print_family(joint, json, run / TYPE)
        return
    with open_workers(workers, cluster) as crew:
        outcome = resume_study(run, generations=generations, as_begun=as_begun, threads=threads, workers=crew)
    print_outcome(outcome, json)
