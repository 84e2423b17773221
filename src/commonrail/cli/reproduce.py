"""commonrail reproduce: the experiments of Lino et al. (2016) on the virtual test bench, with statistics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Option, verb
from commonrail.cli.guard import INTERRUPTED
from commonrail.cli.options import Json, Threads
from commonrail.cli.output import free_run_folder
from commonrail.errors import InputError

__all__ = ["QUICK_SEEDS", "TRUTH", "reproduce"]

# Nine is the smallest number of seeds that tells a claim from chance though one of them deviates: the 95 % interval of
# 8 of 9 begins at 52 %, that of 7 of 8 at 47 %, and 6 of 6 (54 %) allows none.
SEEDS, QUICK_SEEDS = 20, 9
TRUTH = "virtual-lino-2016"


@verb
def reproduce(
    *,
    seeds: Annotated[
        int | None, Option(min=1, max=1000, help=f"Number of repetitions, with seeds 1 to N. [default: {SEEDS}]")
    ] = None,
    quick: Annotated[
        bool,
        Option("--quick", help=f"Use {QUICK_SEEDS} repetitions: enough for claims on which all or all but one agree."),
    ] = False,
    truth: Annotated[
        str, Option(metavar="TRUTH", help="Truth of the virtual test bench: a name of its list, or a TOML file.")
    ] = TRUTH,
    out: Annotated[Path | None, Option(metavar="RUN", help="New run folder. [default: runs/reproduce-<n>]")] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Rerun the experiments of Lino et al. (2016) and judge the paper's claims.

    The paper's measurements are not published: each repetition takes a new synthetic measurement from
    the virtual test bench and repeats the search. The run folder contains reproduce.json (all numbers),
    traces.csv, plots for print, and report.html.

    \b
    Examples:
      commonrail reproduce --quick
      commonrail reproduce --seeds 20 --out runs/paper-study
    """
    from commonrail.cli.reproduction_run import run_reproduction
    from commonrail.report.reproduction import verdicts

    if quick and seeds is not None:
        raise InputError("--quick sets the number of seeds itself; give one of the two.")
    count = QUICK_SEEDS if quick else seeds or SEEDS
    outcome = run_reproduction(truth, count, out or free_run_folder("reproduce"), threads, quick)
    if json:
        places = {"run": str(outcome.folder), "report": str(outcome.report)}
        print_json({"kind": "reproduction", **places, "result": outcome.record})
    else:
        click.echo(f"SYNTHETIC: {outcome.record['synthetic']}")
        claims = outcome.record["claims"]
        rows = [[c["verdict"], f"{c['true_in']} of {c['of']}", c["claim"], c["figure"]] for c in claims]
        print_rows(["verdict", "true in", "claim of the paper", "here"], rows, "The paper's claims", texts=4)
        click.echo(verdicts(outcome.record))
        click.echo(f"report: {outcome.report}")
    if outcome.interrupted:
        done = len(outcome.record["seeds"])
        say(f"commonrail: interrupted; {done} of {count} repetitions are in {outcome.folder}.")
        raise SystemExit(INTERRUPTED)
