"""commonrail new: a commented injector, study and data file to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from commonrail.cli.console import print_json
from commonrail.cli.options import Json
from commonrail.cli.output import check_folder

__all__ = ["new"]


def new(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new or empty folder.")],
    *,
    json: Json = False,
) -> None:
    """Write a small study to start from.

    Its example curve is synthetic and marked so.

    \b
    Example:
      commonrail new my-injector
    """
    from commonrail.files.scaffold import write_new

    check_folder(folder)
    written = write_new(folder)
    if json:
        print_json({"kind": "new", "files": [str(path) for path in written]})
        return
    for path in written:
        typer.echo(str(path))
    typer.echo(f"next: commonrail calibrate {folder / 'study.toml'}")
