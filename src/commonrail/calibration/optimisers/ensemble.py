"""Ensemble Kalman inversion: members go where a linear regression of their residuals on their positions leads them.

Iglesias, Law & Stuart (2013), Inverse Problems 29, 045001. The regression over the whole ensemble does not see ripple
that is narrower than the ensemble, where derivatives at a point lead astray: quantities that jump with one more bounce
of a valve, and flanks that a time step shifts. Nor does it need derivatives.
"""

from __future__ import annotations

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.calibration.optimisers.least_squares import FeasibleSet

FEWEST = 3  # members for each parameter and one: fewer span too few directions, which no step leaves
# Residuals that all of them count as, for each parameter. Thousands of samples would contract an ensemble to a point in
# one step, by the regression over its first spread alone: on a bench of nine parameters none of six ensembles then
# came to the right place, and all six with this number.
COUNTED = 4


def groups_of(members: int, most: int, dimension: int) -> IndexArray:
    """Number of the ensemble of each of some members (n,): at most `most`, each with members enough.

    Neighbours go to different ones: of ranked members the ensembles are alike.
    """
    return np.arange(members) % max(min(most, members // (FEWEST * (dimension + 1))), 1)


def size_of(residuals: Floats) -> float:
    """Root mean square of the median row of residuals (n, m); of the largest one where most rows are zero."""
    sizes = np.sqrt(np.mean(residuals**2, axis=1))
    return float(np.median(sizes)) or float(sizes.max(initial=0.0)) or 1.0


def moved(feasible: FeasibleSet, unit: Floats, residuals: Floats) -> Floats:
    """Positions (n, d) of an ensemble after one step.

    The noise is the median member's root mean square, of residuals that count as few: a step leaves a spread in
    proportion to what is still unexplained, and the members come to one place as they come to fit.

    `feasible`: bounds, at which steps end, and constraints; `unit` (n, d): positions in unit coordinates; `residuals`
    (n, m): finite ones there.
    """
    scaled = residuals / size_of(residuals)
    share = 1.0 / np.sqrt(max(len(unit) - 1, 1))
    residual_anomalies, away = (share * (values - values.mean(axis=0)) for values in (scaled, unit))
    noise = max(residuals.shape[1] / (COUNTED * unit.shape[1]), 1.0)
    weights = np.linalg.solve(
        residual_anomalies @ residual_anomalies.T + noise * np.eye(len(unit)), residual_anomalies @ scaled.T
    )
    return feasible.within(unit, unit - weights.T @ away)
