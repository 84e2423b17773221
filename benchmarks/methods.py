"""One simulation by other people's solvers, each at two resolutions, and the cost of the right-hand side they call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

import numpy as np

from benchmarks.solvers import CvodeModel, PeerModel, ScipyMethod, ScipyModel, solve_with
from commonrail.bench.case import INTERVAL, POINT, injector
from commonrail.bench.methods import COARSE, MEDIUM, Counted, Method
from commonrail.bench.timing import CLOCKS, Clocks, Effort, time_best
from commonrail.engine.reference import Resolution

__all__ = ["peer_methods", "right_hand_side"]


def peer_methods() -> list[Method]:
    """SciPy's solvers and CVODE, each at two resolutions."""
    made = [
        _peer(f"SciPy {name}", "SciPy", "scipy", ScipyModel, resolution, name)
        for name in get_args(ScipyMethod)
        for resolution in (COARSE, MEDIUM)
    ]
    sundials = [
        _peer("SUNDIALS CVODE", "SUNDIALS", "sksundae", CvodeModel, resolution) for resolution in (COARSE, MEDIUM)
    ]
    return made + sundials


def right_hand_side(clocks: Clocks = CLOCKS) -> list[dict[str, float]]:
    """Time of one evaluation at each of the peers' resolutions: compiled, and called back from Python [s].

    A method's evaluations times the first are what it could not go below, were its solver all machine code.
    """
    found = []
    for resolution in (COARSE, MEDIUM):
        model = ScipyModel(injector(), POINT, resolution)
        y, dy = model.start.copy(), np.empty_like(model.start)
        arguments = (y, model.outside, model.constants, model.cells, model.friction, dy)
        compiled = getattr(model.rates, "compiled", model.rates)
        bare = _each(lambda k=compiled, a=arguments: k(*a), clocks)  # type: ignore[misc]
        called_back = _each(lambda m=model, y=y: m.slopes(0.0, y), clocks)  # type: ignore[misc]
        cells = float(resolution.cells[0])
        found.append({"cells": cells, "compiled_seconds": bare, "from_python_seconds": called_back})
    return found


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
