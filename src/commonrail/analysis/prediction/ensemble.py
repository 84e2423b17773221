"""Draws about the best values, for bands that a linear model would carry beyond what is physical.

At a steep flank a value is far from linear in the parameters: rates and quantities end at zero, and the linear band
goes on below it. Draws of the same distribution, simulated, do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from commonrail.analysis.prediction.band import Edges
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.space import Space

__all__ = ["DRAWS", "Drawn", "drawn_about", "falls_below_zero"]


DRAWS = 400  # the 5 % quantile of so many scatters by a tenth of the half width of a 90 % band
SEED = 0
# Share of the largest value by which a band may fall below zero, and a prediction that counts as never negative: the
# fuel that flows back as a needle closes is a thousandth of the largest rate.
SLACK = 0.01


def falls_below_zero(values: Floats, alone: Mapping[float, Edges]) -> bool:
    """True if a band by the parameters alone falls below zero where no predicted value does.

    Parameters
    ----------
    values : (n,)
        Predicted.
    alone : mapping of float to ((n,), (n,))
        Lower and upper edges by level.
    """
    found = np.isfinite(values)
    floor = -SLACK * float(np.max(values, where=found, initial=0.0))
    if not found.any() or values[found].min() < floor:
        return False
    return any(bool((low[found] < floor).any()) for low, _ in alone.values())


class Drawn(NamedTuple):
    """Drawn parameters.

    Attributes
    ----------
    values : (DRAWS, d)
        [SI], within bounds and constraints.
    stretch : (DRAWS,)
        Factor of each draw's distance from the mean, by the uncertain scale of the covariance.
    """

    values: Floats
    stretch: Floats


def drawn_about(space: Space, point: Floats, covariance: Floats, freedom: float = np.inf) -> Drawn:
    """Parameters drawn from Student's t distribution, brought within bounds and constraints.

    Parameters
    ----------
    space : Space
    point : (d,)
        Mean [SI].
    covariance : (d, d)
        Of the positions between the bounds, for the normal distribution of the same scale.
    freedom : float
        Degrees of freedom of the scale; the distribution is normal where it is exactly known.
    """
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    unit = np.tile(space.to_unit(point), (DRAWS, 1))
    rng = np.random.default_rng(SEED)
    normal, stretch = rng.standard_normal(unit.shape), np.ones(DRAWS)
    if np.isfinite(freedom):
        stretch = 1.0 / np.sqrt(rng.chisquare(freedom, DRAWS) / freedom)
    ends = unit + stretch[:, None] * (normal @ root.T)
    return Drawn(space.from_unit(FeasibleSet.of(space).within(unit, ends)), stretch)
