"""Cases paper and cri2-16, and the paper's study: ``python -m tools.demo --out demo``."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Annotated

import click

from commonrail.base.errors import InputError
from commonrail.base.output import writing
from commonrail.cli.console import begin_result, say
from commonrail.cli.fit import Outcome, make_live, print_fit, run_study
from commonrail.cli.grammar import Option, table_verb
from commonrail.cli.guard import INTERRUPTED, end_on_errors
from commonrail.cli.options import Threads
from commonrail.plugins.paper import TRUTH
from commonrail.plugins.paper.verb import QUICK_SEEDS, run_reproduction

FOLDER = Path(__file__).resolve().parents[1] / "cases"
CASES = ("paper", "cri2-16")
STUDY = "paper-study"
BENCH_SEED = 1  # of the paper's case as its study file states it
MARKER = ".commonrail-demo"


@table_verb
@end_on_errors()
def demo(
    *,
    out: Annotated[Path, Option(help="Folder of the demo; an earlier demo in it is replaced.")],
    threads: Threads = None,
) -> None:
    """Calibrate the paper's case and a real injector, repeat the paper's study, and print the results."""
    from commonrail.base.record import from_record
    from commonrail.plugins.paper.file import ReproductionSummary
    from commonrail.plugins.paper.page import verdicts

    begin = time.perf_counter()
    _prepare(out)
    outcomes = []
    for name in CASES:
        outcomes.append(_calibrate(FOLDER / name, out / name, threads))
        if outcomes[-1].interrupted:
            raise SystemExit(INTERRUPTED)
    study = run_reproduction(TRUTH, QUICK_SEEDS, out / STUDY, threads, quick=True)
    for outcome in outcomes:
        _print(outcome)
        make_live(outcome)
    counted = verdicts(from_record(ReproductionSummary, study.record))
    click.echo(f"The paper's whole study, {QUICK_SEEDS} repetitions: {counted}\n")
    click.echo(f"all took {time.perf_counter() - begin:.0f} s; open in a browser:")
    for outcome in (*outcomes, study):
        click.echo(f"  {outcome.report}")
    if study.interrupted:
        raise SystemExit(INTERRUPTED)


def _prepare(out: Path) -> None:
    """Remove an earlier demo, and nothing else."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        if not (out / MARKER).is_file():
            raise InputError(f"{out}: not a folder of the demo; name another with --out.")
        for name in (*CASES, STUDY):
            if (out / name).is_dir():
                with writing(out / name):
                    shutil.rmtree(out / name)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        (out / MARKER).touch()


def _calibrate(case: Path, folder: Path, threads: int | None) -> Outcome:
    from commonrail.calibration.study_file import load_study

    if case.name == "paper" and not any((case / "data").glob("*.csv")):
        from commonrail.plugins.paper.bench_file import virtual_bench

        say("simulating the virtual test bench; this takes minutes ...")
        virtual_bench(case, BENCH_SEED)
    return run_study(load_study(case / "study.toml"), folder, threads)


def _print(outcome: Outcome) -> None:
    """Print the verdict of a calibration, in full its tables too."""
    begin_result()
    click.echo(outcome.record["title"])
    print_fit(outcome)
    click.echo("")


if __name__ == "__main__":
    demo()
