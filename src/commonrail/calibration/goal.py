"""Goal of a search: the loss on the data, the priors of the parameters, and how candidates are screened."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.calibration.parameter import Condition, Priors


class Loss(StrEnum):
    """Loss on the data that a search makes small."""

    KINDS = "kinds"
    """J that each kind of data defines: the paper's sum of |error| for a curve, the soft-L1 sum for a map."""

    SQUARES = "squares"
    """Sum of the squared residuals, for maps in units of their tolerances."""

    SOFT_L1 = "soft_l1"
    """Sum of 2 s² (sqrt(1 + (r/s)²) − 1) of the residuals r with a scale s: r² for small ones, 2 s |r| for large."""


class Goal(NamedTuple):
    """Rules of the objective besides the data: loss, and priors whose squared residuals are added to it.

    A candidate that does not meet one of the conditions loses, whatever its loss. `screening_step` is the time step [s]
    of the simulations that screen candidates in f32, None for that of the search; `scale` is s of the loss
    `Loss.SOFT_L1`, in units of the residuals.
    """

    loss: Loss = Loss.KINDS
    priors: Priors = Priors()
    conditions: tuple[Condition, ...] = ()
    screening_step: float | None = None
    scale: float = 1.0

    def bent(self, residuals: Floats) -> Floats:
        """Residuals (n, m) whose squares sum to the loss; those themselves unless the loss is soft L1.

        r sqrt(2/(1 + sqrt(1 + (r/s)²))): its square is 2 s² (sqrt(1 + (r/s)²) − 1), without the cancellation.
        """
        if self.loss is not Loss.SOFT_L1:
            return residuals
        return np.asarray(residuals * np.sqrt(2.0 / (1.0 + _root(residuals, self.scale))))

    def roots_of_weights(self, residuals: Floats) -> Floats:
        """Roots (m,) of the weights that the soft-L1 loss gives residuals (m,).

        The weight is the slope of the loss in r², 1/sqrt(1 + (r/s)²): residuals far beyond s hardly count in standard
        errors.
        """
        return np.asarray(1.0 / np.sqrt(_root(residuals, self.scale)))


def _root(residuals: Floats, scale: float) -> Floats:
    return np.asarray(np.sqrt(1.0 + (residuals / scale) ** 2))


PLAIN = Goal()
