"""Linear constraints between parameters, and whether they leave room within the bounds."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arrays import Bools, Floats
from commonrail.elementary import product
from commonrail.errors import ConfigurationError

__all__ = ["LinearConstraints", "Polytope", "conflicting_rows", "deepest_point"]


# Rounding forgiven in a row, and what a strict row (<) asks beyond equality; both relative to the
# largest magnitude the row's terms take within the bounds. The margin is the larger by far, so a
# strict row that counts as met is met strictly in floating point too.
ROUNDING = 1e-12
STRICT_MARGIN = 1e-9
# A polytope whose largest inscribed ball is smaller than this (bounds scaled to 1) has no room:
# far above the rounding of the linear programme that finds the ball.
LEAST_RADIUS = 1e-6


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """Constraints ``matrix @ x >= lower`` on the free parameters, one row each.

    Parameters
    ----------
    matrix : (m, d) array
        Coefficients, one column for each parameter of the space, in SI units.
    lower : (m,) array
        Least value of each row.
    strict : (m,) array of bool, optional
        Rows meant as ``>``: they must exceed ``lower`` by `STRICT_MARGIN` of the row's largest
        magnitude. Every row is forgiven `ROUNDING` of the same magnitude.
    labels : sequence of str, optional
        The text a person wrote for each row, for messages.
    chains : sequence of sequences of int, optional
        Orderings as columns in ascending order, e.g. ``(6, 1, 2)`` for ``k7 < k2 < k3``; repair
        sorts the values along them.

    Raises
    ------
    ConfigurationError
        If shapes disagree, a number is not finite or a row has no coefficient.
    """

    matrix: Floats
    lower: Floats
    strict: Bools | None = None
    labels: Sequence[str] = ()
    chains: Sequence[Sequence[int]] = ()

    def __post_init__(self) -> None:
        matrix = np.atleast_2d(np.array(self.matrix, dtype=float))
        lower = np.atleast_1d(np.array(self.lower, dtype=float))
        strict = np.zeros(len(lower), bool) if self.strict is None else np.array(self.strict, bool)
        labels = tuple(self.labels) or tuple(f"row {row + 1}" for row in range(len(lower)))
        _check_rows(matrix, lower, strict, labels)
        for name, value in (("matrix", matrix), ("lower", lower), ("strict", strict)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        object.__setattr__(self, "labels", labels)
        object.__setattr__(self, "chains", tuple(tuple(chain) for chain in self.chains))

    @classmethod
    def none(cls, dimension: int) -> LinearConstraints:
        """No constraint at all on `dimension` parameters."""
        return cls(np.zeros((0, dimension)), np.zeros(0))

    @property
    def dimension(self) -> int:
        """Number of parameters (columns)."""
        return int(self.matrix.shape[1])

    def __len__(self) -> int:
        return len(self.lower)

    def magnitude(self, lower: Floats, upper: Floats) -> Floats:
        """Largest magnitude (m,) that each row's terms take within the bounds, for tolerances."""
        largest = np.maximum(np.abs(lower), np.abs(upper))
        return product(largest, np.abs(self.matrix).T) + np.abs(self.lower)

    def floor(self, lower: Floats, upper: Floats) -> Floats:
        """Least value (m,) of each row with the margin of the strict rows added."""
        margin = STRICT_MARGIN * self.magnitude(lower, upper)
        return np.asarray(self.lower + np.where(self.strict_rows, margin, 0.0))

    @functools.cached_property
    def strict_rows(self) -> Bools:
        """Mask of the strict rows (m,)."""
        return np.asarray(self.strict, dtype=bool)


def _check_rows(matrix: Floats, lower: Floats, strict: Bools, labels: tuple[str, ...]) -> None:
    """Refuse rows that cannot be constraints."""
    rows = len(lower)
    if matrix.ndim != 2 or not len(matrix) == rows == len(strict) == len(labels):
        raise ConfigurationError(
            f"constraints: {len(matrix)} rows of coefficients, {rows} lower limits, {len(strict)} "
            f"strictness flags and {len(labels)} labels were given, expected as many of each"
        )
    if not (np.isfinite(matrix).all() and np.isfinite(lower).all()):
        raise ConfigurationError("constraints: every coefficient and limit must be a finite number")
    if rows and not matrix.any(axis=1).all():
        row = int(np.argmin(matrix.any(axis=1)))
        raise ConfigurationError(f'constraint "{labels[row]}" depends on no free parameter: correct it or remove it')


class Polytope(NamedTuple):
    """Bounds and constraints as ``rows @ z >= floor`` with z = (x - lower)/(upper - lower).

    Rows have unit length; the 2 d rows of the bounds, 0 <= z <= 1, come last.
    """

    rows: Floats
    floor: Floats

    @classmethod
    def of(cls, constraints: LinearConstraints, lower: Floats, upper: Floats) -> Polytope:
        """Scale constraints to the bounds (d,), (d,) and append the bounds as rows."""
        rows = constraints.matrix * (upper - lower)
        floor = constraints.floor(lower, upper) - product(lower, constraints.matrix.T)
        length = np.linalg.norm(rows, axis=1)
        box = np.eye(len(lower))
        return cls(
            np.vstack([rows / length[:, None], box, -box]),
            np.concatenate([floor / length, np.zeros(len(lower)), -np.ones(len(lower))]),
        )


def deepest_point(polytope: Polytope) -> tuple[Floats, float]:
    """Centre (d,) and radius of the largest ball inside the polytope (its Chebyshev centre).

    A radius below `LEAST_RADIUS` (or negative) means that the polytope has no room.
    """
    centre, radius = _deepest_point(polytope.rows.tobytes(), polytope.floor.tobytes())
    return centre.copy(), radius


@functools.lru_cache(maxsize=8)  # a space asks whether it has room first, and where later
def _deepest_point(row_bytes: bytes, floor_bytes: bytes) -> tuple[Floats, float]:
    from scipy.optimize import linprog  # slow to import, and a study without constraints does without

    floor = np.frombuffer(floor_bytes)
    rows = np.frombuffer(row_bytes).reshape(len(floor), -1)
    dimension = rows.shape[1]
    # Unknowns z and r: greatest r with rows @ z - r >= floor; there always is one, and the bounds limit it.
    inequality = np.hstack([rows, -np.ones((len(rows), 1))])
    downwards = -np.append(np.zeros(dimension), 1.0)
    point: Floats = linprog(downwards, A_ub=-inequality, b_ub=-floor, bounds=(None, None)).x
    return point[:dimension], float(point[dimension])


def conflicting_rows(constraints: LinearConstraints, lower: ArrayLike, upper: ArrayLike) -> tuple[int, ...]:
    """Rows that cannot hold together within the bounds; empty if all can.

    The set is irreducible: dropping any one of its rows leaves room (deletion filter).
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    polytope = Polytope.of(constraints, low, high)
    bounds = list(range(len(constraints), len(polytope.rows)))

    def roomy(rows: list[int]) -> bool:
        chosen = rows + bounds
        return deepest_point(Polytope(polytope.rows[chosen], polytope.floor[chosen]))[1] > (LEAST_RADIUS)

    kept = list(range(len(constraints)))
    if roomy(kept):
        return ()
    for row in list(kept):
        fewer = [other for other in kept if other != row]
        if not roomy(fewer):
            kept = fewer
    return tuple(kept)
