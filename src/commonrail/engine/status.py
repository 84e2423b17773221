"""Status of a simulation, whose sentence says what to do."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.arrays import Bools


class Status(IntEnum):
    """Outcome of one simulation. What `failed` costs +inf in a study; so does a needle still open in a quantity map."""

    OK = 0
    NOT_CLOSED_AT_START = 1
    STEP_UNSTABLE = 2
    RAN_AWAY = 3
    NOT_FINITE = 4
    STILL_INJECTING = 5
    OUTSIDE_DOMAIN = 6
    CONDITION_NOT_MET = 7  # of a study; no simulation by itself ends so

    @property
    def sentence(self) -> str:
        """Event and cure in one sentence."""
        return _SENTENCES[self]

    @property
    def failed(self) -> bool:
        """Return whether the figures must not be used."""
        return self not in (Status.OK, Status.STILL_INJECTING)


_SENTENCES = {
    Status.OK: "The simulation ended well.",
    Status.NOT_CLOSED_AT_START: (
        "Needle or valve does not rest on its seat before energising: the opening forces exceed the closing ones; "
        "check plunger, guide and seat diameters and the springs of needle and valve."
    ),
    Status.STEP_UNSTABLE: (
        "The time step is too long for the stiffest spring of the plunger-needle, for the valve on its seat or for the "
        "travel time of a pipe; take a shorter time step or narrow the bounds."
    ),
    Status.RAN_AWAY: "The plunger-needle passed its seat or stop; check the stop's stiffness and the pressure areas.",
    Status.NOT_FINITE: "A pressure or mass left the range of the model; take a shorter time step or narrow the bounds.",
    Status.OUTSIDE_DOMAIN: (
        "A parameter is not finite or lies outside its domain, such as a length that is not positive; narrow the "
        "bounds (`commonrail catalogue parameters` lists the domains)."
    ),
    Status.CONDITION_NOT_MET: (
        "The injector does not behave as a condition of the study wants it; check the start values at that operating "
        "point, or correct the condition."
    ),
    Status.STILL_INJECTING: "The needle had not closed at the end of the simulated time; take a longer horizon.",
}


OK, STILL_INJECTING = int(Status.OK), int(Status.STILL_INJECTING)  # NumPy takes five times as long for an enum


def which_failed(statuses: NDArray[np.integer[Any]]) -> Bools:
    """`Status.failed` of many."""
    return np.asarray((statuses != OK) & (statuses != STILL_INJECTING))
