"""commonrail simulate: one injection as figures, as a table of time series, as a plot."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.base.choices import Body, Engine, Precision
from commonrail.base.errors import InputError
from commonrail.base.output import write_text, writing
from commonrail.base.units import parse
from commonrail.cli.console import print_json, print_pairs, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import (
    Json,
    OutFile,
    PlotFile,
    check_distinct,
    check_file,
    read_energisings,
    refuse_return_pressure,
    with_overrides,
)

if TYPE_CHECKING:
    from commonrail.cli.injection import Run
    from commonrail.physics.meters import Meter
    from commonrail.runs.model_name import NamedModel


@verb
def simulate(
    injector: Annotated[
        str,
        Argument(
            help="Injector file, name of the catalogue or run folder; with @VARIANT another variant: cri2-16@ideal."
        ),
    ],
    *,
    rail_pressure: Annotated[str, Option(help="Rail pressure, e.g. 160MPa.")],
    energising_time: Annotated[
        str | None, Option(help="Energising time of a single injection from t = 0, e.g. 700us.")
    ] = None,
    energising: Annotated[
        tuple[str, ...],
        Option(
            metavar="START:DURATION",
            help="Start and energising time of one of several injections, e.g. 900us:600us; repeatable.",
        ),
    ] = (),
    cylinder_pressure: Annotated[str, Option(help="Cylinder pressure, e.g. 5MPa.")] = "5MPa",
    return_pressure: Annotated[str, Option(help="Pressure at the end of the return line, e.g. 0.5MPa.")] = "0.5MPa",
    horizon: Annotated[
        str | None, Option(help="End of the simulation, e.g. 4ms. [default: 2.5ms after the last energising]")
    ] = None,
    set_: Annotated[
        tuple[str, ...],
        Option(
            "--set",
            metavar="PATH=VALUE",
            help="Value of a parameter, with its unit or as an SI number; repeatable.",
        ),
    ] = (),
    variant: Annotated[
        Body | None, Option(help="Body of plunger and needle. [default: as in the injector file]")
    ] = None,
    engine: Annotated[
        Engine,
        Option(
            help="Engine: lanes and cuda (NVIDIA GPU) are fast with a fixed step, reference is slow with error control."
        ),
    ] = Engine.LANES,
    time_step: Annotated[str | None, Option(help="Time step of lanes and cuda, e.g. 1us. [default: 1us]")] = None,
    precision: Annotated[
        Precision,
        Option(
            help="Precision of lanes and cuda. f32 is for large populations; for one injection it only adds "
            "rounding error."
        ),
    ] = Precision.F64,
    meter: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Meter through which the rate is shown beside the true one: a table [meters.NAME] of --study.",
        ),
    ] = None,
    study: Annotated[
        Path | None,
        Option(help="Study, or calibrated.toml of a run, that describes the meter. [default: the injector file]"),
    ] = None,
    out: OutFile = None,
    plot: PlotFile = None,
    json: Json = False,
) -> None:
    """Simulate one injection, or several in a row.

    \b
    Examples:
      commonrail simulate virtual-lino-2016 --rail-pressure 160MPa --energising-time 700us
      commonrail simulate my.toml --rail-pressure 1200bar --energising 0us:200us \\
          --energising 900us:600us --set plunger_needle.k1=303N/um --out injection.csv
      commonrail simulate runs/first/calibrated.toml --rail-pressure 160MPa --energising-time 700us \\
          --meter bench --plot seen.html
    """
    from commonrail.cli import injection
    from commonrail.engine.operating_point import OperatingPoint
    from commonrail.runs.model_name import read_model_name

    if engine is Engine.REFERENCE and precision is not Precision.F64:
        raise InputError("--precision f32: the reference engine computes in f64 only; omit --precision or --engine.")
    if engine is Engine.REFERENCE and time_step is not None:
        raise InputError("--time-step: the reference engine chooses its steps by its errors; omit it or --engine.")
    check_file(out, "--out")
    check_file(plot, "--plot")
    check_distinct(out, plot)
    named = read_model_name(injector)
    seen = _meter(named, meter, study)
    point = OperatingPoint(
        parse(rail_pressure, "Pa", "--rail-pressure"),
        read_energisings(energising_time, energising),
        parse(cylinder_pressure, "Pa", "--cylinder-pressure"),
        parse(return_pressure, "Pa", "--return-pressure"),
        horizon=None if horizon is None else parse(horizon, "s", "--horizon"),
    )
    step = parse(time_step or "1us", "s", "--time-step")
    chosen = with_overrides(injection.with_body(named.injector, variant), set_)
    refuse_return_pressure(chosen)
    begin = time.perf_counter()
    solution = injection.solve(chosen, point, injection.Settings(engine, step, precision))
    run = injection.Run(chosen, point, solution, step, time.perf_counter() - begin, precision)
    if seen is not None:
        from commonrail.engine.solution import metered

        run = run._replace(shown=metered(solution, seen, chosen, point))
    files = _write(run, out, plot)
    if json:
        print_json(injection.record(run) | {"files": files})
    else:
        print_pairs(injection.figures(run), injection.heading(run))
    for path in files:
        say(f"wrote {path}")


def _meter(model: NamedModel, name: str | None, study: Path | None) -> Meter | None:
    """Meter that the options name, or None."""
    if name is None:
        if study is not None:
            raise InputError(f"--study {study}: name one of its meters with --meter, or omit --study.")
        return None
    if study is None:
        return _meter_of(model, name)
    from commonrail.calibration.study_file.meter import load_meter

    return load_meter(study, name)


def _meter_of(model: NamedModel, name: str) -> Meter:
    """Meter that a calibration has left beside a model."""
    for meter in model.meters:
        if meter.name == name:
            return meter
    there = f"has the meters {', '.join(m.name for m in model.meters)}" if model.meters else "has no meters"
    raise InputError(f"--meter {name}: {model.text} {there}; name a study or a calibrated.toml with --study.")


def _write(run: Run, out: Path | None, plot: Path | None) -> list[str]:
    from commonrail.cli import injection

    if out is not None:
        with writing(out, "--out"):
            injection.write_csv(run, out)
    if plot is not None:
        from commonrail.report.simulation import simulation_figure

        with writing(plot, "--plot"):
            shown = {} if run.shown is None else {run.shown.meter.name: run.shown.rate}
            page = simulation_figure(run.solution, injection.heading(run), shown)
            write_text(plot, page)
    return [str(path) for path in (out, plot) if path is not None]
