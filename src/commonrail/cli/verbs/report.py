"""commonrail report: make the report of a run folder again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from commonrail.base import registry
from commonrail.base.errors import InputError
from commonrail.cli.console import print_json, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json


@verb
def report(
    run: Annotated[Path, Argument(metavar="RUN", help="Folder of commonrail calibrate, family or compare.")],
    *,
    pdf: Annotated[bool, Option("--pdf", help="Print report.pdf too, by a Chromium of this machine.")] = False,
    page: Annotated[
        bool, Option("--page", help="Make bench.html beside it, with sliders; the report links it.")
    ] = False,
    json: Json = False,
) -> None:
    """Make the report of a run folder again.

    RUN/report.html is self-contained: it opens without a network and prints on A4. --page makes RUN/bench.html beside
    it, as commonrail page does, for the run folder of commonrail calibrate.

    \b
    Example:
      commonrail report runs/paper-1
      commonrail report runs/paper-1 --pdf
      commonrail report runs/paper-1 --page
    """
    from commonrail.report.page import write_report
    from commonrail.report.pdf import browser, print_pdf
    from commonrail.report.result_kind import kind_of

    if pdf:
        browser()  # refuse before anything is written
    bench = _make_page(run) if page else None
    lacking = kind_of(run).extra(run)
    path = write_report(run)
    if lacking:
        say(lacking)
    printed = print_pdf(path) if pdf else None
    if json:
        made = {"report": path, "pdf": printed, "page": bench}
        print_json({"kind": "report"} | {key: str(place) for key, place in made.items() if place})
    else:
        click.echo("\n".join(str(made) for made in (path, printed, bench) if made))


def _make_page(run: Path) -> Path:
    """The bench page of a run, written into its folder."""
    from commonrail.base.output import write_text
    from commonrail.report.page import BENCH
    from commonrail.runs.folder import RESULT

    part = registry.find("pages", BENCH)
    if part is None:
        raise InputError(f"--page: no installed package makes {BENCH}; omit --page.")
    if not (run / RESULT).is_file():
        raise InputError(
            f"{run}: --page needs the folder of a calibration, and there is no {RESULT} in it; omit --page, or make a "
            "page of an injector with `commonrail page`."
        )
    path = run / BENCH
    write_text(path, part.load()(run))
    return path
