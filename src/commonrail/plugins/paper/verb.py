"""commonrail lab reproduce: the experiments of Lino et al. (2016) on the virtual test bench, with statistics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from commonrail.base.errors import InputError
from commonrail.base.output import writing
from commonrail.cli.console import Bar, Stage, print_json, print_rows, print_synthetic, print_text, say
from commonrail.cli.fit import Outcome
from commonrail.cli.grammar import Option, table_verb
from commonrail.cli.guard import INTERRUPTED
from commonrail.cli.options import Json, Threads, free_run_folder
from commonrail.plugins.paper import TRUTH

# Nine is the smallest number of seeds that can confirm a claim although one seed deviates: the 95 % interval of 8 of 9
# begins at 52 %, the interval of 7 of 8 at 47 %. With 6 of 6 (54 %) no seed may deviate.
SEEDS, QUICK_SEEDS = 20, 9


@table_verb
def reproduce(
    *,
    seeds: Annotated[
        int | None, Option(min=1, max=1000, help=f"Number of repetitions, with seeds 1 to N. [default: {SEEDS}]")
    ] = None,
    quick: Annotated[
        bool,
        Option(
            "--quick", help=f"Use {QUICK_SEEDS} repetitions: enough for claims that at most one of them contradicts."
        ),
    ] = False,
    truth: Annotated[
        str, Option(metavar="TRUTH", help="Truth of the virtual test bench: a listed name, or a TOML file.")
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
      commonrail lab reproduce --quick
      commonrail lab reproduce --seeds 20 --out runs/paper-study
    """
    from commonrail.base.record import from_record
    from commonrail.plugins.paper.file import ReproductionSummary
    from commonrail.plugins.paper.page import verdicts

    if quick and seeds is not None:
        raise InputError("--quick sets the number of seeds itself; give one of the two.")
    count = QUICK_SEEDS if quick else seeds or SEEDS
    try:
        outcome = run_reproduction(truth, count, out or free_run_folder("reproduce"), threads, quick)
    except KeyboardInterrupt:
        say("commonrail: interrupted before a repetition was complete, so that there is nothing to keep.")
        raise SystemExit(INTERRUPTED) from None
    if json:
        places = {"run": str(outcome.folder), "report": str(outcome.report)}
        print_json({"kind": "reproduction", **places, "result": outcome.record})
    else:
        summary = from_record(ReproductionSummary, outcome.record)
        print_synthetic(summary.synthetic)
        print_text([verdicts(summary)])
        rows = [[c.verdict, f"{c.true_in} of {c.of}", c.claim, c.figure] for c in summary.claims]
        print_rows(["verdict", "true in", "claim of the paper", "here"], rows, "The paper's claims", texts=4)
        click.echo(f"report: {outcome.report}")
    if outcome.interrupted:
        done = len(outcome.record["seeds"])
        say(f"commonrail: interrupted; {done} of {count} repetitions are in {outcome.folder}.")
        raise SystemExit(INTERRUPTED)


# Run a reproduction into a folder: repetitions, record, curves, figures for print, report.

TIME_STEP = 1e-6


def run_reproduction(truth: str, count: int, folder: Path, threads: int | None, quick: bool) -> Outcome:
    """Repeat the paper's study with seeds 1 to `count` into a new or empty folder, with its progress on stderr.

    `truth`: name or file; `threads`: None for all processors; `quick`: noted in the record. InputError if the truth
    cannot be read, or the folder is not empty or not writable. SimulationError if the truth cannot be simulated; the
    empty folder is then removed.
    """
    from commonrail.base.hooks import hold_interrupts
    from commonrail.plugins.paper.bench import Bench
    from commonrail.plugins.paper.bench_file import load_truth
    from commonrail.plugins.paper.file import reproduction_record, write_reproduction
    from commonrail.plugins.paper.page import draw_plates
    from commonrail.plugins.paper.run import reproduce
    from commonrail.plugins.paper.seeds import SeedProgress
    from commonrail.readers.injector import load_injector
    from commonrail.report.page import write_report
    from commonrail.runs.folder import new_folder

    def stage(p: SeedProgress) -> Stage:
        return Stage("generations", p.generation, p.generations, f"{p.done} of {p.seeds} repetitions")

    declared = load_truth(truth)
    bench = Bench(declared, load_injector(declared.injector), TIME_STEP)
    with hold_interrupts():  # Ctrl-C does not prevent writing after the last repetition
        with new_folder(folder) as place:
            with Bar(f"{count} repetitions of the paper's study on the virtual test bench (synthetic)") as bar:
                outcome = reproduce(bench, range(1, count + 1), threads=threads, progress=lambda p: bar.show(stage(p)))
            record = reproduction_record(outcome, quick)
            with writing(folder):
                write_reproduction(place, outcome, record)
                lacking = draw_plates(place)
            write_report(place)
        if lacking:
            say(lacking)
        return Outcome(folder, folder / "report.html", record)
