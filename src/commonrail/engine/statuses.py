"""Statuses of simulations, from what the compiled loop has recorded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.arrays import Bools, Floats, Ints
from commonrail.engine.notes import Outcome
from commonrail.engine.plan import Prepared
from commonrail.engine.stability import Medium, medium_of, too_long
from commonrail.engine.status import OK, STILL_INJECTING, Status

BACKFLOW = 1e-7  # largest mass that a SAC takes back from the cylinder [kg]; more is an injector that has run empty


def statuses_of(names: Sequence[str], theta: Floats, prepared: Prepared, outcome: Outcome) -> Ints:
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
        Figures of the run.
    """
    status = np.full((len(theta), len(prepared.points)), OK)
    status[outcome.closed_at_end == 0.0] = STILL_INJECTING
    bad = outcome.sound == 0.0
    if bad.any():
        finite = np.isfinite(outcome.injected)
        status[bad] = np.where(finite[bad], Status.RAN_AWAY, Status.NOT_FINITE)
    status[outcome.injected < -BACKFLOW] = Status.NOT_FINITE
    # whatever came out: beyond the limit, at the greatest lift that was reached, a plausible figure may be far off
    status[_step_too_long(names, theta, prepared, np.nan_to_num(outcome.greatest_lift))] = Status.STEP_UNSTABLE
    status[outcome.closed_at_start == 0.0] = Status.NOT_CLOSED_AT_START
    return status


def _step_too_long(names: Sequence[str], theta: Floats, prepared: Prepared, lifts: Floats) -> Bools:
    """True for (candidates, points) whose step is too long at the point's own rail pressure and largest lift.

    Parameters
    ----------
    names, theta, prepared
        As in `statuses_of`.
    lifts : (candidates, points)
        [m].
    """
    injector, dt, points = prepared.injector, prepared.dt, lifts.shape[1]
    # fuel is stiffest at the largest pressure: what bears the step there, at its largest lift, bears it at every point
    found = np.repeat(too_long(injector, names, theta, prepared.medium, dt, lifts.max(axis=1))[:, None], points, axis=1)
    asked = np.flatnonzero(found[:, 0])
    if points > 1 and len(asked):
        modulus, speed, at_return = medium_of(injector, prepared.highest)
        medium = Medium(np.tile(modulus, len(asked)), np.tile(speed, len(asked)), at_return)
        rows = np.repeat(theta[asked], points, axis=0)
        found[asked] = too_long(injector, names, rows, medium, dt, lifts[asked].ravel()).reshape(-1, points)
    return found
