"""The paper's whole calibration by an optimiser, timed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from commonrail.bench.case import paper_study
from commonrail.calibration.run import calibrate
from commonrail.calibration.study import Study

__all__ = ["OWN", "Optimiser", "Searched", "measure_search"]


class Searched(NamedTuple):
    """Time of a search, of which of its simulations (None: not measured) [s]; simulations, J of the best feasible."""

    seconds: float
    simulating_seconds: float | None
    simulations: int
    best: float


class Optimiser(NamedTuple):
    """An optimiser: its package and module, how it keeps to the ordering (14), (15), and how it runs a study."""

    name: str
    package: str
    module: str
    ordering: str
    run: Callable[[Study], Searched]


def measure_search(optimiser: Optimiser, seed: int) -> dict[str, Any]:
    """Row of one search with one seed, after a short one that loads what it needs; J is None where it is not finite."""
    optimiser.run(paper_study(seed, generations=1))
    found = optimiser.run(paper_study(seed))
    return {
        "optimiser": optimiser.name,
        "package": optimiser.package,
        "ordering": optimiser.ordering,
        "seed": seed,
        "seconds": found.seconds,
        "simulating_seconds": found.simulating_seconds,
        "simulations": found.simulations,
        "J": found.best if np.isfinite(found.best) else None,
        "extrapolated": False,
    }


def _calibrate(study: Study) -> Searched:
    found = calibrate(study)
    if found.status == "interrupted":
        raise KeyboardInterrupt
    return Searched(found.seconds, None, found.simulations, found.cost)


OWN = Optimiser("differential evolution of the paper", "commonrail", "commonrail", "repair", _calibrate)
