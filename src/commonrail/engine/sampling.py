"""Sampled rates of several candidates, from traced runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.population import candidate_matrix
from commonrail.injector.definition import Injector

Floats = NDArray[np.float64]


def sampled_rates(
    injector: Injector,
    point: OperatingPoint,
    bounds: Floats,
    names: Sequence[str],
    values: Floats,
    time_step: float,
    *,
    prepared: plan.Prepared | None = None,
    same_bits: bool = False,
) -> Floats:
    """Mean mass flow between time bounds [s] for each candidate: (candidates, bounds − 1) [kg/s].

    Rows of failed simulations hold values that are not finite.

    Parameters
    ----------
    injector, point, names, values, time_step, same_bits
        As in `simulate_batch`.
    bounds : (n,)
        [s].
    prepared : Prepared, optional
        Of the injector at this point and time step, known already.
    """
    theta = candidate_matrix(injector, names, values)
    job = plan.make_job(prepared or plan.prepare(injector, [point], time_step), theta, False)
    outcome, trace = lanes.run(job, injector.wired(names), traced=True, injected_only=True, same_bits=same_bits)
    injected = np.moveaxis(trace[:, :, 0, :], 1, 2).reshape(-1, trace.shape[1])[: len(theta)]
    time = point.start + time_step * np.arange(trace.shape[1])
    masses = np.array([np.interp(bounds, time, mass) for mass in injected])
    rates = np.diff(masses, axis=1) / np.diff(bounds)
    sound = plan.by_candidate(outcome.sound * outcome.closed_at_start, len(theta), 1)[:, 0] > 0.0
    return np.where(sound[:, None], rates, np.nan)
