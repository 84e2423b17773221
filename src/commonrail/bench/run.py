"""The benchmark: stage by stage into one record, which is complete as far as it got when it is stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple

from commonrail.bench.accuracy import find_truth
from commonrail.bench.case import CASE, injector
from commonrail.bench.machine import busy, load, machine
from commonrail.bench.methods import Method, measure_methods, own_methods
from commonrail.bench.searches import OWN, Optimiser, measure_search
from commonrail.bench.throughput import COUNTS, TIME_STEPS, measure_throughput
from commonrail.bench.timing import Effort
from commonrail.choices import Precision
from commonrail.engine.simulate import usable_threads

__all__ = ["Stage", "effort", "run_bench", "stages"]

SEEDS = (1, 2, 3, 4, 5)
LOAD_NOTE = (
    "The machine was busy with other work (a load of {load:.1f} or more on {threads} threads): "
    "times are too long, and ratios of them uncertain."
)


class Stage(NamedTuple):
    """A list of rows in the record, what is being measured, how many rows there will be, and their source."""

    key: str
    title: str
    rows: int
    measure: Callable[[], Iterator[dict[str, Any]]]


def effort(quick: bool) -> Effort:
    """Length of each timing."""
    return Effort(3, 0.3) if quick else Effort(100, 2.0)


def run_bench(
    planned: Sequence[Stage],
    tell: Callable[[str, int, int], None] | None = None,
    *,
    options: dict[str, bool],
    missing: Sequence[dict[str, str]] = (),
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    planned : sequence of Stage
    tell : function of (title, rows done, rows in all), optional
        Told after every row.
    options : dict
        Kept in the record.
    missing : sequence of dict
        What was not installed ("peer") and how to install it ("install").

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
        "options": options,
        "case": CASE,
        "synthetic": f"SYNTHETIC: {injector().synthetic} The curve of the searches is the virtual test bench's.",
        "timing": "wall time, the shortest of several runs after one that is not counted; processor time beside it",
        "machine": machine(),
        "missing": list(missing),
    }
    try:
        for stage in planned:
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


def stages(quick: bool, methods: Sequence[Method] = (), optimisers: Sequence[Optimiser] = ()) -> list[Stage]:
    """Stages of commonrail's own methods, in order.

    Parameters
    ----------
    quick : bool
        Shorter timings and fewer rows.
    methods, optimisers : sequence, optional
        Others to be measured behind them.
    """
    methods = [*own_methods(quick), *methods]
    optimisers = [OWN, *optimisers]
    seeds = SEEDS[:1] if quick else SEEDS
    truths: list[dict[str, Any]] = []

    def judged() -> Iterator[dict[str, Any]]:
        truth = find_truth()
        truths.append(truth.record())
        yield from measure_methods(methods, truth, effort(quick))

    populations = len(Precision) * len(TIME_STEPS) * len(COUNTS) * len({1, usable_threads()})
    return [
        Stage("methods", "one simulation by every method", len(methods), judged),
        Stage("truth", "the reference they are judged by", 1, lambda: iter(truths)),
        Stage("throughput", "populations", populations, lambda: measure_throughput(effort(quick))),
        Stage(
            "searches",
            "the paper's calibration",
            len(optimisers) * len(seeds),
            lambda: (measure_search(o, seed) for seed in seeds for o in optimisers),
        ),
    ]
