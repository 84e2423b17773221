"""The parameters to be calibrated: names, bounds, scales and the constraints between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arrays import Bools, Floats
from commonrail.calibration.constraint_text import parse_constraints
from commonrail.calibration.constraints import (
    ROUNDING,
    LinearConstraints,
    Polytope,
    conflicting_rows,
    deepest_point,
)
from commonrail.calibration.parameter import Parameter, percent_bounds
from commonrail.calibration.products import NONE, Products
from commonrail.elementary import exp, log, product
from commonrail.errors import ConfigurationError

__all__ = ["Parameter", "Space", "percent_bounds"]


# A point pulled back to a boundary stops this fraction short of it, clear of rounding.
_SHORT_OF_BOUNDARY = 1e-9
_HALVINGS = 40  # of a segment that a curved constraint cuts
_DRAWS = 4096  # points that are tried where the centre of the bounds breaks a curved constraint


@dataclass(frozen=True, eq=False)
class Space:
    """The box of the parameters' bounds, cut by linear constraints.

    Points are arrays (..., d) in SI, columns in the order of `parameters`. Unit coordinates map
    each parameter's bounds to 0 and 1, linearly or logarithmically by its scale.

    Parameters
    ----------
    parameters : sequence of Parameter
        At least one, each name once.
    constraints : LinearConstraints or sequence of str, optional
        Rows, or texts for `parse_constraints`.
    products : Products, optional
        Constraints between products of the parameters, which are curved.

    Raises
    ------
    ConfigurationError
        If names repeat, columns and parameters disagree, or constraints and bounds leave no room;
        the message names a smallest set of constraints that conflict.
    """

    parameters: Sequence[Parameter]
    constraints: LinearConstraints | Sequence[str] = ()
    products: Products = NONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        self._check_names()
        if self.rows.dimension != self.dimension:
            raise ConfigurationError(
                f"constraints: {self.rows.dimension} columns were given for {self.dimension} "
                "free parameters, expected one column for each"
            )
        conflict = conflicting_rows(self.rows, self.lower, self.upper) if len(self.rows) else ()
        if conflict:
            raise ConfigurationError(self._conflict(conflict))
        if len(self.products):
            self._check_products()

    def _check_names(self) -> None:
        if not self.parameters:
            raise ConfigurationError("parameters: name at least one parameter to calibrate")
        repeated = sorted({name for name in self.names if self.names.count(name) > 1})
        if repeated:
            raise ConfigurationError(f"parameters: {', '.join(repeated)} given more than once, keep one of each")

    def _check_products(self) -> None:
        if not self.satisfies(self.centre):
            texts = " and ".join(f'"{label}"' for label in self.products.labels)
            raise ConfigurationError(
                f"constraints: no point was found within the bounds where {texts} holds with the others; widen a "
                "bound, or correct or remove a constraint"
            )

    def _conflict(self, conflict: tuple[int, ...]) -> str:
        """One sentence that names constraints in conflict and the bounds they meet."""
        texts = dict.fromkeys(f'"{self.rows.labels[row]}"' for row in conflict)
        used = np.flatnonzero(self.rows.matrix[list(conflict)].any(axis=0))
        bounds = (self.parameters[column] for column in used.tolist())
        limits = ", ".join(f"{p.name} {p.lower:g} to {p.upper:g} {p.unit}".rstrip() for p in bounds)
        return (
            f"constraints: {' and '.join(texts)} cannot hold within the bounds ({limits}); "
            "widen a bound, or correct or remove a constraint"
        )

    @cached_property
    def rows(self) -> LinearConstraints:
        """The constraints as rows."""
        if isinstance(self.constraints, LinearConstraints):
            return self.constraints
        return parse_constraints(tuple(self.constraints), self.names)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names, in the order of the columns."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def constrained(self) -> bool:
        """Return whether there are constraints besides the bounds."""
        return bool(len(self.rows) or len(self.products))

    @property
    def labels(self) -> tuple[str, ...]:
        """Texts of all constraints, each once."""
        return tuple(dict.fromkeys((*self.rows.labels, *self.products.labels)))

    @property
    def dimension(self) -> int:
        """Number of free parameters d."""
        return len(self.parameters)

    @cached_property
    def lower(self) -> Floats:
        """Lower bounds (d,), SI."""
        return _frozen([parameter.lower for parameter in self.parameters])

    @cached_property
    def upper(self) -> Floats:
        """Upper bounds (d,), SI."""
        return _frozen([parameter.upper for parameter in self.parameters])

    @cached_property
    def reference(self) -> Floats:
        """Reference values (d,), SI."""
        return _frozen([parameter.reference for parameter in self.parameters])

    @cached_property
    def logarithmic(self) -> Bools:
        """Mask of the parameters (d,) with a logarithmic scale."""
        return np.array([parameter.scale == "log" for parameter in self.parameters])

    @cached_property
    def polytope(self) -> Polytope:
        """Bounds and constraints scaled to the bounds."""
        return Polytope.of(self.rows, self.lower, self.upper)

    @cached_property
    def centre(self) -> Floats:
        """The feasible point (d,) farthest from bounds and linear constraints, SI.

        Where it breaks a constraint between products, the reference or a drawn point that does not.
        """
        depth, _ = deepest_point(self.polytope)
        deepest = self.lower + depth * (self.upper - self.lower)
        if not len(self.products):
            return _frozen(deepest)
        drawn = self.from_unit(np.random.default_rng(0).random((_DRAWS, self.dimension)))
        candidates = np.vstack([deepest, self.reference, drawn])
        return _frozen(candidates[int(np.argmax(self.satisfies(candidates)))])

    def to_unit(self, x: ArrayLike) -> Floats:
        """Unit coordinates (..., d) of points (..., d); 0 and 1 exactly at the bounds."""
        points = np.asarray(x, dtype=float)
        unit = (points - self.lower) / self._range
        if self._bent:
            ratio = np.maximum(points, np.finfo(float).tiny) / np.where(self.logarithmic, self.lower, 1.0)
            unit = np.where(self.logarithmic, log(ratio) / self._log_span, unit)
            inside = (points >= self.lower) & (points <= self.upper)
            unit = np.where(inside, np.clip(unit, 0.0, 1.0), unit)
        return np.asarray(unit)

    def from_unit(self, unit: ArrayLike) -> Floats:
        """Points (..., d) of unit coordinates (..., d); within the bounds where the unit is."""
        z = np.asarray(unit, dtype=float)
        x = self.lower + z * self._range
        if self._bent:
            # The scale of linear columns is 0 here: their exponential is 1 and is not used.
            x = np.where(self.logarithmic, self.lower * exp(z * self._log_scale), x)
        # Rounding must neither carry a point over its bound nor stop it short of it.
        within = np.minimum(np.maximum(x, self.lower), self.upper)
        if (np.abs(z - 0.5) >= 0.5).any():  # at a bound or beyond
            within = np.where((z < 0.0) | (z > 1.0), x, within)
            np.copyto(within, self.upper, where=z == 1.0)
        return within

    @cached_property
    def _range(self) -> Floats:
        return _frozen(self.upper - self.lower)

    @cached_property
    def _bent(self) -> bool:
        """Return whether a parameter has a logarithmic scale."""
        return bool(self.logarithmic.any())

    @cached_property
    def _log_scale(self) -> Floats:
        """ln(upper/lower) of logarithmic parameters, 0 of linear ones."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        return log(np.where(self.logarithmic, self.upper, 1.0) / low)

    @cached_property
    def _log_span(self) -> Floats:
        """As `_log_scale`, but 1 for linear parameters: safe to divide by."""
        return np.where(self.logarithmic, self._log_scale, 1.0)

    @cached_property
    def _span(self) -> Floats:
        """Range of each constraint (m,) within the bounds."""
        return product(self.upper - self.lower, np.abs(self.rows.matrix).T)

    @cached_property
    def _floor(self) -> Floats:
        """Smallest value (m,) of each constraint's row, SI."""
        return self.rows.floor(self.lower, self.upper)

    @cached_property
    def _least(self) -> Floats:
        """Smallest `_distances` that count as inside."""
        tolerance = ROUNDING * self.rows.magnitude(self.lower, self.upper)
        return -np.concatenate([tolerance, np.zeros(2 * self.dimension)])

    def _distances(self, x: Floats) -> Floats:
        """Distance (..., m + 2 d) of points inside each constraint and bound, SI."""
        inside = product(x, self.rows.matrix.T) - self._floor
        return np.concatenate([inside, x - self.lower, self.upper - x], axis=-1)

    def slack(self, x: ArrayLike) -> Floats:
        """Distance (..., m) of each constraint from its limit at points (..., d); SI, < 0: broken.

        Strict rows count from a limit that includes their margin (`STRICT_MARGIN`).
        """
        return self._distances(np.asarray(x, dtype=float))[..., : len(self.rows)]

    def shortfall(self, x: ArrayLike) -> Floats:
        """Shortfall of each constraint (..., m) at points (..., d), by its span in the bounds.

        Those of products, which stand last, are relative.
        """
        linear = np.maximum(0.0, -self.slack(x)) / self._span
        if not len(self.products):
            return linear
        return np.concatenate([linear, self.products.shortfall(np.asarray(x, dtype=float))], axis=-1)

    def satisfies(self, x: ArrayLike) -> Bools:
        """Return whether points (..., d) keep to bounds (exactly) and constraints (within rounding)."""
        # A distance to a bound is exact: its row has a single coefficient, 1 or -1.
        points = np.asarray(x, dtype=float)
        linear = np.asarray((self._distances(points) >= self._least).all(axis=-1))
        if not len(self.products):
            return linear
        return linear & (self.products.shortfall(points) <= ROUNDING).all(axis=-1)

    def violation(self, x: ArrayLike) -> Floats:
        """Sum (...) of what points (..., d) lack of bounds and constraints; 0 where they satisfy.

        Each part is divided by the range of the parameter, or by what the row can vary by within
        the bounds, so that all parts are comparable (Lampinen 2002; Deb 2000). NaN counts +inf.
        """
        points = np.asarray(x, dtype=float)
        outside = np.maximum(0.0, self.lower - points) + np.maximum(0.0, points - self.upper)
        outside = outside / self._range
        total = outside.sum(axis=-1) + self.shortfall(points).sum(axis=-1)
        total = np.where(np.isnan(total), np.inf, np.maximum(total, np.finfo(float).tiny))
        return np.asarray(np.where(self.satisfies(points), 0.0, total))

    def pull_back(self, anchor: ArrayLike, x: ArrayLike) -> Floats:
        """The last feasible points (n, d) on the segments from `anchor` (n, d) to `x` (n, d).

        `anchor` must satisfy the space: the segment then starts inside a convex set and leaves
        it once. Points that satisfy the space already come back unchanged. A constraint between products, which need
        not be convex, is met by halving what is left of the segment.
        """
        if len(self.products):
            return self._halved(np.asarray(anchor, dtype=float), np.asarray(x, dtype=float))
        start, goal = np.asarray(anchor, dtype=float), np.asarray(x, dtype=float)
        here, there = self._distances(start), self._distances(goal)
        crossed = there < 0.0
        drop = np.where(crossed, np.maximum(here, 0.0) - there, 1.0)
        fraction = np.where(crossed, np.maximum(here, 0.0) / drop, 1.0).min(axis=-1)
        share = (fraction * (1.0 - _SHORT_OF_BOUNDARY))[..., None]
        pulled = np.clip(start + share * (goal - start), self.lower, self.upper)
        pulled = np.where(self.satisfies(pulled)[..., None], pulled, start)
        feasible = (there >= self._least).all(axis=-1, keepdims=True)
        return np.asarray(np.where(feasible, goal, pulled))

    def _halved(self, start: Floats, goal: Floats) -> Floats:
        """Last feasible points (..., d) that halving finds on segments from feasible points (..., d)."""
        inside, outside = np.zeros(goal.shape[:-1]), np.ones(goal.shape[:-1])
        for _ in range(_HALVINGS):
            middle = 0.5 * (inside + outside)
            feasible = self.satisfies(start + middle[..., None] * (goal - start))
            inside, outside = np.where(feasible, middle, inside), np.where(feasible, outside, middle)
        found = start + inside[..., None] * (goal - start)
        found = np.where(self.satisfies(found)[..., None], found, start)
        return np.where(self.satisfies(goal)[..., None], goal, found)


def _frozen(values: ArrayLike) -> Floats:
    """A read-only array: spaces are shared."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
