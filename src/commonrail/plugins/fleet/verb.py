"""commonrail fleet: calibrate many injectors to one model family."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from commonrail.base.errors import SimulationError
from commonrail.cli.console import Bar, Stage, print_json, print_synthetic, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.guard import INTERRUPTED
from commonrail.cli.options import ClusterAddress, Json, check_workers

if TYPE_CHECKING:
    from commonrail.plugins.fleet.run import FleetProgress, FleetRun

REPORTED = 20  # failures that are reported as they occur; the tables list all


@table_verb
def fleet(
    file: Annotated[Path, Argument(metavar="FLEET.toml", help="Fleet file.")],
    *,
    out: Annotated[
        Path | None,
        Option(metavar="DIR", help="Folder of the fleet, new or begun earlier. [default: runs/<fleet>]"),
    ] = None,
    workers: Annotated[
        int | None,
        Option(min=1, help="Number of worker processes; does not change the result. [default: all processors]"),
    ] = None,
    cluster: ClusterAddress = None,
    retry: Annotated[bool, Option("--retry", help="Repeat failed injectors.")] = False,
    json: Json = False,
) -> None:
    """Calibrate every injector of a fleet, each to its own data.

    Repeat the command to resume a fleet that was stopped: finished injectors are not calibrated again.
    An injector that fails is listed with its reason and does not affect the others.

    \b
    Example:
      commonrail fleet line-3/fleet.toml --out runs/line-3 --workers 8
    """
    from commonrail.plugins.fleet.page import write_fleet_report
    from commonrail.plugins.fleet.run import fleet as run_fleet
    from commonrail.plugins.fleet.study import load_fleet

    check_workers(workers, cluster)
    loaded = load_fleet(file)
    # the folder's name says more than a file name "fleet"
    folder = out or Path("runs") / (file.absolute().parent.name if file.stem == "fleet" else file.stem)
    with Bar(f"{loaded.title}: {len(loaded.supply.names):,} injectors") as bar:
        run = run_fleet(loaded, folder, workers=workers, cluster=cluster, retry=retry, progress=lambda p: _show(bar, p))
    again = f"commonrail fleet {shlex.quote(file.as_posix())} --out {shlex.quote(folder.as_posix())}"
    report = write_fleet_report(folder, run.record, again)
    if json:
        print_json({"kind": "fleet", "folder": str(folder), "report": str(report), "result": run.record})
    else:
        _print(run, report)
    if run.interrupted:
        say(f"commonrail: interrupted; run the same command again to resume the fleet in {folder}.")
        raise SystemExit(INTERRUPTED)
    if run.result.counts.failed:
        raise SystemExit(SimulationError.exit_code)


def _show(bar: Bar, p: FleetProgress) -> None:
    if p.last.reason and p.failed <= REPORTED:
        bar.note(f"{p.last.name} failed: {p.last.reason}")
    speed = p.now / p.seconds if p.seconds > 0.0 else 0.0
    bar.show(Stage("injectors", p.done, p.total, f"{p.failed} failed, {speed:.2f} injectors/s"))


def _print(run: FleetRun, report: Path) -> None:
    from commonrail.plugins.fleet.page import fleet_lines, fleet_tables, fleet_warnings

    result, clock = run.result, run.result.clock
    print_synthetic(result.synthetic)
    lines = [*fleet_lines(result), *(f"warning: {line}" for line in fleet_warnings(result))]
    if clock.run.calibrated_now:
        after = f", {clock.later_speed:.2f} injectors/s once the workers were up" if clock.later_speed else ""
        speed = f"{clock.speed:.2f} injectors/s{after}"
        say(f"{clock.run.calibrated_now} injectors in {clock.run.seconds:.1f} s: {speed}.")
    print_text(lines, fleet_tables(result))
    click.echo(f"report: {report}")
