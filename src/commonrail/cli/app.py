"""The command `commonrail` and its verbs."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from commonrail.cli.console import compiling, say, say_of_ending
from commonrail.cli.guard import show_traceback
from commonrail.cli.verbs import PLAIN, Verbs
from commonrail.notice import tell_notes, tell_of_compiling
from commonrail.workers.interrupt import end_at_second

__all__ = ["app", "main"]

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


def main() -> None:
    """Run the command."""
    _open_standard_streams()
    tell_of_compiling(compiling)
    tell_notes(say)
    end_at_second(say_of_ending)
    app(prog_name="commonrail")


def _open_standard_streams() -> None:
    """Open a sink for a closed stdout or stderr (`>&-`): the next file opened would take its number."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            sink = os.open(os.devnull, os.O_WRONLY)
            if sink != number:
                os.dup2(sink, number)
                os.close(sink)
            setattr(sys, name, os.fdopen(number, "w", encoding="utf-8"))
