"""commonrail sensitivity: effect of parameters on J, quantities and features of an injection."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from commonrail.base.errors import InputError
from commonrail.base.units import parse
from commonrail.cli.console import Bar, Stage, print_json, print_synthetic, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import (
    CylinderPressure,
    Json,
    ReturnPressure,
    Settings,
    Threads,
    read_axis,
    read_pair,
    read_pressures,
    refuse_return_pressure,
    with_overrides,
)
from commonrail.plugins.sensitivity.settings import SensitivitySettings

if TYPE_CHECKING:
    from commonrail.calibration.parameter import Parameter
    from commonrail.calibration.study import Study
    from commonrail.engine.operating_point import OperatingPoint
    from commonrail.physics.injector import Injector
    from commonrail.plugins.sensitivity.file import Sensitivity


@table_verb
def sensitivity(
    source: Annotated[
        str,
        Argument(
            help="Injector file or catalogue name (@VARIANT selects another variant), study file, or run folder of "
            "`calibrate`."
        ),
    ],
    *,
    parameter: Annotated[
        tuple[str, ...],
        Option(
            metavar="NAME[=LOW:HIGH]",
            help="Parameter to be varied, with its range or within --within; repeatable. [default: those of the study; "
            "all of an injector that are not zero]",
        ),
    ] = (),
    within: Annotated[str, Option(help="Half width of a range as a share of the value, e.g. 5%.")] = "5%",
    rail_pressure: Annotated[
        str | None, Option(help="Rail pressures of the operating points, e.g. 80,160MPa or 40:160:20MPa.")
    ] = None,
    energising_time: Annotated[
        str | None, Option(help="Energising times, e.g. 700us or 300,700us; each with each rail pressure.")
    ] = None,
    cylinder_pressure: CylinderPressure = None,
    return_pressure: ReturnPressure = None,
    set_: Settings = (),
    feature: Annotated[
        tuple[str, ...],
        Option(
            help="Feature at the operating points, of those that `commonrail catalogue features` lists; repeatable. "
            "[default: quantity, both delays, duration, steady_rate]"
        ),
    ] = (),
    settings: SensitivitySettings,
    out: Annotated[
        Path | None, Option(metavar="DIR", help="New folder for report.html, sensitivity.json, sensitivity.csv.")
    ] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Rank parameters by their effect.

    A study or a run adds its objective J; operating points add features at each pair of rail pressure and energising
    time. Without --out nothing is written.

    \b
    Examples:
      commonrail sensitivity virtual-lino-2016 --rail-pressure 160MPa --energising-time 700us --design morris
      commonrail sensitivity my.toml --parameter nozzle.hole_diameter=0.128mm:0.132mm --parameter valve.lift \\
          --within 3% --rail-pressure 80,160MPa --energising-time 700us --out runs/sensitivity
      commonrail sensitivity cases/paper/study.toml --samples 256
    """
    from commonrail.plugins.sensitivity.page import sensitivity_lines, sensitivity_notes, sensitivity_tables
    from commonrail.plugins.sensitivity.run import sensitivity as run
    from commonrail.plugins.sensitivity.study import DEFAULT_FEATURES
    from commonrail.report.analysis import run_into

    if (rail_pressure is None) is not (energising_time is None):
        raise InputError("Give both --rail-pressure and --energising-time for operating points, or neither.")
    of_points = {"feature": feature, "cylinder-pressure": cylinder_pressure, "return-pressure": return_pressure}
    if rail_pressure is None and (alone := next((name for name, stated in of_points.items() if stated), "")):
        cure = "give --rail-pressure and --energising-time, or omit it"
        raise InputError(f"--{alone} applies to operating points, and there are none; {cure}.")
    subject = _with_settings(_subject(source), set_)
    points = _points(rail_pressure, energising_time, (cylinder_pressure, return_pressure), subject)
    refuse_return_pressure(_injector(subject))
    parameters = _parameters(subject, parameter, parse(within, "1", "--within"))

    def work() -> Sensitivity:
        with Bar(f"{source}: {settings.design.value}, {settings.samples} samples") as bar:
            return run(
                subject,
                parameters,
                points,
                tuple(feature or DEFAULT_FEATURES),
                settings=settings,
                threads=threads,
                progress=lambda p: bar.show(Stage("simulating", p.done, p.total, f"{p.total} candidates")),
            )

    result = run_into(out, "sensitivity.csv", work)
    record = result.record()
    if json:
        print_json(record)
        return
    print_synthetic(record["synthetic"])
    print_text(sensitivity_lines(result), sensitivity_tables(result), sensitivity_notes(result))
    for output in result.outputs:
        if output.why_not:
            say(f"{output.output.name}: {output.why_not}")
    if out is not None:
        click.echo(f"report: {out / 'report.html'}")


def _points(
    rails: str | None, times: str | None, pressures: tuple[str | None, str | None], subject: Injector | Study
) -> tuple[OperatingPoint, ...]:
    from commonrail.calibration.study import Study
    from commonrail.engine.operating_point import OperatingPoint

    if rails is None or times is None:
        return ()
    rail = read_axis(rails, "Pa", "--rail-pressure").tolist()
    time = read_axis(times, "s", "--energising-time").tolist()
    behind = read_pressures(*pressures, subject if isinstance(subject, Study) else None)
    return tuple(OperatingPoint(p, t, *behind) for p, t in itertools.product(rail, time))


def _with_settings(subject: Injector | Study, settings: Sequence[str]) -> Injector | Study:
    """Injector, or study of one, with the values of --set; `InputError` for one that the study varies."""
    from commonrail.calibration.study import Study

    if not isinstance(subject, Study):
        return with_overrides(subject, settings)
    free = [name for text in settings if (name := text.partition("=")[0].strip()) in subject.space.names]
    if free:
        raise InputError(f"--set {free[0]}: the study frees it; state its range with --parameter.")
    return replace(subject, injector=with_overrides(subject.injector, settings))


def _subject(source: str) -> Injector | Study:
    """Injector, study, or study at the values of a run."""
    from commonrail.calibration.study_file import load_study
    from commonrail.cli.model_name import read_model_name
    from commonrail.readers.toml import read_toml

    path = Path(source)
    if path.is_dir():
        return _of_run(path)
    if path.is_file() and source.endswith(".toml"):
        document, _ = read_toml(path)
        if str(document.get("format", "")).startswith("commonrail-study/"):
            return load_study(path)
    return read_model_name(source).injector


def _injector(subject: Injector | Study) -> Injector:
    from commonrail.calibration.study import Study

    return subject.injector if isinstance(subject, Study) else subject


def _of_run(run: Path) -> Study:
    """Study of a run folder around its calibrated values."""
    from commonrail.calibration.space import Space
    from commonrail.readers.injector import load_injector
    from commonrail.runs.folder import read_fit

    study, best = read_fit(run)
    injector = load_injector(run / "calibrated.toml")
    parameters = [replace(p, reference=best[p.name]) for p in study.space.parameters]
    return replace(study, injector=injector, space=Space(parameters, study.space.constraints, study.space.products))


def _parameters(subject: Injector | Study, texts: Sequence[str], within: float) -> tuple[Parameter, ...] | None:
    """Parameters with their ranges; None for those in the study."""
    from commonrail.calibration.study import Study
    from commonrail.physics.injector import parameter_quantities
    from commonrail.plugins.sensitivity.study import parameters_within

    if isinstance(subject, Study) and not texts:
        return None
    injector = _injector(subject)
    quantities, ranges = parameter_quantities(), {}
    names = []
    for text in texts:
        name, equals, ends = (piece.strip() for piece in text.partition("="))
        if name in names:
            raise InputError(f"--parameter {name}: it is stated twice; keep one range.")
        names.append(name)
        if equals and name in quantities:
            form = "NAME=LOW:HIGH, such as valve.lift=50um:60um"
            ranges[name] = read_pair(ends, quantities[name].unit, f"--parameter {text}", form)
    return parameters_within(injector, names or None, within, ranges)
