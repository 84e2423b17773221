"""commonrail cite: parts of a run with their sources, and the works to cite."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from commonrail.cli.console import print_result, print_rows
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import Json, check_file


@table_verb
def cite(
    run: Annotated[
        str,
        Argument(metavar="RUN", help="Folder of commonrail calibrate, an injector file or a name of the catalogue."),
    ],
    *,
    out: Annotated[Path | None, Option(metavar="FILE.bib", help="File for the works to be cited, as BibTeX.")] = None,
    json: Json = False,
) -> None:
    """List the parts of a run, and the works to cite.

    Parts are software, model, injector and fuel with the sources of their values, meters, data, priors and optimiser.
    Installed packages are cited as they state it themselves.

    \b
    Examples:
      commonrail cite cri2-16
      commonrail cite runs/first --out used.bib
    """
    from commonrail.plugins.cite.run import cite as list_sources
    from commonrail.plugins.cite.run import write_bibtex

    check_file(out, "--out")
    uses, works = list_sources(run)
    if out is not None:
        write_bibtex(out, works)

    def show() -> None:
        print_rows(("to be cited",), [(work.sentence(),) for work in works])
        print_rows(("used", "name", "source"), uses, f"Parts of {run}")

    cited = [{"key": work.key, "text": work.sentence(), "bibtex": work.bibtex()} for work in works]
    record = {"kind": "citation", "run": run, "used": [use._asdict() for use in uses], "references": cited}
    print_result(json, lambda: record, show, (out,))
