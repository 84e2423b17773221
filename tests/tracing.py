"""Every row that the lanes keep, by name: what the tests of the physics look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import OperatingPoint
from commonrail.injector.definition import Injector

Floats = NDArray[np.float64]


def traced(injector: Injector, point: OperatingPoint, dt: float = 1e-6) -> dict[str, Floats]:
    """State after every step (steps + 1,) by dotted name, the leaving waves, and "time" [s]."""
    theta = plan.candidate_matrix(injector, (), np.empty((1, 0)))
    job = plan.make_job(injector, theta, [point], dt, False)
    _, trace = lanes.run_traced(job, injector.variant)
    rows = dict(zip(lanes.trace_paths(injector.variant), trace[0, :, :, 0].T.copy(), strict=True))
    return rows | {"time": point.start + dt * np.arange(trace.shape[1])}


def sampled(mass: Floats, dt: float, interval: float) -> Floats:
    """Mean flow between bounds `interval` apart, from the mass after every step."""
    return np.asarray(np.diff(mass[:: round(interval / dt)]) / interval)
