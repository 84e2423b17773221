"""How many candidates a second the lanes simulate, on one core and on all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from commonrail.bench.case import POINT, candidates, injector
from commonrail.bench.timing import CLOCKS, Clocks, Effort, time_best
from commonrail.engine.simulate import simulate_batch, usable_threads
from commonrail.reproduction import paper

__all__ = ["COUNTS", "PRECISIONS", "measure_throughput"]

COUNTS = (512, 50, 1, 7)  # full lanes; the paper's population; one; one of its seven stiffnesses each
# By name, what `simulate_batch` is given in addition: another precision is another entry.
PRECISIONS: dict[str, dict[str, Any]] = {"f64": {}, "f32": {"precision": "f32"}}


def measure_throughput(effort: Effort, clocks: Clocks = CLOCKS) -> Iterator[dict[str, Any]]:
    """Time populations at one operating point, every candidate over the whole horizon.

    Yields
    ------
    dict
        candidates, threads, precision, seconds, cpu_seconds, runs, per_second (candidates).
    """
    for precision, options in PRECISIONS.items():
        for count in COUNTS:
            for threads in sorted({1, usable_threads()}):
                yield _measure(count, threads, precision, options, effort, clocks)


def _measure(
    count: int, threads: int, precision: str, options: dict[str, Any], effort: Effort, clocks: Clocks
) -> dict[str, Any]:
    values = candidates(count)

    def run() -> None:
        simulate_batch(injector(), [POINT], paper.NAMES, values, threads=threads, stop_when_closed=False, **options)

    run()
    timing = time_best(run, effort, clocks)
    return {
        "candidates": count,
        "threads": threads,
        "precision": precision,
        **timing._asdict(),
        "per_second": count / timing.seconds,
    }
