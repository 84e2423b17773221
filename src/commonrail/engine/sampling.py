"""Sampled rates of several candidates, from traced runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import candidate_matrix, statuses_of
from commonrail.engine.simulate import usable_threads
from commonrail.engine.status import which_failed
from commonrail.physics.injector import Injector


def sampled_rates(
    injector: Injector,
    point: OperatingPoint,
    bounds: Floats,
    names: Sequence[str],
    values: Floats,
    time_step: float,
    *,
    threads: int | None = None,
    prepared: plan.Prepared | None = None,
    same_bits: bool = False,
) -> Floats:
    """Mean mass flow between time bounds [s] for each candidate: (candidates, bounds − 1) [kg/s].

    Rows of failed simulations, those whose step is too long included, are NaN.

    `bounds` (n,): [s]; `prepared` (Prepared, optional): of the injector at this point and time step, known already;
    `injector`, `point`, `names`, `values`, `time_step`, `threads`, `same_bits`: as in `simulate_batch`.
    """
    prepared = prepared or plan.prepare(injector, [point], time_step)
    theta = candidate_matrix(injector, names, values, prepared.row)
    job = plan.make_job(prepared, theta, False)
    variant, many = injector.wired(names), threads or usable_threads()
    outcome, trace = lanes.run(job, variant, traced=True, threads=many, injected_only=True, same_bits=same_bits)
    injected = np.moveaxis(trace[:, :, 0, :], 1, 2).reshape(-1, trace.shape[1])[: len(theta)]
    time = point.start + time_step * np.arange(trace.shape[1])
    whole = np.array_equal(bounds, time)
    masses = injected if whole else np.array([np.interp(bounds, time, mass) for mass in injected])
    rates = np.diff(masses, axis=1) / np.diff(bounds)
    failed = which_failed(statuses_of(names, theta, prepared, outcome))[:, 0]
    return np.where(failed[:, None], np.nan, rates)
