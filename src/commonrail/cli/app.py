"""The command `commonrail` as typer reads it."""

from __future__ import annotations

from typing import Annotated

import typer

from commonrail.cli.guard import show_traceback
from commonrail.cli.verbs import PLAIN, Verbs

__all__ = ["app"]

app = typer.Typer(name="commonrail", cls=Verbs, no_args_is_help=True, **PLAIN)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"commonrail {version('commonrail')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version."),
    ] = False,
    traceback: Annotated[bool, typer.Option("--traceback", help="Show the traceback of an error.")] = False,
) -> None:
    """Simulate a common-rail electro-injector and calibrate it to measured injection curves.

    \b
    Start here:
      commonrail new my-injector
      commonrail calibrate my-injector/study.toml
      commonrail simulate virtual-lino-2016 --rail-pressure 160MPa --energising-time 700us
    """
    show_traceback.set(traceback)
