"""One simulation by every method: its time, and its errors against the tight reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, get_args

import numpy as np

from benchmarks.accuracy import Truth, errors
from benchmarks.case import INTERVAL, POINT, candidates, injector
from benchmarks.solvers import Counted, CvodeModel, PeerModel, ScipyMethod, ScipyModel, solve_with
from benchmarks.timing import CLOCKS, Clocks, Effort, time_best
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.plugins.paper import study

LANES = "lanes"  # family of what the ratios are taken to
FULL = 512  # candidates that fill the lanes of one core
COARSE = Resolution((60, 30), 1e-4)
MEDIUM = Resolution((120, 60), 1e-5)


class Method(NamedTuple):
    """A way to simulate the case: `run` simulates and counts evaluations.

    `timed`, which makes so many simulations, is timed in place of `run`; `needs` is a module that must be installed.
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
        _alone(),
        *(_reference(resolution) for resolution in resolutions),
    ]


def measure_methods(
    methods: list[Method], truth: Truth, effort: Effort, clocks: Clocks = CLOCKS
) -> Iterator[dict[str, Any]]:
    """Measure methods one by one; the first is what the others' times are compared with.

    Each item has method, family, seconds and cpu_seconds for one simulation, runs, evaluations, status, L1_percent,
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
    interval = step * max(round(INTERVAL / step), 1)  # whole numbers of steps, about 3 us

    def run() -> Counted:
        return Counted(simulate(injector(), POINT, time_step=step, sample_interval=interval), 0)

    return Method(f"lanes, {step * 1e6:g} us, one simulation alone with its whole course", LANES, run)


def _full_lanes(step: float) -> Method:
    values = candidates(FULL)

    def batch() -> None:
        simulate_batch(injector(), [POINT], study.NAMES, values, time_step=step, threads=1, stop_when_closed=False)

    name = f"lanes, {step * 1e6:g} us, one of {FULL} on one core"
    return _lanes(step)._replace(name=name, timed=batch, simulations=FULL)


def _alone() -> Method:
    """One simulation alone for its figures, which ends with the injection; its errors are those of the whole course."""

    def figures() -> None:
        simulate_batch(injector(), [POINT], threads=1)

    return _lanes(1e-6)._replace(name="lanes, 1 us, one simulation alone for its figures", timed=figures)


def _reference(resolution: Resolution) -> Method:
    name = f"explicit RK4, steps of {resolution.step * 1e9:g} ns, {resolution.cells[0]} cells"
    if resolution.method == "lsoda":
        name = f"reference (LSODA), rtol {resolution.relative:g}, {resolution.cells[0]} cells"
    return Method(name, "reference", lambda: Counted(simulate_reference(injector(), POINT, INTERVAL, resolution), 0))


def peer_methods() -> list[Method]:
    """SciPy's solvers and CVODE, each at two resolutions."""
    methods = [
        _peer(f"SciPy {name}", "SciPy", "scipy", ScipyModel, resolution, name)
        for name in get_args(ScipyMethod)
        for resolution in (COARSE, MEDIUM)
    ]
    sundials = [
        _peer("SUNDIALS CVODE", "SUNDIALS", "sksundae", CvodeModel, resolution) for resolution in (COARSE, MEDIUM)
    ]
    return methods + sundials


def right_hand_side(clocks: Clocks = CLOCKS) -> list[dict[str, float]]:
    """Time of one evaluation at each of the peers' resolutions: compiled, and called back from Python [s].

    A method's evaluations times the first are what it could not go below, were its solver all machine code.
    """
    rows = []
    for resolution in (COARSE, MEDIUM):
        model = ScipyModel(injector(), POINT, resolution)
        y = model.start.copy()
        bare = _each(model.evaluate, clocks)
        called_back = _each(lambda m=model, y=y: m.slopes(0.0, y), clocks)  # type: ignore[misc]
        cells = float(resolution.cells[0])
        rows.append({"cells": cells, "compiled_seconds": bare, "from_python_seconds": called_back})
    return rows


def _each(action: Callable[[], Any], clocks: Clocks) -> float:
    many = range(2000)  # fewer in all than a simulation may take

    def run() -> None:
        for _ in many:
            action()

    run()
    return time_best(run, Effort(5, 1.0), clocks).seconds / len(many)


def _peer(
    name: str, family: str, needs: str, kind: Callable[..., PeerModel], resolution: Resolution, *options: str
) -> Method:
    def run() -> Counted:
        return solve_with(kind(injector(), POINT, resolution, *options), INTERVAL)

    return Method(f"{name}, rtol {resolution.relative:g}, {resolution.cells[0]} cells", family, run, needs=needs)
