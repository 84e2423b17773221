"""commonrail report: make the report of a run folder again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from commonrail.base import registry
from commonrail.base.errors import InputError, PluginError
from commonrail.cli.console import print_json, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json, NoLive


@verb
def report(
    run: Annotated[Path, Argument(metavar="RUN", help="Folder of commonrail calibrate, family or compare.")],
    *,
    pdf: Annotated[bool, Option("--pdf", help="Print report.pdf too, by a Chromium of this machine.")] = False,
    page: Annotated[
        bool, Option("--page", help="Make further pages beside it: bench.html with sliders, and those of plug-ins.")
    ] = False,
    no_live: NoLive = False,
    json: Json = False,
) -> None:
    """Make the report of a run folder again.

    RUN/report.html is self-contained: it opens without a network and prints on A4. The main chart of a calibration
    simulates again while its parameters are dragged, where zig can compile that (pip install "commonrail[export]").
    For the run folder of a calibration, --page also makes RUN/bench.html, as commonrail page does, and the pages of
    installed packages.

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
    pages = _make_pages(run) if page else []
    lacking = kind_of(run).extra(run)
    path = write_report(run, live=not no_live)
    if lacking:
        say(lacking)
    printed = print_pdf(path) if pdf else None
    if json:
        files = {"report": str(path)} | ({"pdf": str(printed)} if printed else {})
        print_json({"kind": "report", **files} | ({"pages": list(map(str, pages))} if page else {}))
    else:
        click.echo("\n".join(str(file) for file in (path, printed, *pages) if file))


def _make_pages(run: Path) -> list[Path]:
    """Pages of plug-ins, written into a run folder; a page that fails is reported on stderr."""
    from commonrail.base.output import write_text
    from commonrail.runs.folder import RESULT

    if not (run / RESULT).is_file():
        raise InputError(
            f"{run}: --page needs the folder of a calibration, and there is no {RESULT} in it; omit --page, or make a "
            "page of an injector with `commonrail page`."
        )
    written = []
    for name, entry in registry.entries("pages").items():
        try:
            write_text(run / name, entry.call(run))
        except PluginError as error:
            say(f"commonrail: {error}")
        else:
            written.append(run / name)
    return written
