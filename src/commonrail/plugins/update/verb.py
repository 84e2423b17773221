"""commonrail update: judge new data by a run, and fit old and new data together into a new run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from commonrail.base.errors import InputError
from commonrail.base.stages import telling
from commonrail.cli.console import Bar, print_json, print_text, show_stages_on
from commonrail.cli.fit import JUDGED_SOON, stage_of
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import DecimalSign, Encoding, Json, SheetName, Threads, check_folder, free_run_folder
from commonrail.plugins.new import verb as new


@verb
def update(
    run: Annotated[Path, Argument(metavar="RUN", help="Folder of commonrail calibrate or update.")],
    more: Annotated[tuple[Path, ...], Argument(metavar="FILE", help="Additional new data files, as with --with.")] = (),
    *,
    with_: Annotated[
        tuple[Path, ...], Option("--with", metavar="FILE", help="New data file to fit, see inspect; repeatable.")
    ] = (),
    held_out: Annotated[
        tuple[Path, ...], Option(metavar="FILE", help="New data file for comparison only; repeatable.")
    ] = (),
    out: Annotated[Path | None, Option(metavar="DIR", help="New run folder. [default: RUN-update-<n>]")] = None,
    global_: Annotated[
        bool, Option("--global", help="Search with the optimiser of the study, not only near the calibrated values.")
    ] = False,
    as_begun: Annotated[
        bool, Option("--as-begun", help="Use the copies in RUN although the original files have changed.")
    ] = False,
    cylinder_pressure: new.BenchCylinderPressure = "",
    return_pressure: new.BenchReturnPressure = "",
    rail_pressure: new.RateRailPressure = "",
    energising_time: new.RateEnergisingTime = "",
    sheet: SheetName = None,
    encoding: Encoding = None,
    decimal: DecimalSign = None,
    pressure_unit: new.PressureUnit = "",
    time_unit: new.TimeUnit = "",
    quantity_unit: new.QuantityUnit = "",
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Update a calibration with new data.

    The new data are judged first by the prediction bands of RUN: they agree, lie outside the bands, or contradict it.
    Then old and new data are fitted together, from the calibrated values, into a new run folder; RUN is not changed.
    Meters, weights and pressures come from the study's data of the same kind. Ctrl-C leaves no new folder.

    \b
    Examples:
      commonrail update runs/first --with april.xlsx
      commonrail update runs/first --with rates.mf4 --held-out map.csv --out runs/second
    """
    from commonrail.calibration.record import CalibrationRecord, read_as
    from commonrail.plugins.update.run import update as run_update
    from commonrail.report.fit.verdict import verdict
    from commonrail.runs.fit import Listener
    from commonrail.runs.folder import read_result

    files = (*with_, *more)
    if not files and not held_out:
        raise InputError(f"Name one or more new files, as in commonrail update {run} --with april.xlsx.")
    stated = new.read_stated(
        {"cylinder_pressure": cylinder_pressure, "return_pressure": return_pressure},
        {"rail_pressure": rail_pressure, "energising_time": energising_time},
        (encoding, decimal, sheet),
        (pressure_unit, time_unit, quantity_unit),
        (*files, *held_out),
    )
    place = out or free_run_folder(f"{run.absolute().name}-update", run.parent)
    check_folder(place)
    with Bar(f"{run}: update") as bar, telling(show_stages_on(bar, JUDGED_SOON)):
        result = run_update(
            run,
            files,
            out=place,
            held_out=held_out,
            stated=stated,
            global_search=global_,
            as_begun=as_begun,
            threads=threads,
            listener=Listener(lambda p: bar.show(stage_of(p)), bar.note),
        )
    if json:
        print_json({"kind": "update", "folder": str(place), **result.content})
        return
    print_text([*result.content["lines"], verdict(read_as(CalibrationRecord, read_result(place)), str(place)).headline])
    click.echo(f"report: {place / 'report.html'}")
