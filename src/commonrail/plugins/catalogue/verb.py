"""commonrail catalogue: list of fuels, injectors, meters, features and parameters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from commonrail.base.errors import InputError
from commonrail.base.registry import part_digits
from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import Json
from commonrail.plugins.catalogue.run import Section

NO_SUCH_PART = "; the part numbers of the catalogue are Bosch's, as 0445110191 and 0445120077"


@table_verb
def catalogue(
    section: Annotated[
        Section | None,
        Argument(help="Section to be listed: fuels, injectors, meters, features or parameters. [default: all]"),
    ] = None,
    *,
    search: Annotated[
        str,
        Option(help="Text that the listed entries contain, or a part number, whole or in part. [default: all entries]"),
    ] = "",
    report: Annotated[
        Path | None, Option(metavar="FILE.html", help="Report with curves, figures and sources of the injectors.")
    ] = None,
    write: Annotated[
        str, Option(metavar="NAME", help="Write the file of an injector, NAME.toml, into this folder to start from.")
    ] = "",
    json: Json = False,
) -> None:
    """List fuels, injectors, meters, features and parameters.

    A part number, as 0 445 110 191, leads to the type of injector that names it, or to the nearest numbers.
    Fuels, injectors and features of an injection are those that ship with commonrail and those of installed packages,
    meters those of installed packages; parameters are what --set, a study or an injector's file can name.

    \b
    Examples:
      commonrail catalogue injectors
      commonrail catalogue parameters --search spring
      commonrail catalogue --search 0445110191
      commonrail catalogue injectors --report injectors.html
      commonrail catalogue injectors --write cri2-16
    """
    if write:
        if section not in (None, Section.INJECTORS) or search or report is not None:
            raise InputError("--write stands alone, as in commonrail catalogue injectors --write cri2-16.")
        _write_injector(write, json)
        return
    from commonrail.plugins.catalogue.run import catalogue as list_entries

    entries_by_section, parts = list_entries(Section.INJECTORS if report is not None else section, search)
    if report is not None:
        _write_gallery(report, [entry["name"] for entry in entries_by_section["injectors"]], search, json)
        return
    if json:
        print_json({"kind": "catalogue", **entries_by_section, "parts": [match._asdict() for match in parts]})
        return
    for name, entries in entries_by_section.items():
        if entries:
            rows = [[_text(value) for value in entry.values()] for entry in entries]
            print_rows(tuple(entries[0]), rows, name)
    for match in parts:
        say(f"commonrail: {match.reason}")
    if not any(entries_by_section.values()):
        say(f'commonrail: nothing contains "{search}"{NO_SUCH_PART * bool(part_digits(search))}.')


def _write_injector(name: str, json: bool) -> None:
    """Write the file of an injector, comments and sources included, into the current folder."""
    from commonrail.base.output import write_text
    from commonrail.cli.options import check_file
    from commonrail.readers.injector import CATALOGUE

    text, path = CATALOGUE.text(name), Path(f"{name}.toml")
    if path.exists():
        raise InputError(f"{path}: there already is such a file; rename it, or change to another folder.")
    check_file(path, "--write")
    write_text(path, text)
    if json:
        print_json({"kind": "catalogue", "files": [str(path)]})
    else:
        say(f"wrote {path}")


def _write_gallery(path: Path, names: Sequence[str], search: str, json: bool) -> None:
    """Write the page of injectors that a search has matched."""
    from importlib.metadata import version

    from commonrail.base.output import write_text, writing
    from commonrail.cli.options import check_report
    from commonrail.plugins.catalogue.page import exhibit, gallery_html
    from commonrail.readers.injector import load_injector

    if not names:
        raise InputError(f'No injector of the catalogue contains "{search}"; omit --search to show all.')
    check_report(path)
    text = gallery_html([exhibit(name, load_injector(name)) for name in names], version("commonrail"))
    with writing(path, "--report"):
        write_text(path, text)
    if json:
        print_json({"kind": "gallery", "page": str(path), "injectors": names})
    else:
        say(f"wrote {path} ({len(names)} injectors)")


def _text(value: object) -> str:
    if value is None:
        return "none: give it"
    if isinstance(value, list):
        return " to ".join(map(_text, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
