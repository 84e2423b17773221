"""commonrail plan: an injector, and a part on the bench, judged by a test plan."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.base.output import write_text
from commonrail.base.units import parse, to_text
from commonrail.cli.console import SIMULATING, print_result, print_text, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import (
    DecimalSign,
    Json,
    Settings,
    Threads,
    check_report,
    read_form,
    read_pressures,
    refuse_return_pressure,
    with_overrides,
)

if TYPE_CHECKING:
    from commonrail.physics.injector import Injector
    from commonrail.plugins.plans.study import TestPlan

BenchCylinderPressure = Annotated[
    str | None, Option(help="Pressure behind the nozzle. [default: that of the run's first data, else 0.5MPa]")
]
BenchReturnPressure = Annotated[
    str | None,
    Option(help="Pressure at the end of the return line. [default: that of the run's first data, else 0.1MPa]"),
]
"""Options whose defaults are `BENCH_PRESSURES`, of all verbs that judge by a test plan."""


def read_bench(
    model: str, file: Path, decimal: str | None, settings: Sequence[str], pressures: tuple[str | None, str | None]
) -> tuple[Injector, TestPlan, dict[str, float]]:
    """Injector and test plan of a command line, and the pressures behind nozzle and return [Pa] by their options."""
    from commonrail.cli.model_name import read_model_name
    from commonrail.plugins.plans.study import BENCH_PRESSURES, load_plan

    tests = load_plan(file, read_form(None, decimal, None, [file]))
    named = read_model_name(model)
    injector = with_overrides(named.injector, settings)
    refuse_return_pressure(injector)
    cylinder, back = read_pressures(*pressures, named.folder, BENCH_PRESSURES)
    return injector, tests, {"cylinder_pressure": cylinder, "return_pressure": back}


def command_again(
    words: Sequence[str], settings: Sequence[str], pressures: Mapping[str, float], stated: Mapping[str, object]
) -> str:
    """Command line of a verb with its pressures, and with the options that were stated by their names."""
    options = {**stated, **{name: to_text(value, "Pa") for name, value in pressures.items()}}
    changes = [part for text in settings for part in ("--set", text)]
    given = [f"--{name.replace('_', '-')}={value}" for name, value in options.items() if value is not None]
    return shlex.join(["commonrail", *words, *changes, *given])


@verb
def plan(
    model: Annotated[str, Argument(metavar="MODEL", help="Injector file, a name of the catalogue, or a run folder.")],
    file: Annotated[
        Path,
        Argument(
            metavar="PLAN.csv",
            help="Tests with rail pressure, energising time, nominal quantity and band; with a column bench, what a "
            "part delivered.",
        ),
    ],
    *,
    stroke_rate: Annotated[
        str | None,
        Option(help="Stroke rate where the plan states none, e.g. 1000/min; a return needs it. [default: none]"),
    ] = None,
    cylinder_pressure: BenchCylinderPressure = None,
    return_pressure: BenchReturnPressure = None,
    decimal: DecimalSign = None,
    time_step: Annotated[str, Option(help="Time step, e.g. 1us.")] = "1us",
    set_: Settings = (),
    report: Annotated[Path | None, Option(metavar="FILE.html", help="Report with the tolerance fields.")] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Judge a model, and a part on the bench, by a test plan.

    Every test is simulated; a quantity is inside or outside its band, and its distance from the nominal one is
    stated in half bands. The column bench of the plan, if it has one, is judged alike: the part passes or fails.
    Pressures that are not stated are those of an injector bench, 0.5 MPa behind the nozzle and 0.1 MPa in the return.

    \b
    Examples:
      commonrail plan cri2-16 examples/test-plan/plan.csv --cylinder-pressure 0.5MPa --return-pressure 0.1MPa
      commonrail plan runs/first plan.csv --stroke-rate 1000/min --report plan.html
    """
    from commonrail.plugins.plans.page import plan_html, plan_lines, plan_tables
    from commonrail.plugins.plans.run import run_plan

    check_report(report)
    injector, tests, pressures = read_bench(model, file, decimal, set_, (cylinder_pressure, return_pressure))
    rate = None if stroke_rate is None else parse(stroke_rate, "1/s", "--stroke-rate")
    step = parse(time_step, "s", "--time-step")
    say(SIMULATING)
    record = run_plan(injector, tests, stroke_rate=rate, **pressures, time_step=step, threads=threads).record()
    if report is not None:
        stated = {"stroke_rate": stroke_rate, "decimal": decimal, "report": report}
        write_text(report, plan_html(record, command_again(["plan", model, str(file)], set_, pressures, stated)))
    print_result(json, lambda: record, lambda: print_text(plan_lines(record), plan_tables(record)), [report])
