"""commonrail calibrate: fit the free parameters of a study, of an FMU too, to its data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import click

from commonrail.base.errors import InputError
from commonrail.base.units import to_text
from commonrail.cli.console import say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import (
    ClusterAddress,
    Json,
    NoLive,
    StudyFile,
    Threads,
    WorkerCount,
    free_run_folder,
    open_workers,
    stem_of,
)


@table_verb
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
    widen: Annotated[
        Path | None,
        Option(metavar="RUN", help="Run of this study: bounds that it has met are widened, see below."),
    ] = None,
    free: Annotated[
        tuple[str, ...], Option(metavar="NAME", help="Parameter to free besides, see below; may be repeated.")
    ] = (),
    no_live: NoLive = False,
    json: Json = False,
) -> None:
    """Fit a study and write a run folder.

    The study of an FMU is fitted too; --threads is then the number of processes that simulate it.
    Ctrl-C stops the search: the best values so far are scored and written, and the exit status is 130.
    `commonrail resume RUN` resumes a run, however it was stopped.

    --widen moves each bound that RUN has met by the width of its range, within the physical limits and the usual range
    of the parameter. --free frees a parameter within its usual range, with a prior if it is one of the injector:
    valve.mass, meter.bench.delay. The study file stays as it is; study.toml of the new run has the changes.

    \b
    Examples:
      commonrail calibrate cases/paper/study.toml --out runs/paper --seed 1
      commonrail calibrate my/study.toml --widen runs/my-1
    """
    from commonrail.calibration.study_file import edit_study, load_study
    from commonrail.cli.fit import print_outcome, run_study
    from commonrail.cli.study_kind import RunOptions, kind_of_study
    from commonrail.runs.folder import STUDY
    from commonrail.runs.study_edits import free_in, widen_study

    kind = kind_of_study(study)
    if kind and kind.calibrate:
        if widen is not None or free:
            raise InputError(f"{study} is no study of one injector: change its bounds and parameters in the file.")
        kind.calibrate(study, out, RunOptions(seed, threads=threads, workers=workers, cluster=cluster, json=json))
        return
    if widen is not None and free:
        raise InputError("--widen and --free: one change at a time shows what it does; omit one of them.")
    loaded, moved = (load_study(study), []) if widen is None else widen_study(study, widen)
    if free:
        loaded = edit_study(study, free_in(loaded.injector, loaded.space.names, free))
    for bound in moved:
        before, after = (to_text(value, bound.unit) for value in (bound.before, bound.after))
        say(f"{bound.name}: {bound.side} bound {before} -> {after}")
    if seed is not None:
        loaded = replace(loaded, seed=seed)
    with open_workers(workers, cluster) as crew:
        outcome = run_study(loaded, out or free_run_folder(stem_of(study)), threads, crew, strict=strict)
    if (moved or free) and not json:
        click.echo(f"{outcome.folder}/{STUDY} has the changes; {study} is as it was: change it there to keep them.")
    print_outcome(outcome, json, strict=strict, live=not no_live)


# commonrail resume: resume a stopped run, of a family or an FMU too, or extend a finished one by generations.


@table_verb
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
    no_live: NoLive = False,
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
    from commonrail.cli.fit import print_outcome, run_and_report
    from commonrail.cli.study_kind import RunOptions, kind_of_run
    from commonrail.runs.fit import resume as go_on
    from commonrail.runs.folder import RESULT, STUDY

    if kind := kind_of_run(run):
        options = RunOptions(
            generations=generations, as_begun=as_begun, threads=threads, workers=workers, cluster=cluster, json=json
        )
        kind.resume(run, options)
        return
    if not (run / STUDY).is_file():
        from commonrail.report.result_kind import kind_of  # slow to import

        result = kind_of(run)
        if result.file != RESULT:
            raise InputError(
                f"{run}: this folder was written by `commonrail {result.verb}`, which has nothing to resume here; "
                "give that command again."
            )
    with open_workers(workers, cluster) as crew:
        outcome = run_and_report(
            f"resuming {run}",
            run,
            lambda listener: go_on(
                run, generations=generations, as_begun=as_begun, threads=threads, workers=crew, listener=listener
            ),
        )
    print_outcome(outcome, json, live=not no_live)
