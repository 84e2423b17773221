"""The whole benchmark: stage by stage into one record, which is complete as far as it got when it is stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib.util import find_spec
from typing import Any, NamedTuple

from commonrail.bench import curves
from commonrail.bench.accuracy import find_truth
from commonrail.bench.case import CASE, injector
from commonrail.bench.machine import busy, load, machine
from commonrail.bench.methods import measure_methods, own_methods, peer_methods, right_hand_side
from commonrail.bench.searches import OPTIMISERS, measure_search, reference_searches
from commonrail.bench.throughput import COUNTS, TIME_STEPS, measure_throughput
from commonrail.bench.timing import Effort
from commonrail.choices import Precision
from commonrail.engine.simulate import usable_threads

__all__ = ["EXTRA", "PACKAGES", "Options", "Stage", "missing_peers", "run_bench", "stages"]

EXTRA = "pip install 'commonrail[bench]'"
PACKAGES = {"sksundae": "SUNDIALS CVODE (scikit-sundae)", "pymoo": "pymoo", "cma": "pycma"}
SEEDS = (1, 2, 3, 4, 5)
LOAD_NOTE = (
    "The machine was busy with other work (a load of {load:.1f} or more on {threads} threads): "
    "times are too long, and ratios of them uncertain."
)


class Options(NamedTuple):
    """What is wanted beyond commonrail's own methods."""

    peers: bool = False
    curves: bool = False
    quick: bool = False

    @property
    def effort(self) -> Effort:
        """How long each timing goes on."""
        return Effort(3, 0.3) if self.quick else Effort(100, 2.0)


class Stage(NamedTuple):
    """A list of rows in the record, what is being measured, how many rows there will be, and their source."""

    key: str
    title: str
    rows: int
    measure: Callable[[], Iterator[dict[str, Any]]]


def missing_peers(found: Callable[[str], object | None] = find_spec) -> list[dict[str, str]]:
    """Peers that are not installed, and how to install them."""
    return [{"peer": name, "install": EXTRA} for module, name in PACKAGES.items() if found(module) is None]


def run_bench(
    options: Options,
    tell: Callable[[str, int, int], None] | None = None,
    planned: Callable[[Options], list[Stage]] | None = None,
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    options : Options
    tell : function of (title, rows done, rows in all), optional
        Told after every row.
    planned : function, optional
        Other stages.

    Returns
    -------
    dict
        The record, JSON-able; its status is "interrupted" if Ctrl-C ended it, and holds what was measured until then.
    """
    threads, before = usable_threads(), load()
    others = before or 0.0  # greatest load that is not the benchmark's own
    record: dict[str, Any] = {
        "schema": 1,
        "kind": "bench",
        "status": "finished",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "options": options._asdict(),
        "case": CASE,
        "synthetic": f"SYNTHETIC: {injector().synthetic} The curve of the searches is the virtual test bench's.",
        "timing": "wall time, the shortest of several runs after one that is not counted; processor time beside it",
        "machine": machine(),
        "missing": missing_peers() if options.peers else [],
    }
    try:
        for stage in (planned or stages)(options):
            rows = record.setdefault(stage.key, [])
            if tell:
                tell(stage.title, 0, stage.rows)
            for row in stage.measure():
                rows.append(row)
                others = max(others, (load() or 0.0) - threads)
                if tell:
                    tell(stage.title, len(rows), stage.rows)
    except KeyboardInterrupt:
        record["status"] = "interrupted"
    record["load"] = {"before": before, "after": load(), "others_at_least": others}
    record["notes"] = [LOAD_NOTE.format(load=others, threads=threads)] if busy(others, threads) else []
    return record


def stages(options: Options) -> list[Stage]:
    """What is measured, in order."""
    present = {module for module in PACKAGES if find_spec(module) is not None} | {"commonrail", "scipy", ""}
    methods = own_methods(options.quick)
    if options.peers:
        methods += [m for m in peer_methods() if m.needs in present]
    optimisers = [o for o in OPTIMISERS if o.module in present and (options.peers or o.module == "commonrail")]
    seeds = SEEDS[:1] if options.quick else SEEDS
    effort = options.effort
    truths: list[dict[str, Any]] = []

    def judged() -> Iterator[dict[str, Any]]:
        truth = find_truth()
        truths.append(truth.record())
        yield from measure_methods(methods, truth, effort)

    populations = len(Precision) * len(TIME_STEPS) * len(COUNTS) * len({1, usable_threads()})
    planned = [
        Stage("methods", "one simulation by every method", len(methods), judged),
        Stage("truth", "the reference they are judged by", 1, lambda: iter(truths)),
        Stage("throughput", "populations", populations, lambda: measure_throughput(effort)),
        Stage(
            "searches",
            "the paper's calibration",
            len(optimisers) * len(seeds),
            lambda: (measure_search(o, seed, None) for seed in seeds for o in optimisers),
        ),
    ]
    if options.peers:
        planned += [
            Stage("right_hand_side", "the right-hand side", 2, lambda: iter(right_hand_side())),
            Stage("extrapolated", "searches by scalar solvers, a part of them", 3, reference_searches),
        ]
    return planned + (_curves(options.quick, effort) if options.curves else [])


def _curves(quick: bool, effort: Effort) -> list[Stage]:
    counts = curves.CANDIDATES[:4] if quick else curves.CANDIDATES
    points, horizons = (curves.POINTS[:3], curves.HORIZONS[:3]) if quick else (curves.POINTS, curves.HORIZONS)
    threads = usable_threads()
    return [
        Stage("points", "operating points", len(points), lambda: curves.point_curve(points, effort)),
        Stage("horizon", "horizons", len(horizons), lambda: curves.horizon_curve(horizons, effort)),
        Stage("threads", "threads", threads.bit_length(), lambda: curves.thread_curve(threads, effort)),
        Stage("candidates", "candidates and memory", len(counts), lambda: curves.population_curve(counts, effort)),
    ]
