"""Candidates per second that the lanes simulate, on one core and on all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmarks.accuracy import lane_errors
from benchmarks.case import LONG_STEP, POINT, TIME_STEP, candidates, injector
from benchmarks.timing import CLOCKS, Clocks, Effort, time_best
from commonrail.base.choices import Precision
from commonrail.engine import plan
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.threads import usable_threads
from commonrail.plugins.paper import study

COUNTS = (512, 50, 1, 7)  # full lanes; the paper's population; one; one of its seven stiffnesses each
TIME_STEPS = (TIME_STEP, LONG_STEP)
JUDGED = 8  # candidates whose error is looked at


def measure_throughput(effort: Effort, clocks: Clocks = CLOCKS, judged: int = JUDGED) -> Iterator[dict[str, Any]]:
    """Time populations at one operating point, every candidate over the whole horizon.

    What does not depend on the candidates is prepared once, as it is for the generations of a search. The error of
    `judged` candidates is looked at. Each item has candidates, threads, precision, time_step, seconds, cpu_seconds,
    runs, per_second (candidates), L1_percent of the case, and worst_L1_percent of it and of the judged candidates.
    """
    for precision in Precision:
        for step in TIME_STEPS:
            errors = [error.L1_percent for error in lane_errors(step, precision, judged)]
            accuracy = {"L1_percent": errors[0], "worst_L1_percent": max(errors)}
            for count in COUNTS:
                for threads in sorted({1, usable_threads()}):
                    row = _measure(count, threads, step, precision, effort, clocks)
                    yield {"precision": precision.value, **row, **accuracy}


def _measure(
    count: int, threads: int, step: float, precision: Precision, effort: Effort, clocks: Clocks
) -> dict[str, Any]:
    values = candidates(count)
    prepared = plan.prepare(injector(), [POINT], step)

    def run() -> None:
        simulate_batch(
            injector(),
            [POINT],
            study.NAMES,
            values,
            time_step=step,
            threads=threads,
            stop_when_closed=False,
            precision=precision,
            prepared=prepared,
        )

    run()
    timing = time_best(run, effort, clocks)
    return {
        "candidates": count,
        "threads": threads,
        "time_step": step,
        **timing._asdict(),
        "per_second": count / timing.seconds,
    }
