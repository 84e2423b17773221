"""Figures of a program outside the project, and how near both engines come to them.

The program (SciPy LSODA, method of lines) was written before this project and shares no line with it; it has fuel
polynomials of its own and holds its memory of the discharge coefficient through a bounce. Limits tighter than these
would judge that program.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from commonrail.analysis.closed_forms import Check, check
from commonrail.arrays import Floats
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import Solution
from commonrail.injector.definition import Injector

INTERVAL = 3e-6  # of its samples [s]
SHORT = 399e-6  # longest energising time of what counts as a short injection [s]
# Of volume and rate [%], of a short and of a longer injection, and of the opening [us].
VOLUME, RATE, OPENING = (0.3, 0.1), (1.0, 0.4), 0.3


@dataclass(frozen=True)
class Run:
    """One injection by the program outside.

    Attributes
    ----------
    injector : Injector
    point : OperatingPoint
        With one energising; its horizon is that of the rate.
    volume : float
        Injected [m³].
    opening : float
        Instant at which the tip passes 5 um [s].
    rate : (samples,) or None
        Means over `INTERVAL` each [m³/s], where they are known.
    """

    injector: Injector
    point: OperatingPoint
    volume: float
    opening: float
    rate: Floats | None

    @property
    def short(self) -> bool:
        """True where the limits of short injections hold."""
        return self.point.pulses[0].duration <= SHORT


class Gaps(NamedTuple):
    """An engine less the program outside: volume and L1 of the rate [%], opening [us]; no L1 without a rate."""

    volume: float
    rate: float | None
    opening: float


def by_lanes(run: Run) -> Gaps:
    """Gaps of the fast engine at its default step."""
    return gaps(run, simulate(run.injector, run.point, sample_interval=INTERVAL))


def by_reference(run: Run) -> Gaps:
    """Gaps of the reference, marched explicitly."""
    return gaps(run, simulate_reference(run.injector, run.point, INTERVAL, Resolution(method="explicit")))


ENGINES: dict[str, Callable[[Run], Gaps]] = {"lanes": by_lanes, "reference": by_reference}


def gaps(run: Run, solution: Solution) -> Gaps:
    """Distances of a solution from a run; NaN where it has failed."""
    sound = math.nan if solution.status.failed else 1.0
    rate = None
    if run.rate is not None:
        rate = sound * 100.0 * float(np.sum(np.abs(solution.rate - run.rate)) / np.sum(np.abs(run.rate)))
    volume, opening = solution.injected_volume / run.volume - 1.0, solution.opening - run.opening
    return Gaps(sound * 100.0 * volume, rate, sound * 1e6 * opening)


def against_outside(runs: Sequence[Run], pool: Executor) -> list[Check]:
    """Largest gaps of both engines, simulated by a pool of processes."""
    return [
        one for engine, simulated in ENGINES.items() for one in judged(engine, runs, list(pool.map(simulated, runs)))
    ]


def judged(engine: str, runs: Sequence[Run], found: Sequence[Gaps]) -> Iterator[Check]:
    """Checks of the gaps of one engine.

    Parameters
    ----------
    engine : str
        Its name.
    runs, found : sequence
        Runs, and the gaps of each.
    """
    for short, what in ((False, "from 400 us"), (True, "short injections")):
        members = [one for run, one in zip(runs, found, strict=True) if run.short is short]
        rates = [one.rate for one in members if one.rate is not None]
        yield _worst(f"{engine}, volume, {what}", [one.volume for one in members], VOLUME[not short], "%")
        yield _worst(f"{engine}, rate, L1, {what}", rates, RATE[not short], "%")
    yield _worst(f"{engine}, opening", [one.opening for one in found], OPENING, "us")


def _worst(name: str, values: Sequence[float], limit: float, unit: str) -> Check:
    size = np.abs(values)
    detail = f"{len(size)} runs of a program outside the project, median {np.median(size):.2g} {unit}"
    return check(f"another program's figures: {name}", float(np.max(size)), limit, unit, detail)
