"""commonrail tolerance: spread of the injected quantity over parts within tolerances."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from commonrail.base.choices import Precision
from commonrail.cli.console import Bar, Stage, print_json, print_synthetic, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.guard import INTERRUPTED
from commonrail.cli.options import Json, Threads

if TYPE_CHECKING:
    from commonrail.plugins.tolerance.file import ToleranceResult
    from commonrail.plugins.tolerance.study import Tolerances


@table_verb
def tolerance(
    file: Annotated[Path, Argument(metavar="TOLERANCES.toml", help="Tolerance file.")],
    *,
    parts: Annotated[int | None, Option(min=1000, help="Number of parts. [default: as in the file]")] = None,
    seed: Annotated[int | None, Option(min=0, help="Seed of the parts. [default: as in the file]")] = None,
    precision: Annotated[
        Precision | None, Option(help="Precision of the simulations. [default: as in the file]")
    ] = None,
    out: Annotated[
        Path | None, Option(metavar="DIR", help="New folder for report.html, tolerance.json and tolerance.csv.")
    ] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Simulate the spread of parts within their tolerances.

    The report gives spread and capability of the injected quantity, and the tolerances to tighten.
    Ctrl-C ends the study with the parts simulated so far; the exit status is 130. Without --out nothing is written.

    \b
    Examples:
      commonrail tolerance cases/tolerance/tolerances.toml --out runs/tolerance
      commonrail tolerance cases/tolerance/tolerances.toml --parts 1000000 --precision f32
    """
    from commonrail.base.hooks import hold_interrupts
    from commonrail.plugins.tolerance.file import load_tolerances
    from commonrail.plugins.tolerance.page import tolerance_lines, tolerance_notes, tolerance_tables
    from commonrail.report.analysis import run_into

    changed: dict[str, Any] = {"parts": parts, "seed": seed, "precision": precision}
    loaded = replace(load_tolerances(file), **{key: value for key, value in changed.items() if value is not None})
    with hold_interrupts():  # write the simulated parts even after Ctrl-C
        study_result = run_into(out, "tolerance.csv", lambda: _run(loaded, threads), {"tolerances.toml": loaded.text})
    record = study_result.record()
    if json:
        print_json(record)
    else:
        print_synthetic(record["synthetic"])
        print_text(tolerance_lines(study_result), tolerance_tables(study_result), tolerance_notes(study_result))
        if out is not None:
            click.echo(f"report: {out / 'report.html'}")
    if study_result.status == "interrupted":
        say(f"commonrail: interrupted after {study_result.parts:,} of {loaded.parts:,} parts; the result covers these.")
        raise SystemExit(INTERRUPTED)


def _run(loaded: Tolerances, threads: int | None) -> ToleranceResult:
    from commonrail.plugins.tolerance.run import tolerance as run

    with Bar(f"{loaded.title}: {loaded.parts:,} parts") as bar:
        return run(
            loaded,
            threads=threads,
            progress=lambda p: bar.show(Stage(p.phase, p.done, p.total, f"{len(loaded.points)} operating points")),
        )
