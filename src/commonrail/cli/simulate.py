"""commonrail simulate: one injection, in figures, as a table of courses or drawn."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from commonrail.choices import Body, Engine, Precision
from commonrail.cli.console import print_json, print_pairs, say
from commonrail.cli.options import (
    Json,
    OutFile,
    PlotFile,
    read_energisings,
    with_overrides,
)
from commonrail.cli.output import check_file
from commonrail.errors import InputError
from commonrail.files.atomic import write_text, writing
from commonrail.units import parse

if TYPE_CHECKING:
    from commonrail.cli.course import Run

__all__ = ["simulate"]


def simulate(
    injector: Annotated[str, typer.Argument(help="File of an injector, or a name of the catalogue.")],
    *,
    rail_pressure: Annotated[str, typer.Option(help="With its unit, such as 160MPa.")],
    energising_time: Annotated[
        str | None, typer.Option(help="Of a single injection from t = 0, such as 700us.")
    ] = None,
    energising: Annotated[
        list[str] | None,
        typer.Option(metavar="START:DURATION", help="One of several injections; repeat it."),
    ] = None,
    cylinder_pressure: Annotated[str, typer.Option(help="Behind the nozzle.")] = "5MPa",
    return_pressure: Annotated[str, typer.Option(help="At the end of the return line.")] = "0.5MPa",
    horizon: Annotated[
        str | None, typer.Option(help="Time simulated; 2.5 ms after the last energising by default.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PATH=VALUE",
            help="Change a parameter: a value with its unit or an SI number; repeat it.",
        ),
    ] = None,
    variant: Annotated[Body | None, typer.Option(help="Body, if not the file's.")] = None,
    engine: Annotated[
        Engine, typer.Option(help="Fast with a fixed step (cuda: on an NVIDIA GPU), or slow with error control.")
    ] = Engine.LANES,
    time_step: Annotated[str, typer.Option(help="Of the fast engines.")] = "1us",
    precision: Annotated[
        Precision, typer.Option(help="Of the fast engines: f32 pays for populations, here it shows its rounding.")
    ] = Precision.F64,
    out: OutFile = None,
    plot: PlotFile = None,
    json: Json = False,
) -> None:
    """Simulate one injection, or several in a row.

    \b
    Examples:
      commonrail simulate virtual-lino-2016 --rail-pressure 160MPa --energising-time 700us
      commonrail simulate my.toml --rail-pressure 1200bar --energising 0us:200us \\
          --energising 900us:600us --set plunger_needle.k1=303N/um --out course.csv
    """
    from commonrail.cli import course
    from commonrail.engine.operating_point import OperatingPoint
    from commonrail.files.injector_file import load_injector

    if engine is Engine.REFERENCE and precision is not Precision.F64:
        raise InputError("--precision f32: the reference computes in f64 alone; leave this option or --engine away.")
    check_file(out, "--out")
    check_file(plot, "--plot")
    point = OperatingPoint(
        parse(rail_pressure, "Pa", "--rail-pressure"),
        read_energisings(energising_time, energising or []),
        parse(cylinder_pressure, "Pa", "--cylinder-pressure"),
        parse(return_pressure, "Pa", "--return-pressure"),
        horizon=None if horizon is None else parse(horizon, "s", "--horizon"),
    )
    step = parse(time_step, "s", "--time-step")
    chosen = course.with_body(with_overrides(load_injector(injector), set_ or []), variant)
    begin = time.perf_counter()
    solution = course.solve(chosen, point, course.Settings(engine, step, precision))
    run = course.Run(chosen, point, solution, step, time.perf_counter() - begin, precision)
    files = _write(run, out, plot)
    if json:
        print_json(course.record(run) | {"files": files})
    else:
        print_pairs(course.figures(run), course.heading(run))
    for path in files:
        say(f"wrote {path}")


def _write(run: Run, out: Path | None, plot: Path | None) -> list[str]:
    from commonrail.cli import course

    if out is not None:
        with writing(out, "--out"):
            course.write_csv(run, out)
    if plot is not None:
        from commonrail.report.simulation import simulation_figure

        with writing(plot, "--plot"):
            page = simulation_figure(run.solution, course.heading(run))
            write_text(plot, page)
    return [str(path) for path in (out, plot) if path is not None]
