"""commonrail report: make the report of a run folder again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from commonrail.cli.console import print_json, say
from commonrail.cli.options import Json
from commonrail.errors import InputError

__all__ = ["report"]


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of commonrail calibrate, family or compare.")],
    *,
    json: Json = False,
) -> None:
    """Make the report of a run folder again.

    RUN/report.html is self-contained: it opens without a network.

    \b
    Example:
      commonrail report runs/paper-1
    """
    from commonrail.fleet.results import RECORD
    from commonrail.report.build import draw_plates, write_report

    if (run / RECORD).is_file():
        raise InputError(
            f"{run}: this is the folder of a fleet; `commonrail fleet FLEET --out {run}` makes its report."
        )
    lacking = draw_plates(run)
    path = write_report(run)
    if lacking:
        say(lacking)
    if json:
        print_json({"kind": "report", "report": str(path)})
    else:
        typer.echo(str(path))
