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
    pdf: Annotated[bool, typer.Option("--pdf", help="Print report.pdf too, by a Chromium of this machine.")] = False,
    json: Json = False,
) -> None:
    """Make the report of a run folder again.

    RUN/report.html is self-contained: it opens without a network and prints on A4.

    \b
    Example:
      commonrail report runs/paper-1
      commonrail report runs/paper-1 --pdf
    """
    from commonrail.fleet.results import RECORD
    from commonrail.report.build import draw_plates, write_report
    from commonrail.report.pdf import browser, print_pdf

    if (run / RECORD).is_file():
        raise InputError(
            f"{run}: this is the folder of a fleet; `commonrail fleet FLEET --out {run}` makes its report."
        )
    if pdf:
        browser()  # refuse before anything is written
    lacking = draw_plates(run)
    path = write_report(run)
    if lacking:
        say(lacking)
    printed = print_pdf(path) if pdf else None
    if json:
        print_json({"kind": "report", "report": str(path)} | ({"pdf": str(printed)} if printed else {}))
    else:
        typer.echo("\n".join(str(made) for made in (path, printed) if made))
