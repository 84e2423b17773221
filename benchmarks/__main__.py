"""Time and accuracy of commonrail, and its optimisers compared with others: ``python -m benchmarks speed|optimisers``.

``make bench`` runs ``speed --peers``, then adds what bounds a step (`benchmarks.roofline`) and draws figures
(`benchmarks.plot`).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from benchmarks import curves
from benchmarks.contest import SLOTS, contest, entries, problems_of, rank_optimisers
from benchmarks.methods import peer_methods, right_hand_side
from benchmarks.run import (
    TABLES,
    Columns,
    Make,
    Stage,
    column,
    effort,
    grids,
    make_table,
    number,
    run_bench,
    sentences,
    stages,
    words,
)
from benchmarks.searches import OPTIMISERS, reference_searches
from commonrail.base.errors import CommonrailError, ConfigurationError
from commonrail.base.output import write_text
from commonrail.cli.console import Bar, print_json, print_rows, say
from commonrail.cli.console import Stage as Shown
from commonrail.cli.options import check_file
from commonrail.compiler.target import package_version as version
from commonrail.engine.threads import usable_threads

INTERRUPTED = 130  # exit status
EXTRA = "pip install 'commonrail[bench]'"
PACKAGES = {"sksundae": "SUNDIALS CVODE (scikit-sundae)", "pymoo": "pymoo", "cma": "pycma"}
DISTRIBUTIONS = ("scikit-sundae", "pymoo", "cma")


def missing_peers(find: Callable[[str], object | None] = find_spec) -> list[dict[str, str]]:
    """Peers that are not installed, and how to install them."""
    return [{"peer": name, "install": EXTRA} for module, name in PACKAGES.items() if find(module) is None]


def plan_stages(quick: bool) -> list[Stage]:
    """Everything that is measured, in order; peers that are not installed are left out."""
    present = {module for module in PACKAGES if find_spec(module) is not None} | {"scipy"}
    methods = [m for m in peer_methods() if m.needs in present]
    counts = curves.CANDIDATES[:4] if quick else curves.CANDIDATES
    points, horizons = (curves.POINTS[:3], curves.HORIZONS[:3]) if quick else (curves.POINTS, curves.HORIZONS)
    threads, long = usable_threads(), effort(quick)
    return [
        *stages(quick, methods, [o for o in OPTIMISERS if o.module in present]),
        Stage("right_hand_side", "the right-hand side", 2, lambda: iter(right_hand_side())),
        Stage("extrapolated", "searches by scalar solvers, a part of them", 3, reference_searches),
        Stage("points", "operating points", len(points), lambda: curves.point_curve(points, long)),
        Stage("horizon", "horizons", len(horizons), lambda: curves.horizon_curve(horizons, long)),
        Stage("threads", "threads", threads.bit_length(), lambda: curves.thread_curve(threads, long)),
        Stage("candidates", "candidates and memory", len(counts), lambda: curves.population_curve(counts, long)),
    ]


_EXTRAPOLATED: Columns = (
    ("optimiser", words("optimiser")),
    ("measured", words("measured_simulations")),
    ("of simulations", words("simulations")),
    ("s", column("seconds")),
)
_CANDIDATES: Columns = (
    ("candidates", words("candidates")),
    ("s", lambda row: row["failed"] if "failed" in row else number(row["seconds"])),
    ("per second", lambda row: number(row["per_second"]) if "per_second" in row else ""),
    ("greatest memory, MB", lambda row: number(row["peak_bytes"] / 1e6) if row.get("peak_bytes") else ""),
)


def _curve(title: str, key: str, factor: float = 1.0) -> Make:
    columns: Columns = (
        (title.lower(), column(key, factor)),
        ("s", column("seconds")),
        ("simulations per second", column("per_second")),
        ("threads", words("threads")),
    )
    return make_table(title, columns, 0)


ALL_TABLES: dict[str, Make] = TABLES | {
    "extrapolated": make_table(
        "The same by scalar solvers on one core: EXTRAPOLATED from the simulations measured", _EXTRAPOLATED
    ),
    "points": _curve("Operating points", "points"),
    "horizon": _curve("Horizon ms", "horizon", 1e3),
    "threads": _curve("Threads", "threads"),
    "candidates": make_table("Candidates", _CANDIDATES, 0),
}


def speed(quick: bool, peers: bool, out: Path | None, as_json: bool) -> int:
    """Measure time and accuracy of simulations and searches; measurements before Ctrl-C are shown too.

    Parameters
    ----------
    quick : bool
        Shorter timings and fewer rows.
    peers : bool
        Other solvers and optimisers too, and cost curves.
    out : Path or None
        File for the record.
    as_json : bool
        Print the record in place of tables.

    Returns
    -------
    int
        Exit status.
    """
    check_file(out, "--out")
    options = {"peers": True, "curves": True, "quick": quick} if peers else {"quick": quick}
    with Bar("measuring; leave the machine alone meanwhile") as bar:
        record = run_bench(
            plan_stages(quick) if peers else stages(quick),
            lambda title, done, total: bar.show(Shown(title, done, total, "")),
            options=options,
            missing=missing_peers() if peers else (),
        )
    if peers:
        record["machine"]["versions"] |= {name: installed for name in DISTRIBUTIONS if (installed := version(name))}
    if out is not None:
        write_text(out, json.dumps(record, indent=1, allow_nan=False) + "\n")
    if as_json:
        print_json(record)
    else:
        for grid in grids(record, ALL_TABLES):
            print_rows(grid.heads, grid.rows, grid.title, texts=grid.texts)
        print("\n".join(sentences(record)))
    return _ended(record["status"] == "interrupted")


def optimisers(
    studies: Sequence[Path],
    benches: int,
    seeds: int,
    evaluations: int,
    methods: Sequence[str],
    *,
    out: Path | None,
    as_json: bool,
) -> int:
    """Compare optimisers at equal evaluations, on one thread; results before Ctrl-C are shown too.

    Parameters
    ----------
    studies : sequence of Path
        Study files; by default the paper's case.
    benches : int
        Number of virtual benches besides: SYNTHETIC, the paper's case with other stiffnesses, noise and scatter.
    seeds : int
        Number of seeds, from 1.
    evaluations : int
        Of each search, candidates at all operating points of a study.
    methods : sequence of str
        Beginnings of the names of methods in addition to the paper's; by default all.
    out : Path or None
        File for every step of every search.
    as_json : bool
        Print the standing as JSON.

    Returns
    -------
    int
        Exit status.
    """
    check_file(out, "--out")
    rows: list[dict[str, Any]] = []
    stopped = False
    with Bar("comparing optimisers") as bar:
        problems = problems_of(studies, benches)
        names = [entry.name for problem in problems[:1] for entry in entries(problem)]
        if strange := [method for method in methods if not any(name.startswith(method) for name in names)]:
            raise ConfigurationError(f'there is no optimiser "{strange[0]}"; take one of: {", ".join(names)}.')
        selected = [name for name in names if not methods or name == names[0] or name.startswith(tuple(methods))]
        total = len(problems) * len(selected) * seeds
        try:
            for row in contest(problems, range(1, seeds + 1), evaluations, methods):
                rows.append(row)
                bar.show(Shown("searches", len(rows), total, f"{row['problem']}, {row['optimiser']}"))
        except KeyboardInterrupt:
            stopped = True
    table = rank_optimisers(rows, evaluations)
    record = {"kind": "optimisers", "evaluations": evaluations, "standing": table, "searches": rows}
    if out is not None:
        write_text(out, json.dumps(record, allow_nan=False) + "\n")
    if as_json:
        print_json({**record, "searches": len(rows)})
    else:
        cells = [[text(row) for text in _STANDING.values()] for row in table]
        print_rows(list(_STANDING), cells, f"{evaluations} evaluations, medians of seeds", texts=2)
    return _ended(stopped)


def _ended(interrupted: bool) -> int:
    if interrupted:
        say("interrupted; the results so far are above.")
    return INTERRUPTED if interrupted else 0


def _reached(key: str) -> Callable[[Mapping[str, Any]], str]:
    return lambda row: "not reached" if row[key] is None else number(row[key])


def _objective(key: str, none: str) -> Callable[[Mapping[str, Any]], str]:
    return lambda row: none if row[key] is None else f"{row[key]:.5g}"


def _percent(key: str) -> Callable[[Mapping[str, Any]], str]:
    return lambda row: f"{100.0 * row[key]:.0f} %"


_STANDING: dict[str, Callable[[dict[str, Any]], str]] = {
    "problem": words("problem"),
    "optimiser": words("optimiser"),
    "seeds": words("seeds"),
    "J at a tenth": _objective("tenth", "none yet"),
    "J at the end": _objective("end", "none"),
    "within 1 % of the best known": _percent("near"),
    "evaluations to there": _reached("near_evaluations"),
    "evaluations to the paper's J": _reached("equal_evaluations"),
    "times fewer": _reached("saving"),
    "s": column("seconds"),
    "converged": _percent("converged"),
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", allow_abbrev=False)
    verbs = parser.add_subparsers(dest="verb", required=True)
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument("--out", type=Path, metavar="FILE.json", help="file for the record")
    shared.add_argument("--json", action="store_true", help="print JSON in place of tables")
    speed_parser = verbs.add_parser("speed", parents=[shared], help="time and accuracy of simulations and searches")
    speed_parser.add_argument("--quick", action="store_true", help="shorter timings and fewer rows")
    speed_parser.add_argument("--peers", action="store_true", help="other solvers and optimisers too, and cost curves")
    other = verbs.add_parser("optimisers", parents=[shared], help="optimisers at equal evaluations, on one thread")
    other.add_argument("studies", type=Path, nargs="*", metavar="STUDY.toml", help="by default the paper's case")
    other.add_argument("--benches", type=_count(0), default=0, help="number of virtual benches besides")
    other.add_argument("--seeds", type=_count(1), default=5, help="number of seeds, from 1")
    other.add_argument("--evaluations", type=_count(50), default=SLOTS, help="of each search")
    other.add_argument("--method", action="append", default=[], help="in addition to the paper's; can be repeated")
    return parser


def _count(least: int) -> Callable[[str], int]:
    def count(text: str) -> int:
        if int(text) < least:
            raise argparse.ArgumentTypeError(f"must be {least} or more, not {text}")
        return int(text)

    return count


def main(words: Sequence[str] | None = None) -> int:
    """Run a command line, by default this process's; returns the exit status."""
    args = _parser().parse_args(words)
    try:
        if args.verb == "speed":
            return speed(args.quick, args.peers, args.out, args.json)
        numbers = args.benches, args.seeds, args.evaluations
        return optimisers(args.studies, *numbers, args.method, out=args.out, as_json=args.json)
    except CommonrailError as error:
        say(f"benchmarks: {error}")
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
