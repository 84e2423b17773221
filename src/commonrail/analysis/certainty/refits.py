"""Moves of the estimates by uncertain quantities, from fits with each a standard deviation off.

The likelihood of a curve ripples along the path on which the parameters imitate a delay: derivatives at the most likely
values promise a quarter of the move at one place and all of it at another. Where they promise a quarter of a
parameter's error by noise, or more, the parameters are fitted anew with the quantity a standard deviation above and
below.
"""

from __future__ import annotations

import numpy as np

from commonrail.analysis.certainty.ascent import climb
from commonrail.analysis.certainty.covariance import Covariance
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.nuisance import Nuisance
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.least_squares import FeasibleSet

__all__ = ["with_refits"]


LARGE = 0.25  # move over standard error by noise, from which it is taken from fits
TURNS, TOLERANCE = 8, 0.05  # of each fit


def with_refits(known: Covariance, own: Likelihood, unit: Floats) -> tuple[Covariance, int]:
    """The covariance with large moves by uncertain quantities taken from fits, and the points simulated.

    A move is the root mean square of those to both sides, with the signs of the longer one. Bounds and constraints are
    not projected out: where a fit ends at one, derivatives count too.

    Parameters
    ----------
    known : Covariance
        Whose moves are those of derivatives.
    own : Likelihood
        With its noise.
    unit : (d,)
        Position of the most likely values.
    """
    moves, simulated = known.nuisances.copy(), 0
    errors = np.sqrt(np.diag(known.noise))
    for i, nuisance in enumerate(own.nuisances):
        if (np.abs(moves[i]) > LARGE * errors).any():
            moves[i], more = _move(own, unit, nuisance, moves[i])
            simulated += more
    return known._replace(nuisances=moves), simulated


def _move(own: Likelihood, unit: Floats, nuisance: Nuisance, linear: Floats) -> tuple[Floats, int]:
    """Move (d,) of the estimates by a standard deviation of a quantity, and the points simulated.

    Parameters
    ----------
    own : Likelihood
    unit : (d,)
    nuisance : Nuisance
    linear : (d,)
        The move that derivatives promise.
    """
    feasible, simulated = FeasibleSet.of(own.space), 0
    ends: list[Floats] = []
    floor = np.zeros_like(linear)
    for sign, side in zip((1.0, -1.0), nuisance.sides, strict=False):  # there may be none
        with_side = own.with_space(own.space, side).with_noises(own.noises)
        starts = feasible.within(np.tile(unit, (2, 1)), unit + np.array([[0.0], [sign]]) * linear)
        found = climb(with_side, starts, turns=TURNS, tolerance=TOLERANCE)
        simulated += with_side.simulated
        best = int(np.argmin(found.cost))
        if np.isfinite(found.cost[best]):
            ends.append(sign * (found.unit[best] - unit))
            if feasible.active(found.unit[best]).any():
                floor = np.abs(linear)
    if not ends:
        return linear, simulated
    longer = max(ends, key=lambda end: float(end @ end))
    size = np.maximum(np.sqrt(np.mean(np.square(ends), axis=0)), floor)
    return np.where(longer < 0.0, -size, size), simulated
