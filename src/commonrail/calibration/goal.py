"""Goal of a search: the loss on the data, the priors of the parameters, and how candidates are screened."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from commonrail.calibration.conditions import Condition
from commonrail.calibration.prior import Priors

__all__ = ["PLAIN", "Goal", "Loss"]


class Loss(StrEnum):
    """Loss on the data that a search makes small."""

    KINDS = "kinds"
    """J that each kind of data defines: the paper's sum of |error| for a curve, the soft-L1 sum for a map."""

    SQUARES = "squares"
    """Sum of the squared residuals, for maps in units of their tolerances."""


class Goal(NamedTuple):
    """Rules of the objective besides the data.

    Attributes
    ----------
    loss : Loss
    priors : Priors
        Their squared residuals are added to the loss.
    conditions : tuple of Condition
        A candidate that does not meet one of them loses, whatever its loss.
    screening_step : float or None
        Time step [s] of the simulations that screen candidates in f32; None for that of the search.
    """

    loss: Loss = Loss.KINDS
    priors: Priors = Priors()
    conditions: tuple[Condition, ...] = ()
    screening_step: float | None = None


PLAIN = Goal()
