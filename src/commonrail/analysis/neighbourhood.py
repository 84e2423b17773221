"""Candidates about a point, and derivatives from what they give."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.arguments import array
from commonrail.arrays import Floats
from commonrail.calibration.space import Space

__all__ = ["STEP", "Neighbourhood", "around"]


STEP = 5e-3  # of the range, to both sides: above the ripple of a PWM drive, below curvature


class Neighbourhood(NamedTuple):
    """A point with candidates below and above it in each parameter.

    Attributes
    ----------
    values : (1 + 2 d, d)
        The point, those below and those above it [SI].
    width : (d,)
        Distance between the two candidates of a parameter, in positions between the bounds; less at a bound.
    scale : (d,)
        SI value per unit of position, which on a logarithmic scale is not the width of the range.
    """

    values: Floats
    width: Floats
    scale: Floats

    def slopes(self, found: Floats) -> Floats:
        """Derivatives (m, d) with respect to the positions of figures (1 + 2 d, m) that the candidates give."""
        d = len(self.width)
        return np.asarray(((found[1 + d :] - found[1 : 1 + d]) / self.width[:, None]).T)


def around(space: Space, best: Floats) -> Neighbourhood:
    """Candidates `STEP` below and above a point (d,) [SI] in each parameter, within the bounds."""
    unit = space.to_unit(array(best, "1", "best values", 1))
    step = STEP * np.eye(space.dimension)
    low, high = np.clip(unit - step, 0.0, 1.0), np.clip(unit + step, 0.0, 1.0)
    width = np.diag(high - low)
    scale = np.diag(space.from_unit(high) - space.from_unit(low)) / width
    return Neighbourhood(space.from_unit(np.vstack([unit, low, high])), width, scale)
