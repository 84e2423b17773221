"""commonrail runs: the runs below a folder, with their state."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from commonrail.cli.console import print_json, print_rows
from commonrail.cli.grammar import Argument, verb
from commonrail.cli.options import Json

if TYPE_CHECKING:
    from commonrail.runs.listing import Run

_DAY = 86400.0


@verb
def runs(
    folder: Annotated[Path, Argument(metavar="DIR", help="Folder with run folders in it. [default: runs]")] = Path(
        "runs"
    ),
    *,
    json: Json = False,
) -> None:
    """List runs with state, best objective and age.

    "stopped" means killed. `commonrail resume` resumes runs that are stopped, interrupted or failed.

    \b
    Example:
      commonrail runs runs
    """
    from commonrail.runs.listing import list_runs

    found = list_runs(folder)
    if json:
        print_json({"kind": "runs", "runs": [_record(run) for run in found]})
    elif not found:
        click.echo(f"{folder}: no runs in it.")
    else:
        heads = ("run", "state", "generation", "refined", "best J", "age", "title")
        print_rows(heads, [_row(run) for run in found])


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
