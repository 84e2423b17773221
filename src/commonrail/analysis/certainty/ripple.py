"""Comparison of the curvature with the simulated likelihood, one and two standard errors from the most likely values.

A likelihood ripples where samples on steep flanks, or innovations of correlated noise, change faster with a parameter
than its standard error. The curvature at one point of a ripple is then no measure of the error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.analysis.certainty.estimate import Estimate
from commonrail.analysis.certainty.profile import fall_along
from commonrail.arrays import Bools, Floats

__all__ = ["MOST_RATIO", "Ripple", "ripple_of"]


DISTANCES = (1.0, 2.0)  # standard errors: within and at the end of a 95 % interval
MOST_RATIO = 1.2  # an interval 1.2 times too short holds 90 % instead of 95 % (normal distribution, 1.96/1.2)


class Ripple(NamedTuple):
    """Curvature against simulated likelihood.

    Attributes
    ----------
    ratios : (d,)
        Largest distance at which the simulated likelihood has fallen as far as the curvature promises at one, in
        distances; infinite where it does not fall, NaN where no point could be simulated.
    rippled : (d,)
        True where a ratio, of any distance and side, lies outside 1/`MOST_RATIO` … `MOST_RATIO`.
    simulated : int
        Points simulated.
    """

    ratios: Floats
    rippled: Bools
    simulated: int


def ripple_of(estimate: Estimate) -> Ripple:
    """Ratios of an estimate, from 4 d simulations in one batch.

    Parameters
    ----------
    estimate : Estimate
    """
    before = estimate.likelihood.simulated
    falls = fall_along(estimate, DISTANCES)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.array(DISTANCES)[:, None, None] / np.sqrt(np.maximum(falls, 0.0))
    ratios = np.where(np.isfinite(falls), ratios, np.nan)
    outside = np.asarray((ratios > MOST_RATIO) | (ratios < 1.0 / MOST_RATIO))
    largest = np.max(np.where(np.isnan(ratios), 0.0, ratios), axis=(0, 2))
    known = np.isfinite(falls).any(axis=(0, 2))
    return Ripple(
        np.where(known, largest, np.nan), np.asarray(outside.any(axis=(0, 2))), estimate.likelihood.simulated - before
    )
