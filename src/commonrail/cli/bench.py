"""commonrail bench: time beside accuracy of commonrail's methods on this machine."""

from __future__ import annotations

import json as json_text
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Option, verb
from commonrail.cli.guard import INTERRUPTED
from commonrail.cli.options import Json
from commonrail.cli.output import check_file
from commonrail.cli.progress import Bar, Stage

if TYPE_CHECKING:
    from collections.abc import Callable

    from commonrail.bench.record import Make

__all__ = ["MEASURING", "bench", "show", "told"]

MEASURING = "measuring; leave the machine alone meanwhile"


@verb
def bench(
    *,
    quick: Annotated[bool, Option("--quick", help="Use shorter timings and fewer rows.")] = False,
    out: Annotated[Path | None, Option(metavar="FILE.json", help="JSON file to be written with the record.")] = None,
    json: Json = False,
) -> None:
    """Measure time and accuracy of simulations and searches.

    All methods solve the same equations; each is listed with its time and its error against a much finer
    reference. There are no limits to pass. Ctrl-C stops with what was measured so far, status 130. Other
    solvers and optimisers are measured from a clone of the repository: make bench.

    \b
    Example:
      commonrail bench --quick --out bench.json
    """
    from commonrail.bench.run import run_bench, stages

    check_file(out, "--out")
    with Bar(MEASURING) as bar:
        record = run_bench(stages(quick), told(bar), options={"quick": quick})
    show(record, out, json)


def told(bar: Bar) -> Callable[[str, int, int], None]:
    """Progress of a benchmark on a bar."""
    return lambda title, done, total: bar.show(Stage(title, done, total, ""))


def show(record: dict[str, Any], out: Path | None, json: bool, tables: Mapping[str, Make] | None = None) -> None:
    """Write a record, print it as JSON or as tables, and end with status 130 if it was interrupted.

    Parameters
    ----------
    record : dict
    out : Path or None
        File for the record.
    json : bool
    tables : mapping, optional
        Of the record's parts; those of commonrail's own methods by default.
    """
    from commonrail.bench.record import grids, sentences
    from commonrail.files.atomic import write_text

    if out is not None:
        write_text(out, json_text.dumps(record, indent=1, allow_nan=False) + "\n")
    if json:
        print_json(record)
    else:
        for grid in grids(record, tables):
            print_rows(grid.heads, grid.rows, grid.title, texts=grid.texts)
        for sentence in sentences(record):
            click.echo(sentence)
    if out is not None:
        say(f"record: {out}")
    if record["status"] == "interrupted":
        say("commonrail: interrupted; what was measured so far is above.")
        raise SystemExit(INTERRUPTED)
