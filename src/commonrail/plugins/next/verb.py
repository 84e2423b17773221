"""commonrail next: operating points and kinds of measurement that add most to a calibration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from commonrail.base.errors import InputError, nearest
from commonrail.base.output import write_text
from commonrail.base.units import parse
from commonrail.cli.console import print_result, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import Json, Threads, check_distinct, check_file, check_report, read_axis, refuse_unused
from commonrail.plugins.next.settings import Criterion, DesignSettings


@table_verb
def next_(
    run: Annotated[Path, Argument(metavar="RUN", help="Folder of commonrail calibrate.")],
    *,
    settings: DesignSettings,
    parameter: Annotated[
        tuple[str, ...],
        Option(metavar="NAME", help="Parameter for criteria d and a; repeatable. [default: all]"),
    ] = (),
    rail_pressure: Annotated[
        str | None, Option(help="Rail pressures, e.g. 40:160:20MPa. [default: 8 within the data]")
    ] = None,
    energising_time: Annotated[
        str | None, Option(help="Energising times, e.g. 200:1500:50us. [default: 12 within the data]")
    ] = None,
    dwell: Annotated[
        str | None, Option(help="Dwells before a second energising, e.g. 200:2000:200us. [default: none]")
    ] = None,
    first_energising_time: Annotated[str | None, Option(help="Energising time before the dwell, e.g. 350us.")] = None,
    kind: Annotated[
        tuple[str, ...],
        Option(
            metavar="KIND[=COST]",
            help='Kind of measurement in the run, with its cost: quantities, rate, "return quantities"; '
            "repeatable. [default: the first of these that was fitted, cost 1]",
        ),
    ] = (),
    out: Annotated[Path | None, Option(metavar="FILE.csv", help="File for the measuring plan.")] = None,
    report: Annotated[Path | None, Option(metavar="FILE.html", help="Report with the plan among the data.")] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Advise which points to measure next.

    Noise and correlation are taken from the run's data. Candidates are simulated at draws of the parameters, so the
    plan accounts for their remaining uncertainty.

    \b
    Examples:
      commonrail next runs/first --points 3 --out plan.csv
      commonrail next runs/first --criterion d --parameter nozzle.discharge_maximum --rail-pressure 40:160:20MPa
    """
    from commonrail.plugins.next.file import plan_record, write_plan
    from commonrail.plugins.next.page import plan_html, plan_lines, plan_notes, plan_tables
    from commonrail.plugins.next.run import list_candidates, next_measurements
    from commonrail.runs.folder import read_fit

    refuse_unused({"parameter": (settings.criterion is not Criterion.V, "--criterion d or a")})
    refuse_unused({"first_energising_time": (dwell is not None, "--dwell")})
    check_file(out, "--out")
    check_report(report)
    check_distinct(out, report)
    settings = replace(settings, parameters=parameter)
    study, best = read_fit(run)
    candidates = list_candidates(
        study,
        dict(map(_kind, kind)),
        None if rail_pressure is None else read_axis(rail_pressure, "Pa", "--rail-pressure"),
        None if energising_time is None else read_axis(energising_time, "s", "--energising-time"),
        () if dwell is None else read_axis(dwell, "s", "--dwell").tolist(),
        0.0 if first_energising_time is None else parse(first_energising_time, "s", "--first-energising-time"),
    )
    plan = next_measurements(study, best, candidates, settings, threads=threads, note=say)
    if out is not None:
        write_plan(out, plan)
    if report is not None:
        write_text(report, plan_html(plan, study))
    print_result(
        json,
        lambda: plan_record(plan) | {"run": str(run)},
        lambda: print_text(plan_lines(plan), plan_tables(plan), plan_notes(plan)),
        [out, report],
    )


def _kind(text: str) -> tuple[str, float]:
    from commonrail.plugins.next.study import KINDS

    name, equals, cost = (text_part.strip() for text_part in text.partition("="))
    if name not in KINDS:
        raise InputError(f"--kind {text}: expected {', '.join(KINDS)}{nearest(name, KINDS)}.")
    try:
        return name, float(cost) if equals else 1.0
    except ValueError:
        raise InputError(f"--kind {text}: the cost must be a number, such as {name}=4.") from None
