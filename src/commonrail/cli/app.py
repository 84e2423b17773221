"""The command `commonrail` and its verbs."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from commonrail.cli.adapt import adapt
from commonrail.cli.bench import bench
from commonrail.cli.calibrate import calibrate
from commonrail.cli.catalogue import catalogue
from commonrail.cli.certainty import certainty
from commonrail.cli.compare import compare
from commonrail.cli.console import compiling, say, say_of_ending
from commonrail.cli.doctor import doctor
from commonrail.cli.export import export
from commonrail.cli.family import family
from commonrail.cli.fleet import fleet
from commonrail.cli.guard import guarded, show_traceback
from commonrail.cli.inspect import inspect
from commonrail.cli.map import map_
from commonrail.cli.new import new
from commonrail.cli.next import next_
from commonrail.cli.optimisers import optimisers
from commonrail.cli.page import page
from commonrail.cli.predict import predict
from commonrail.cli.report import report
from commonrail.cli.reproduce import reproduce
from commonrail.cli.resume import resume
from commonrail.cli.runs import runs
from commonrail.cli.sensitivity import sensitivity
from commonrail.cli.simulate import simulate
from commonrail.cli.sweep import sweep
from commonrail.cli.tolerance import tolerance
from commonrail.cli.validate import validate
from commonrail.cli.verify import verify
from commonrail.cli.virtual_bench import virtual_bench
from commonrail.notice import tell_notes, tell_of_compiling
from commonrail.workers.interrupt import end_at_second

__all__ = ["app", "main"]

# Plain help and errors: they read the same in a terminal, a log and a page of documentation.
app = typer.Typer(
    name="commonrail",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
_VERBS = (
    simulate,
    calibrate,
    resume,
    runs,
    validate,
    certainty,
    next_,
    predict,
    compare,
    fleet,
    family,
    adapt,
    sensitivity,
    tolerance,
    map_,
    sweep,
    inspect,
    report,
    export,
    page,
    verify,
    catalogue,
    new,
    virtual_bench,
    reproduce,
    bench,
    optimisers,
    doctor,
)
for _verb in _VERBS:
    app.command(_verb.__name__.strip("_").replace("_", "-"))(guarded(_verb))


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
