"""One simulation by each of commonrail's own methods: time, and errors against the tight reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from commonrail.bench.accuracy import Truth, errors
from commonrail.bench.case import INTERVAL, POINT, candidates, injector
from commonrail.bench.timing import CLOCKS, Clocks, Effort, time_best
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.solution import Solution
from commonrail.reproduction import paper

__all__ = ["COARSE", "LANES", "MEDIUM", "Counted", "Method", "measure_methods", "own_methods"]

LANES = "lanes"  # family of what the ratios are taken to
FULL = 512  # candidates that fill the lanes of one core
COARSE = Resolution((60, 30), 1e-4)
MEDIUM = Resolution((120, 60), 1e-5)


class Counted(NamedTuple):
    """A simulation and how often it evaluated the right-hand side; 0 where evaluations are not counted."""

    solution: Solution
    evaluations: int


class Method(NamedTuple):
    """A way to simulate the case.

    Attributes
    ----------
    name, family : str
    run : function
        Simulates, and counts evaluations.
    timed : function, optional
        What is timed in place of `run`.
    simulations : int
        That `timed` makes.
    needs : str
        Module that must be installed.
    """

    name: str
    family: str
    run: Callable[[], Counted]
    timed: Callable[[], Any] | None = None
    simulations: int = 1
    needs: str = ""


def own_methods(quick: bool) -> list[Method]:
    """The lanes, alone and in company, the explicit march, and the reference with LSODA."""
    resolutions = [COARSE._replace(method="explicit", step=1e-7), MEDIUM]
    if not quick:
        resolutions += [Resolution(method="explicit"), Resolution()]
    steps = (1e-6, 1.5e-6, 0.5e-6)
    return [
        *(_full_lanes(step) for step in steps),
        *(_lanes(step) for step in steps),
        *(_reference(resolution) for resolution in resolutions),
    ]


def measure_methods(
    methods: list[Method], truth: Truth, effort: Effort, clocks: Clocks = CLOCKS
) -> Iterator[dict[str, Any]]:
    """Measure methods one by one.

    Parameters
    ----------
    methods : list of Method
        The first is what the others' times are compared with.
    truth : Truth
    effort : Effort
        Length of each timing.
    clocks : Clocks

    Yields
    ------
    dict
        method, family, seconds and cpu_seconds for one simulation, runs, evaluations, status, L1_percent,
        volume_percent, and times_the_first.
    """
    first = None
    for method in methods:
        solution, evaluations = method.run()  # loads or compiles what it needs
        if method.timed is not None:
            method.timed()
        timing = time_best(method.timed or method.run, effort, clocks)
        seconds = timing.seconds / method.simulations
        first = first or seconds
        yield {
            "method": method.name,
            "family": method.family,
            "seconds": seconds,
            "cpu_seconds": timing.cpu_seconds / method.simulations,
            "runs": timing.runs,
            "evaluations": evaluations,
            "status": solution.status.name,
            **_finite(errors(solution, truth.solution)._asdict()),
            "times_the_first": seconds / first,
        }


def _finite(figures: dict[str, float]) -> dict[str, float | None]:
    return {name: value if np.isfinite(value) else None for name, value in figures.items()}


def _lanes(step: float) -> Method:
    interval = step * max(round(INTERVAL / step), 1)  # whole numbers of steps, some 3 us

    def run() -> Counted:
        return Counted(simulate(injector(), POINT, time_step=step, sample_interval=interval), 0)

    return Method(f"lanes, {step * 1e6:g} us, one simulation alone with its whole course", LANES, run)


def _full_lanes(step: float) -> Method:
    values = candidates(FULL)

    def batch() -> None:
        simulate_batch(injector(), [POINT], paper.NAMES, values, time_step=step, threads=1, stop_when_closed=False)

    name = f"lanes, {step * 1e6:g} us, one of {FULL} on one core"
    return _lanes(step)._replace(name=name, timed=batch, simulations=FULL)


def _reference(resolution: Resolution) -> Method:
    name = f"explicit RK4, steps of {resolution.step * 1e9:g} ns, {resolution.cells[0]} cells"
    if resolution.method == "lsoda":
        name = f"reference (LSODA), rtol {resolution.relative:g}, {resolution.cells[0]} cells"
    return Method(name, "reference", lambda: Counted(simulate_reference(injector(), POINT, INTERVAL, resolution), 0))
