"""Steps of a least-squares search within bounds and linear constraints: small quadratic programmes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from commonrail.arrays import Bools, Floats
from commonrail.calibration.space import Space

__all__ = ["Walls", "constrained_step"]


SLACK = 1e-9  # distance beyond a wall that is forgiven, in positions
_TINY = 1e-12


class Walls(NamedTuple):
    """Bounds and linear constraints ``rows @ unit >= floor`` on positions between the bounds.

    The rows of the constraints come first, then 2 d rows of the bounds. A constraint that has a parameter on a
    logarithmic scale is curved in positions and not among them; `Walls.within` keeps to all of them.

    Attributes
    ----------
    rows : (m, d)
    floor : (m,)
    constraints : int
        Number of rows that are constraints.
    space : Space
    """

    rows: Floats
    floor: Floats
    constraints: int
    space: Space

    @classmethod
    def of(cls, space: Space) -> Walls:
        """Walls of a space."""
        found = space.polytope
        many = len(space.rows)
        straight = ~(found.rows[:many] != 0.0)[:, space.logarithmic].any(axis=1)
        keep = np.concatenate([straight, np.ones(len(found.rows) - many, bool)])
        return cls(found.rows[keep], found.floor[keep], int(np.count_nonzero(straight)), space)

    def keep(self, unit: Floats) -> Bools:
        """Return which positions (…, d) lie within the walls."""
        return np.asarray((unit @ self.rows.T >= self.floor - SLACK).all(axis=-1))

    def active(self, unit: Floats, near: float = 1e-6) -> Bools:
        """Mask (m,) of the walls that a position (d,) touches."""
        return np.asarray(self.rows @ unit - self.floor <= near)

    def within(self, start: Floats, unit: Floats) -> Floats:
        """Positions (k, d), those that break a constraint pulled back towards feasible ones, `start`."""
        if not self.space.constrained:
            return np.clip(unit, 0.0, 1.0)
        own = np.clip(unit, 0.0, 1.0)
        points = self.space.from_unit(own)
        bad = ~self.space.satisfies(points)
        if bad.any():
            anchors = self.space.from_unit(np.clip(start[bad], 0.0, 1.0))
            own[bad] = self.space.to_unit(self.space.pull_back(anchors, points[bad]))
        return own


def constrained_step(matrix: Floats, step: Floats, rows: Floats, least: Floats) -> Floats:
    """Step z with rows z ≥ least that is nearest to a wanted one in the metric of a matrix.

    Least-distance programming by non-negative least squares (Lawson and Hanson, ch. 23).

    Parameters
    ----------
    matrix : (d, d)
        Positive definite.
    step : (d,)
        Wanted.
    rows : (m, d)
    least : (m,)
    """
    short = least - rows @ step
    if (short <= _TINY).all():
        return step
    inverse = np.linalg.inv(np.linalg.cholesky(matrix))
    walls = rows @ inverse.T
    system = np.vstack([walls.T, short])
    target = np.zeros(len(system))
    target[-1] = 1.0
    try:
        weights, _ = nnls(system, target)
    except RuntimeError:  # not found within its number of iterations
        return np.zeros_like(step)
    rest = system @ weights - target
    if abs(rest[-1]) <= _TINY:
        return np.zeros_like(step)
    return np.asarray(step + inverse.T @ (-rest[:-1] / rest[-1]))
