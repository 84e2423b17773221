"""Errors of a simulation against a much finer one."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from benchmarks.case import INTERVAL, POINT, candidates, injector
from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import Solution
from commonrail.plugins.paper import study

TIGHT = Resolution((480, 240), 1e-9)
CHECK = Resolution((480, 240), method="explicit", step=2.5e-8)  # as fine, by another scheme


class Errors(NamedTuple):
    """Σ |rate − true rate| / Σ |true rate|, and injected volume / true volume − 1, both in per cent."""

    L1_percent: float
    volume_percent: float


class Truth(NamedTuple):
    """The tight reference, and how far a scheme of another kind is from it: what smaller errors mean nothing."""

    solution: Solution
    floor: Errors

    def record(self) -> dict[str, Any]:
        """For the record."""
        return {
            "method": f"LSODA, {TIGHT.cells[0]} + {TIGHT.cells[1]} cells, rtol {TIGHT.relative:g}",
            "checked_by": f"explicit Runge-Kutta of order 4, the same cells, steps of {CHECK.step * 1e9:g} ns",
            "check": self.floor._asdict(),
        }


def errors(solution: Solution, truth: Solution) -> Errors:
    """Errors of the rate and of the volume; ConfigurationError if the two are one or are sampled at different times."""
    if solution is truth:
        raise ConfigurationError("A simulation cannot be judged by itself.")
    if len(solution.time) != len(truth.time) or not np.allclose(solution.time, truth.time, rtol=0.0, atol=1e-12):
        raise ConfigurationError("Two simulations can only be compared at the same times.")
    level = float(np.sum(np.abs(truth.mass_rate)))
    deviation = float(np.sum(np.abs(solution.mass_rate - truth.mass_rate)))
    return Errors(100.0 * deviation / level, 100.0 * (solution.injected_mass / truth.injected_mass - 1.0))


def find_truth() -> Truth:
    """Simulate the tight reference (some seconds) and check it."""
    tight = simulate_reference(injector(), POINT, INTERVAL, TIGHT)
    return Truth(tight, errors(simulate_reference(injector(), POINT, INTERVAL, CHECK), tight))


def lane_errors(time_step: float, precision: Precision, others: int) -> list[Errors]:
    """Errors of the lanes: of the case, then of the first `others` candidates of the benchmark's population.

    Each is judged by the explicit scheme at its usual resolution; samples are about 3 us long, whole numbers of steps
    of `time_step` [s].
    """
    interval = time_step * max(round(INTERVAL / time_step), 1)
    results = []
    for values in [{}, *(dict(zip(study.NAMES, row, strict=True)) for row in candidates(others))]:
        candidate = injector().with_values(values)
        lanes = simulate(candidate, POINT, time_step=time_step, sample_interval=interval, precision=precision)
        results.append(errors(lanes, simulate_reference(candidate, POINT, interval, Resolution(method="explicit"))))
    return results
