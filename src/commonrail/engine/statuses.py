"""Statuses of simulations, from what the compiled loop has noted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from commonrail.engine import plan
from commonrail.engine.notes import Outcome
from commonrail.engine.plan import Prepared
from commonrail.engine.stability import too_long
from commonrail.engine.status import OK, STILL_INJECTING, Status

__all__ = ["statuses_of"]

Floats = NDArray[np.float64]

BACKFLOW = 1e-7  # largest mass that a SAC takes back from the cylinder [kg]; more is an injector that has run empty


def statuses_of(names: Sequence[str], theta: Floats, prepared: Prepared, outcome: Outcome) -> NDArray[np.int64]:
    """Status of each candidate at each operating point: (candidates, points).

    Parameters
    ----------
    names : sequence of str
        Parameters in which the candidates differ.
    theta : (candidates, parameters)
        Flat parameter vectors.
    prepared : Prepared
        Injector, operating points and step.
    outcome : Outcome
        Notes of the run.
    """

    def table(figures: Floats) -> Floats:
        return plan.by_candidate(figures, len(theta), len(prepared.points))

    status = np.full((len(theta), len(prepared.points)), OK)
    status[table(outcome.closed_at_end) == 0.0] = STILL_INJECTING
    bad = table(outcome.sound) == 0.0
    if bad.any():
        finite = np.isfinite(table(outcome.injected))
        status[bad] = np.where(finite[bad], Status.RAN_AWAY, Status.NOT_FINITE)
    status[table(outcome.injected) < -BACKFLOW] = Status.NOT_FINITE
    # whatever came out: beyond the limit, at the greatest lift that was reached, a plausible figure may be far off
    lifts = np.nan_to_num(table(outcome.greatest_lift)).max(axis=1)
    status[too_long(prepared.injector, names, theta, prepared.medium, prepared.dt, lifts)] = Status.STEP_UNSTABLE
    status[table(outcome.closed_at_start) == 0.0] = Status.NOT_CLOSED_AT_START
    return status
