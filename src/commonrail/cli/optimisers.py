"""commonrail optimisers: compare optimisers at equal evaluations on studies and virtual benches."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated, Any

from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.guard import INTERRUPTED
from commonrail.cli.options import Json
from commonrail.cli.output import check_file
from commonrail.cli.progress import Bar, Stage

__all__ = ["optimisers"]


@verb
def optimisers(
    studies: Annotated[
        tuple[Path, ...], Argument(metavar="STUDY.toml", help="Study files. [default: the paper's case]")
    ] = (),
    *,
    benches: Annotated[int, Option(min=0, max=1000, help="Number of virtual benches besides.")] = 0,
    seeds: Annotated[int, Option(min=1, max=1000, help="Number of seeds, from 1.")] = 5,
    evaluations: Annotated[int, Option(min=50, max=10_000_000, help="Number of evaluations of each search.")] = 3550,
    method: Annotated[
        tuple[str, ...],
        Option(metavar="NAME", help="Name of a method beside the paper's; can be repeated. [default: all]"),
    ] = (),
    out: Annotated[
        Path | None, Option(metavar="FILE.json", help="JSON file to be written with every step of every search.")
    ] = None,
    json: Json = False,
) -> None:
    """Compare optimisers at equal evaluations.

    The paper's differential evolution runs against the others, on one thread. An evaluation is one candidate at
    all operating points of a study. The virtual benches are SYNTHETIC: the paper's case with other stiffnesses,
    noise and scatter. Ctrl-C stops with what was found so far, status 130.

    \b
    Example:
      commonrail optimisers --seeds 3 --benches 2
    """
    from commonrail.bench.contest import contest, entries
    from commonrail.bench.problems import problems_of
    from commonrail.bench.standing import standing
    from commonrail.errors import ConfigurationError
    from commonrail.files.atomic import write_text

    check_file(out, "--out")
    rows: list[dict[str, Any]] = []
    stopped = False
    with Bar("comparing optimisers") as bar:
        problems = problems_of(studies, benches)
        names = [entry.name for problem in problems[:1] for entry in entries(problem, evaluations)]
        chosen = [name for name in names if not method or name == names[0] or name.startswith(tuple(method))]
        if method and (strange := [m for m in method if not any(name.startswith(m) for name in names)]):
            raise ConfigurationError(f'there is no optimiser "{strange[0]}"; take one of: {", ".join(names)}.')
        total = len(problems) * len(chosen) * seeds
        try:
            for row in contest(problems, range(1, seeds + 1), evaluations, method):
                rows.append(row)
                bar.show(Stage("searches", len(rows), total, f"{row['problem']}, {row['optimiser']}"))
        except KeyboardInterrupt:
            stopped = True
    table = standing(rows, evaluations)
    record = {"kind": "optimisers", "evaluations": evaluations, "standing": table, "searches": rows}
    if out is not None:
        write_text(out, json_text.dumps(record, allow_nan=False) + "\n")
    if json:
        print_json({**record, "searches": len(rows)})
    else:
        print_rows(_HEADS, [_cells(row) for row in table], f"{evaluations} evaluations, medians of seeds", texts=2)
    if stopped:
        say("commonrail: interrupted; what was found so far is above.")
        raise SystemExit(INTERRUPTED)


_HEADS = (
    "problem",
    "optimiser",
    "seeds",
    "J at a tenth",
    "J at the end",
    "within 1 % of the best known",
    "evaluations to there",
    "evaluations to the paper's J",
    "times fewer",
    "s",
    "converged",
)


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    from commonrail.bench.record import number

    def reached(key: str) -> str:
        return "not reached" if row[key] is None else number(row[key])

    return (
        row["problem"],
        row["optimiser"],
        str(row["seeds"]),
        "none yet" if row["tenth"] is None else f"{row['tenth']:.5g}",
        "none" if row["end"] is None else f"{row['end']:.5g}",
        f"{100.0 * row['near']:.0f} %",
        reached("near_evaluations"),
        reached("equal_evaluations"),
        reached("saving"),
        number(row["seconds"]),
        f"{100.0 * row['converged']:.0f} %",
    )
