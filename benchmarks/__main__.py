"""commonrail beside other solvers and optimisers, and its cost curves: ``python -m benchmarks [--quick] RECORD.json``.

``make bench`` runs it, then adds what bounds a step (`benchmarks.roofline`) and draws figures (`benchmarks.plot`).
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from benchmarks import curves
from benchmarks.methods import peer_methods, right_hand_side
from benchmarks.searches import OPTIMISERS, reference_searches
from commonrail.bench.machine import version
from commonrail.bench.record import TABLES, Columns, Make, column, number, tabulated, words
from commonrail.bench.run import Stage, effort, run_bench, stages
from commonrail.cli.bench import MEASURING, show, told
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.guard import guarded
from commonrail.cli.output import check_file
from commonrail.cli.progress import Bar
from commonrail.engine.simulate import usable_threads

__all__ = ["main", "missing_peers", "planned"]

EXTRA = "pip install 'commonrail[bench]'"
PACKAGES = {"sksundae": "SUNDIALS CVODE (scikit-sundae)", "pymoo": "pymoo", "cma": "pycma"}
DISTRIBUTIONS = ("scikit-sundae", "pymoo", "cma")


def missing_peers(found: Callable[[str], object | None] = find_spec) -> list[dict[str, str]]:
    """Peers that are not installed, and how to install them."""
    return [{"peer": name, "install": EXTRA} for module, name in PACKAGES.items() if found(module) is None]


def planned(quick: bool) -> list[Stage]:
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
    return tabulated(title, columns, 0)


ALL_TABLES: dict[str, Make] = TABLES | {
    "extrapolated": tabulated(
        "The same by scalar solvers on one core: EXTRAPOLATED from the simulations measured", _EXTRAPOLATED
    ),
    "points": _curve("Operating points", "points"),
    "horizon": _curve("Horizon ms", "horizon", 1e3),
    "threads": _curve("Threads", "threads"),
    "candidates": tabulated("Candidates", _CANDIDATES, 0),
}


@verb
@guarded()
def main(
    record: Annotated[Path, Argument(metavar="RECORD.json", help="File for the record.")],
    quick: Annotated[bool, Option("--quick", help="Shorter timings and fewer rows.")] = False,
) -> None:
    """Measure commonrail beside other solvers and optimisers, and its cost curves."""
    check_file(record, "RECORD.json")
    with Bar(MEASURING) as bar:
        options = {"peers": True, "curves": True, "quick": quick}
        found = run_bench(planned(quick), told(bar), options=options, missing=missing_peers())
    found["machine"]["versions"] |= {name: known for name in DISTRIBUTIONS if (known := version(name))}
    show(found, record, False, ALL_TABLES)


if __name__ == "__main__":
    main()
