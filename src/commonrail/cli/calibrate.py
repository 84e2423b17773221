"""commonrail calibrate: fit the free parameters of a study to its data."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from commonrail.cli.console import print_json, print_table, say
from commonrail.cli.guard import INTERRUPTED
from commonrail.cli.options import Json, StudyFile, Threads
from commonrail.cli.output import free_run_folder

if TYPE_CHECKING:
    from commonrail.calibration.workers import Workers

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
    workers: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Processes that simulate; for large populations.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help='Dask scheduler, such as tcp://host:8786, or "local".')
    ] = None,
    json: Json = False,
) -> None:
    """Fit a study and write a run folder.

    Ctrl-C ends the search in order: the best values so far are judged and written, and the exit
    status is 130.

    \b
    Example:
      commonrail calibrate cases/paper/study.toml --out runs/paper --seed 1
    """
    from commonrail.cli.study_run import run_study
    from commonrail.files.study_file import load_study
    from commonrail.report.tables import tables_of

    loaded = load_study(study)
    if seed is not None:
        loaded = replace(loaded, seed=seed)
    with _workers(workers, cluster) as crew:
        outcome = run_study(loaded, out or free_run_folder(_stem(study)), threads, crew)
    if json:
        places = {"run": str(outcome.folder), "report": str(outcome.report)}
        print_json({"kind": "calibration", **places, "result": outcome.record})
    else:
        for table in tables_of(outcome.record["data"]):
            print_table(table)
        typer.echo(f"report: {outcome.report}")
    if outcome.interrupted:
        say(f"commonrail: interrupted; the best values so far are in {outcome.folder}.")
        raise typer.Exit(INTERRUPTED)


def _workers(count: int | None, address: str | None) -> AbstractContextManager[Workers | None]:
    """Workers as asked for; none by default."""
    from commonrail.calibration.workers import Workers

    if address is not None:
        return Workers.cluster(address, count)
    return nullcontext() if count is None else Workers.processes(count)


def _stem(study: Path) -> str:
    """Name for runs: a file that is called study says less than its folder."""
    return study.absolute().parent.name if study.stem == "study" else study.stem
