"""commonrail sweep: quantities over one to three variables; energising times of the second injection over dwell."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import click

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.output import write_text
from commonrail.base.units import parse
from commonrail.cli import options
from commonrail.cli.console import SIMULATING, print_result, print_table, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.plugins.maps.verb import read_conditions, read_quantities

SECOND, SINGLE = "tiSecond", "tiEnergising"  # default labels

if TYPE_CHECKING:
    from commonrail.base.arrays import Floats
    from commonrail.plugins.maps.sweep import Sweep, Variable


@table_verb
def sweep(
    model: Annotated[str, Argument(metavar="MODEL", help="Injector file, a name of the catalogue, or a run folder.")],
    *,
    vary: Annotated[
        tuple[str, ...],
        Option(
            metavar="NAME=VALUES",
            help="Variable and its values, e.g. dwell=0:3000:100us or temperature=20,40,80degC: rail_pressure, "
            "energising_time, first_energising_time, dwell, cylinder_pressure, return_pressure, temperature, or any "
            "parameter; one to three.",
        ),
    ],
    rail_pressure: Annotated[str, Option(help="Rail pressure unless varied.")] = "100MPa",
    energising_time: Annotated[
        str, Option(help="Energising time of the injection, or of the second of two.")
    ] = "500us",
    first_energising_time: Annotated[
        str | None, Option(help="Energising time of a first injection before it. [default: none]")
    ] = None,
    dwell: Annotated[str, Option(help="Time from the end of the first energising to the start of the second.")] = "1ms",
    hold: Annotated[
        str | None,
        Option(
            metavar="QUANTITIES",
            help="Quantities, e.g. 1,2,5mm3. Searches for the energising time: of the second injection over the varied "
            "rail pressures and dwells, of a single one over rail pressures and one condition, such as a voltage.",
        ),
    ] = None,
    change: Annotated[
        bool,
        Option(
            help="Write the change against the second injection alone, over dwell and rail pressure: of its energising "
            "time with --hold (a map for each quantity), else of its quantity.",
        ),
    ] = False,
    cylinder_pressure: options.CylinderPressure = None,
    return_pressure: options.ReturnPressure = None,
    longest: Annotated[str, Option(help="Longest energising time of --hold.")] = "2ms",
    time_step: Annotated[str, Option(help="Time step, e.g. 1us.")] = "1us",
    set_: options.Settings = (),
    label: Annotated[
        str | None,
        Option(
            help="Label of the maps of --hold and --change; the dwell or quantity is added to several. [default: "
            f"{SECOND}, or {SINGLE} of a single injection]"
        ),
    ] = None,
    out: Annotated[
        tuple[Path, ...],
        Option(metavar="FILE", help="File: .csv; of --hold and --change also those of commonrail map; repeatable."),
    ] = (),
    report: Annotated[Path | None, Option(metavar="FILE.html", help="Report with the curves.")] = None,
    threads: options.Threads = None,
    json: options.Json = False,
) -> None:
    """Sweep variables, or the dwell of injections.

    Two injections whose needle does not close in between are reported as fused. --hold searches for the
    energising time that delivers a quantity at each rail pressure and dwell, or at each rail pressure and
    value of a condition; a small quantity gives dead times.

    \b
    Examples:
      commonrail sweep cri2-16 --vary dwell=0:3000:50us --vary rail_pressure=40,80,160MPa \\
          --first-energising-time 350us --energising-time 500us --report dwell.html
      commonrail sweep cri2-16 --vary rail_pressure=40:160:20MPa --vary dwell=400,800,1600us \\
          --first-energising-time 350us --hold 1,2,5,10mm3 --out second.dcm
      commonrail sweep cri2-16 --vary rail_pressure=40:160:20MPa --vary dwell=1000:3000:100us \\
          --first-energising-time 350us --hold 5mm3 --change --label InjWave_dtiET_MAP --out wave.dcm
      commonrail sweep cri2-16 --vary rail_pressure=40:160:20MPa --vary temperature=-20:80:20degC --hold 0.1mm3 \\
          --label InjVlv_tiDead_MAP --out dead.dcm
    """
    from dataclasses import replace
    from functools import partial

    from commonrail.cli.model_name import read_model_name
    from commonrail.plugins.maps import sweep_file, sweep_page, table
    from commonrail.plugins.maps.compensation import hold_quantities
    from commonrail.plugins.maps.file import check_map_file, write_map_file
    from commonrail.plugins.maps.response import density_at
    from commonrail.plugins.maps.sweep import Base
    from commonrail.plugins.maps.sweep import sweep as run

    options.refuse_unused(
        {
            "longest": (hold is not None, "--hold"),
            "label": (
                (hold is not None or change) and any(path.suffix.lower() != ".csv" for path in out),
                "--hold or --change and a file of --out with labels (no CSV)",
            ),
            "change": (bool(out), "--out FILE"),
        }
    )
    _refuse_varied(vary)
    for path in out:
        options.check_file(path, "--out")
        if hold is not None or change:
            check_map_file(path)
        elif path.suffix.lower() != ".csv":
            raise InputError(
                f"--out: {path}: a sweep is written as .csv, with --change also as a map; all numbers: --json."
            )
    options.check_report(report)
    options.check_distinct(*out, report)
    source = read_model_name(model)
    base = Base(
        parse(rail_pressure, "Pa", "--rail-pressure"),
        parse(energising_time, "s", "--energising-time"),
        0.0 if first_energising_time is None else parse(first_energising_time, "s", "--first-energising-time"),
        parse(dwell, "s", "--dwell"),
        read_conditions((cylinder_pressure, return_pressure), time_step, threads, source.folder),
    )
    injector = options.with_overrides(source.injector, set_)
    options.refuse_return_pressure(injector)
    variables = [_variable(text) for text in vary]
    table.check_label(label or SECOND)
    if hold is None:
        if change and ({v.name for v in variables} != {"dwell", "rail_pressure"} or not base.first_energising_time):
            raise InputError("--change: vary rail_pressure and dwell alone, and give --first-energising-time.")
        say(SIMULATING)
        swept = run(injector, variables, base)
        swept = replace(swept, fusion=_fusion(swept))
        outcome = _Outcome(
            partial(sweep_file.write_sweep, swept=swept),
            partial(sweep_page.sweep_html, swept),
            partial(sweep_file.sweep_record, swept),
            partial(print_text, sweep_page.sweep_lines(swept), sweep_page.sweep_tables(swept)),
        )
        maps = [table.change_table(swept, _alone(swept), label or SECOND)] if change else []
    else:
        quantity = read_quantities(hold, density_at(injector, base.conditions), "--hold")
        limit = parse(longest, "s", "--longest")
        say(SIMULATING)
        try:
            compensated = hold_quantities(injector, variables, quantity, base, limit)
        except ConfigurationError as error:
            raise InputError(f"--hold: {error}") from error
        outcome = _Outcome(
            partial(sweep_file.write_compensation, compensated=compensated),
            partial(sweep_page.compensation_html, compensated),
            partial(sweep_file.compensation_record, compensated),
            partial(print_table, sweep_page.compensation_table(compensated)),
        )
        label = label or (SECOND if compensated.first_energising_time else SINGLE)
        maps = table.tables_at_quantities(compensated, label, change) if out else []
    for path in out:
        if path.suffix.lower() == ".csv" and not change:
            outcome.write(path)
        else:
            write_map_file(path, maps)
    if report is not None:
        write_text(report, outcome.html())
    print_result(json, outcome.record, outcome.show, (*out, report))


class _Outcome(NamedTuple):
    """Outputs of a result: rows of a CSV file, a report, a record, and text for the terminal."""

    write: Callable[[Path], None]
    html: Callable[[], str]
    record: Callable[[], dict[str, Any]]
    show: Callable[[], None]


def _refuse_varied(vary: tuple[str, ...]) -> None:
    """Refuse an option for a variable that `--vary` already gives."""
    for name in (text.partition("=")[0].strip() for text in vary):
        if name in click.get_current_context().params and options.is_given(name):
            raise InputError(
                f"--{name.replace('_', '-')}: --vary {name} already gives its values; omit one of the two."
            )


def _variable(text: str) -> Variable:
    from commonrail.plugins.maps.sweep import Variable, resolve_variable

    name, equals, values = (piece.strip() for piece in text.partition("="))
    if not (name and equals and values):
        raise InputError(f'--vary {text}: expected NAME=VALUES, such as "dwell=0:3000:100us".')
    full, unit = resolve_variable(name)
    return Variable(full, unit, options.read_axis(values, unit, f"--vary {name}"))


def _alone(swept: Sweep) -> Floats:
    """Quantities (pressures,) [m³] of the second injection without the first."""
    from commonrail.plugins.maps.sweep import sweep as run

    pressures = [v for v in swept.variables if v.name == "rail_pressure"]
    return run(swept.injector, pressures, swept.base._replace(first_energising_time=0.0)).volume


def _fusion(swept: Sweep) -> tuple[tuple[float, float], ...]:
    """Rail pressures [Pa] and the dwells below which the injections fuse [s], if a dwell is varied."""
    import numpy as np

    from commonrail.plugins.maps.compensation import fusion_dwell

    varied = {v.name: v.values for v in swept.variables}
    if not ("dwell" in varied and set(varied) <= {"dwell", "rail_pressure"}):
        return ()
    rails = varied.get("rail_pressure", np.array([swept.base.rail_pressure]))
    dwells = fusion_dwell(swept.injector, swept.base, rails, float(varied["dwell"][-1]))
    return tuple(zip(rails.tolist(), dwells.tolist(), strict=True))
