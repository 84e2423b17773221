"""Growth of time and memory with candidates, operating points, horizon and threads."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmarks.case import POINT, candidates, injector
from benchmarks.timing import CLOCKS, Clocks, Effort, time_best
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.threads import usable_threads
from commonrail.plugins.doctor.run import Runner, ask_child, run_child
from commonrail.plugins.paper import study

__all__ = ["CANDIDATES", "HORIZONS", "POINTS", "horizon_curve", "point_curve", "population_curve", "thread_curve"]

CANDIDATES = (1, 8, 64, 512, 4096, 32_768, 262_144, 1_000_000)
POINTS = (1, 2, 5, 10, 20, 30)
HORIZONS = (1.56e-3, 3e-3, 6e-3, 12e-3, 24e-3)  # [s]
FULL = 512  # candidates
MANY = 4096
LONGEST = 900.0  # what a population may take in its own process, compilation included [s]


def population_curve(counts: tuple[int, ...], effort: Effort, run: Runner = run_child) -> Iterator[dict[str, Any]]:
    """Time and greatest memory against candidates, each population in a process of its own.

    Each item has candidates, threads, seconds, runs, peak_bytes, before_bytes (of the same process before the
    population) and per_second; or candidates and failed, a sentence, where the process did not end well.
    """
    for count in counts:
        measurement = ask_child("benchmarks.probe", [str(count), str(effort.runs), str(effort.seconds)], LONGEST, run)
        yield {"candidates": count} | measurement


def point_curve(counts: tuple[int, ...], effort: Effort, clocks: Clocks = CLOCKS) -> Iterator[dict[str, Any]]:
    """Time against operating points, 40 to 180 MPa: points, candidates, threads, seconds, runs, per_second."""
    for count in counts:
        points = [
            OperatingPoint(40e6 + 140e6 * i / max(count - 1, 1), study.ENERGISING_TIME, horizon=POINT.horizon)
            for i in range(count)
        ]
        yield {"points": count, **_time_points(points, FULL, usable_threads(), effort, clocks)}


def horizon_curve(horizons: tuple[float, ...], effort: Effort, clocks: Clocks = CLOCKS) -> Iterator[dict[str, Any]]:
    """Time against the simulated horizon [s]: horizon, candidates, threads, seconds, runs, per_second."""
    for horizon in horizons:
        point = OperatingPoint(POINT.rail_pressure, study.ENERGISING_TIME, horizon=horizon)
        yield {"horizon": horizon, **_time_points([point], FULL, usable_threads(), effort, clocks)}


def thread_curve(most: int, effort: Effort, clocks: Clocks = CLOCKS) -> Iterator[dict[str, Any]]:
    """Time against threads, one to `most` in doublings: candidates, threads, seconds, runs, per_second."""
    counts = sorted({2**k for k in range(most.bit_length())} | {most})
    for threads in counts:
        yield _time_points([POINT], MANY, threads, effort, clocks)


def _time_points(
    points: list[OperatingPoint], count: int, threads: int, effort: Effort, clocks: Clocks
) -> dict[str, Any]:
    values = candidates(count)

    def run() -> None:
        simulate_batch(injector(), points, study.NAMES, values, threads=threads, stop_when_closed=False)

    run()
    timing = time_best(run, effort, clocks)
    return {
        "candidates": count,
        "threads": threads,
        "seconds": timing.seconds,
        "runs": timing.runs,
        "per_second": count * len(points) / timing.seconds,
    }
