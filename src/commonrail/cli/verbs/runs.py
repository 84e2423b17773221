"""commonrail runs: the runs below a folder, with their state."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from commonrail.base.output import write_text, writing
from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import Json, check_file

if TYPE_CHECKING:
    from commonrail.runs.listing import Run

_DAY = 86400.0


@table_verb
def runs(
    folder: Annotated[Path, Argument(metavar="DIR", help="Folder with run folders in it. [default: runs]")] = Path(
        "runs"
    ),
    *,
    html: Annotated[
        Path | None,
        Option(metavar="FILE.html", help="Page to be written: runs in a table, their parameters, curves and studies."),
    ] = None,
    json: Json = False,
) -> None:
    """List runs with state, best objective and age.

    "stopped" means killed. `commonrail resume` resumes runs that are stopped, interrupted or failed.

    \b
    Example:
      commonrail runs runs
      commonrail runs runs --html runs.html
    """
    from commonrail.runs.listing import list_runs

    check_file(html, "--html")
    runs_below = list_runs(folder)
    if html is not None:
        from commonrail.report.runs_page import runs_html

        with writing(html, "--html"):
            write_text(html, runs_html(folder, runs_below, html))
    if json:
        print_json({"kind": "runs", "runs": [_record(run) for run in runs_below]})
    elif not runs_below:
        click.echo(f"{folder}: no runs in it.")
    else:
        heads = ("run", "state", "generation", "refined", "best J", "age", "title")
        print_rows(heads, [_row(run) for run in runs_below])
    if html is not None:
        say(f"wrote {html}")


def _row(run: Run) -> list[str]:
    if run.reason and not run.title:
        return [str(run.folder), run.state, "", "", "", "", run.reason]
    best = f"{run.best:.5g}" if math.isfinite(run.best) else "–"
    generation = f"{run.generation}/{run.generations}"
    return [str(run.folder), run.state, generation, str(run.refinements), best, _age(run.age), run.title]


def _age(seconds: float) -> str:
    if not seconds >= 0.0:
        return "–"
    for length, unit in ((_DAY, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def _record(run: Run) -> dict[str, Any]:
    values = asdict(run) | {"folder": str(run.folder)}
    return {name: None if isinstance(v, float) and not math.isfinite(v) else v for name, v in values.items()}
