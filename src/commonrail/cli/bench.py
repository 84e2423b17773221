"""commonrail bench: time and accuracy of commonrail's and other solvers and optimisers."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.guard import INTERRUPTED
from commonrail.cli.options import Json
from commonrail.cli.output import check_file
from commonrail.cli.progress import Bar, Stage

if TYPE_CHECKING:
    from commonrail.bench.run import Options

__all__ = ["bench"]


def bench(
    *,
    peers: Annotated[
        bool, typer.Option("--peers", help="Also measure other solvers and optimisers, if installed.")
    ] = False,
    curves: Annotated[
        bool,
        typer.Option("--curves", help="Also measure time and memory against candidates, points, horizon, threads."),
    ] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Use shorter timings and fewer rows.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="JSON file to be written with the record.")
    ] = None,
    json: Json = False,
) -> None:
    """Measure time and accuracy of simulations and searches.

    All methods solve the same equations; each is listed with its time and its error against a much finer
    reference. There are no limits to pass. Ctrl-C stops with what was measured so far, status 130.

    \b
    Example:
      commonrail bench --quick
      commonrail bench --peers --curves --out bench.json
    """
    from commonrail.bench.run import Options

    check_file(out, "--out")
    record = _measure(Options(peers, curves, quick))
    if out is not None:
        from commonrail.files.atomic import write_text

        write_text(out, json_text.dumps(record, indent=1, allow_nan=False) + "\n")
    if json:
        print_json(record)
    else:
        _print(record)
    if out is not None:
        say(f"record: {out}")
    if record["status"] == "interrupted":
        say("commonrail: interrupted; what was measured so far is above.")
        raise typer.Exit(INTERRUPTED)


def _measure(options: Options) -> dict[str, Any]:
    from commonrail.bench.run import run_bench

    with Bar("measuring; leave the machine alone meanwhile") as bar:
        return run_bench(options, lambda title, done, total: bar.show(Stage(title, done, total, "")))


def _print(record: dict[str, Any]) -> None:
    from commonrail.bench.record import grids, sentences

    for grid in grids(record):
        print_rows(grid.heads, grid.rows, grid.title, texts=grid.texts)
    for sentence in sentences(record):
        typer.echo(sentence)
