"""The parameters to be calibrated: names, bounds, scales and the constraints between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import (
    frozen,
    instance,
    instances,
    integer,
    mapping,
    number,
    plain_text,
    sequence,
    settle,
)
from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.constraints import (
    NONE,
    ROUNDING,
    LinearConstraints,
    Polytope,
    Products,
    conflicting_rows,
    deepest_point,
    parse_constraints,
)
from commonrail.calibration.parameter import Parameter
from commonrail.physics.elementary import cholesky, exp, log, product, solve_lower, solve_upper

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

    names: tuple[str, ...] = field(init=False, repr=False)  # in the order of the columns
    dimension: int = field(init=False, repr=False)  # number of free parameters d
    rows: LinearConstraints = field(init=False, repr=False)  # the constraints that are straight
    labels: tuple[str, ...] = field(init=False, repr=False)  # texts of all constraints, each once
    constrained: bool = field(init=False, repr=False)  # there are constraints besides the bounds
    lower: Floats = field(init=False, repr=False)  # bounds (d,), SI
    upper: Floats = field(init=False, repr=False)
    reference: Floats = field(init=False, repr=False)  # reference values (d,), SI
    logarithmic: Bools = field(init=False, repr=False)  # mask (d,) of the parameters with a logarithmic scale

    def __post_init__(self) -> None:
        parameters = instances(self.parameters, Parameter, "parameters")
        names = tuple(parameter.name for parameter in parameters)
        _check_names(names)
        rows = self.constraints
        if not isinstance(rows, LinearConstraints):
            texts = sequence(rows, "constraints", '["valve.lift > 40e-6"]')
            rows = parse_constraints([plain_text(text, "constraint") for text in texts], names)
        if rows.dimension != len(parameters):
            raise ConfigurationError(
                f"constraints: {rows.dimension} columns were given for {len(parameters)} "
                "free parameters, expected one column for each",
                code="wrong-shape",
            )
        settle(
            self,
            parameters=parameters,
            names=names,
            dimension=len(parameters),
            rows=rows,
            labels=tuple(dict.fromkeys((*rows.labels, *self.products.labels))),
            constrained=bool(len(rows) or len(self.products)),
            lower=np.array([parameter.lower for parameter in parameters]),
            upper=np.array([parameter.upper for parameter in parameters]),
            reference=np.array([parameter.reference for parameter in parameters]),
            logarithmic=np.array([parameter.scale == "log" for parameter in parameters]),
        )
        conflict = conflicting_rows(rows, self.lower, self.upper) if len(rows) else ()
        if conflict:
            raise ConfigurationError(_conflict(self, conflict), code="infeasible")
        if len(self.products) and not self.satisfies(self.centre):
            texts = " and ".join(f'"{label}"' for label in self.products.labels)
            raise ConfigurationError(
                f"constraints: no point was found within the bounds where {texts} holds with the others; widen a "
                "bound, or correct or remove a constraint",
                code="infeasible",
            )

    @cached_property
    def polytope(self) -> Polytope:
        """Bounds and constraints scaled to the bounds."""
        return Polytope.of(self.rows, self.lower, self.upper)

    @cached_property
    def centre(self) -> Floats:
        """The feasible point (d,) farthest from bounds and linear constraints, SI.

        If this point violates a constraint on products, the reference or a feasible drawn point.
        """
        depth, _ = deepest_point(self.polytope)
        deepest = self.lower + depth * (self.upper - self.lower)
        if not len(self.products):
            return np.asarray(frozen(deepest))
        drawn = self.from_unit(np.random.default_rng(0).random((_DRAWS, self.dimension)))
        candidates = np.vstack([deepest, self.reference, drawn])
        return np.asarray(frozen(candidates[int(np.argmax(self.satisfies(candidates)))]))

    def point(self, values: Mapping[str, float]) -> Floats:
        """Point (d,) of values [SI] by the names of the parameters, such as `Calibration.best`.

        Raises `ConfigurationError` if one is missing, or no number.
        """
        checked = mapping(values, "values of the parameters", f'{{"{self.names[0]}": {self.reference[0]:g}}}')
        if missing := [name for name in self.names if name not in checked]:
            raise ConfigurationError(
                f"The values of the parameters lack {missing[0]}; give one for each free parameter: "
                f"{', '.join(self.names)}."
            )
        return np.array([number(checked[p.name], p.unit, p.name) for p in self.parameters])

    def to_unit(self, x: ArrayLike) -> Floats:
        """Unit coordinates (..., d) of points (..., d); 0 and 1 exactly at the bounds."""
        points = np.asarray(x, dtype=float)
        unit = (points - self.lower) / self._limits.span
        if self._limits.bent:
            ratio = np.maximum(points, np.finfo(float).tiny) / np.where(self.logarithmic, self.lower, 1.0)
            log_span = np.where(self.logarithmic, self._limits.log_span, 1.0)  # safe to divide by
            unit = np.where(self.logarithmic, log(ratio) / log_span, unit)
            inside = (points >= self.lower) & (points <= self.upper)
            unit = np.where(inside, np.clip(unit, 0.0, 1.0), unit)
        return np.asarray(unit)

    def from_unit(self, unit: ArrayLike) -> Floats:
        """Points (..., d) of unit coordinates (..., d); coordinates in [0, 1] give points within the bounds."""
        z = np.asarray(unit, dtype=float)
        x = self.lower + z * self._limits.span
        if self._limits.bent:
            # The scale of linear columns is 0 here: their exponential is 1 and is not used.
            x = np.where(self.logarithmic, self.lower * exp(z * self._limits.log_span), x)
        # Rounding must neither carry a point over its bound nor stop it short of it.
        within = np.minimum(np.maximum(x, self.lower), self.upper)
        if (np.abs(z - 0.5) >= 0.5).any():  # at a bound or beyond
            within = np.where((z < 0.0) | (z > 1.0), x, within)
            np.copyto(within, self.upper, where=z == 1.0)
        return within

    @cached_property
    def _limits(self) -> _Limits:
        return _Limits.of(self)

    def slack(self, x: ArrayLike) -> Floats:
        """Distance (..., m) of each constraint from its limit at points (..., d); SI, < 0: broken.

        Strict rows count from a limit that includes their margin (`STRICT_MARGIN`).
        """
        return _distances(self, np.asarray(x, dtype=float))[..., : len(self.rows)]

    def shortfall(self, x: ArrayLike) -> Floats:
        """Shortfall of each constraint (..., m) at points (..., d), by its span in the bounds.

        The shortfalls of products come last and are relative.
        """
        linear = np.maximum(0.0, -self.slack(x)) / self._limits.ranges
        if not len(self.products):
            return linear
        return np.concatenate([linear, self.products.shortfall(np.asarray(x, dtype=float))], axis=-1)

    def satisfies(self, x: ArrayLike) -> Bools:
        """Return whether points (..., d) keep to bounds (exactly) and constraints (within rounding)."""
        # A distance to a bound is exact: its row has a single coefficient, 1 or -1.
        points = np.asarray(x, dtype=float)
        linear = np.asarray((_distances(self, points) >= self._limits.least).all(axis=-1))
        if not len(self.products):
            return linear
        return linear & (self.products.shortfall(points) <= ROUNDING).all(axis=-1)

    def violation(self, x: ArrayLike) -> Floats:
        """Total violation (...) of bounds and constraints at points (..., d); 0 for feasible points.

        Each part is divided by the range of the parameter or of the row within the bounds, so that all parts are
        comparable (Lampinen 2002; Deb 2000). NaN counts +inf.
        """
        points = np.asarray(x, dtype=float)
        outside = np.maximum(0.0, self.lower - points) + np.maximum(0.0, points - self.upper)
        outside = outside / self._limits.span
        total = outside.sum(axis=-1) + self.shortfall(points).sum(axis=-1)
        total = np.where(np.isnan(total), np.inf, np.maximum(total, np.finfo(float).tiny))
        return np.asarray(np.where(self.satisfies(points), 0.0, total))

    def pull_back(self, anchor: ArrayLike, x: ArrayLike) -> Floats:
        """The last feasible points (n, d) on the segments from `anchor` (n, d) to `x` (n, d).

        `anchor` must satisfy the space: the segment then starts inside a convex set and leaves
        it once. Points that satisfy the space already come back unchanged. A constraint between products, which need
        not be convex, is met by halving what is left of the segment.
        """
        start, goal = np.asarray(anchor, dtype=float), np.asarray(x, dtype=float)
        if len(self.products):
            return _halved(self, start, goal)
        at_start, at_goal = _distances(self, start), _distances(self, goal)
        crossed = at_goal < 0.0
        drop = np.where(crossed, np.maximum(at_start, 0.0) - at_goal, 1.0)
        fraction = np.where(crossed, np.maximum(at_start, 0.0) / drop, 1.0).min(axis=-1)
        share = (fraction * (1.0 - _SHORT_OF_BOUNDARY))[..., None]
        pulled = np.clip(start + share * (goal - start), self.lower, self.upper)
        pulled = np.where(self.satisfies(pulled)[..., None], pulled, start)
        feasible = (at_goal >= self._limits.least).all(axis=-1, keepdims=True)
        return np.asarray(np.where(feasible, goal, pulled))


class _Limits(NamedTuple):
    """Arrays of bounds and linear constraints that a space uses repeatedly."""

    span: Floats  # (d,), distance of the bounds, SI
    log_span: Floats  # (d,), ln(upper/lower) of logarithmic parameters, 0 of linear ones
    bent: bool  # a parameter has a logarithmic scale
    floor: Floats  # (m,), smallest value of each constraint's row, SI
    ranges: Floats  # (m,), range of each constraint within the bounds
    least: Floats  # (m + 2 d,), smallest distances that count as inside

    @classmethod
    def of(cls, space: Space) -> _Limits:
        low, high, rows = space.lower, space.upper, space.rows
        ratio = np.where(space.logarithmic, high, 1.0) / np.where(space.logarithmic, low, 1.0)
        return cls(
            high - low,
            log(ratio),
            bool(space.logarithmic.any()),
            rows.floor(low, high),
            product(high - low, np.abs(rows.matrix).T),
            -np.concatenate([ROUNDING * rows.magnitude(low, high), np.zeros(2 * space.dimension)]),
        )


def _distances(space: Space, x: Floats) -> Floats:
    """Distance (..., m + 2 d) of points inside each constraint and bound, SI."""
    inside = product(x, space.rows.matrix.T) - space._limits.floor
    return np.concatenate([inside, x - space.lower, space.upper - x], axis=-1)


def _check_names(names: Sequence[str]) -> None:
    """Check that there are names, each once."""
    if not names:
        raise ConfigurationError("parameters: name at least one parameter to calibrate")
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ConfigurationError(
            f"parameters: {', '.join(repeated)} given more than once, keep one of each", code="repeated"
        )


def _conflict(space: Space, conflict: tuple[int, ...]) -> str:
    """One sentence that names constraints in conflict and the bounds they meet."""
    texts = dict.fromkeys(f'"{space.rows.labels[row]}"' for row in conflict)
    used = np.flatnonzero(space.rows.matrix[list(conflict)].any(axis=0))
    bounds = (space.parameters[column] for column in used.tolist())
    limits = ", ".join(f"{p.name} {p.lower:g} to {p.upper:g} {p.unit}".rstrip() for p in bounds)
    return (
        f"constraints: {' and '.join(texts)} cannot hold within the bounds ({limits}); "
        "widen a bound, or correct or remove a constraint"
    )


def _halved(space: Space, start: Floats, goal: Floats) -> Floats:
    """Last feasible points (..., d) that halving finds on segments from feasible points (..., d)."""
    inside, outside = np.zeros(goal.shape[:-1]), np.ones(goal.shape[:-1])
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        feasible = space.satisfies(start + middle[..., None] * (goal - start))
        inside, outside = np.where(feasible, middle, inside), np.where(feasible, outside, middle)
    last_feasible = start + inside[..., None] * (goal - start)
    last_feasible = np.where(space.satisfies(last_feasible)[..., None], last_feasible, start)
    return np.where(space.satisfies(goal)[..., None], goal, last_feasible)


# Draws of starting points: uniform in the bounds, or uniform where the constraints hold too.

# Steps of each chain, s d + d^2 for d parameters. The paper's seven parameters then have the means
# and spreads of rejection sampling, and 20 ordered parameters those of order statistics, within the
# noise of thousands of draws. With half as many steps, the latter are off by 15 % of a spread.
STEPS_PER_PARAMETER = 20
# A step uses this much of its chord, which keeps rounding from carrying a point outside.
_CHORD_USED = 1.0 - 1e-9
# Halvings (on average) of a chord that a curved constraint cuts, before the point stays.
_SHRINKS = 40
_NEWTON_STEPS = 30


def sample_uniform(space: Space, n: int, rng: np.random.Generator) -> Floats:
    """Draw points uniformly in the bounds, constraints ignored, Eq. (17).

    `space`: the d parameters; `n`: number of points; `rng`: source of the draws. Returns points, SI; uniform in the
    logarithm for parameters on a logarithmic scale (n, d).
    """
    return space.from_unit(rng.random((n, space.dimension)))


def sample_feasible(space: Space, n: int, rng: np.random.Generator) -> Floats:
    """Draw points uniformly where bounds and constraints hold, by hit-and-run.

    Every point ends a chain of its own, so points are independent of each other. A chain starts
    at a centre of the polytope; each step draws a direction and then a point on the chord that
    the polytope cuts from that line (Smith 1984), so that no draw is ever infeasible, however
    small the feasible share of the box. Directions follow the shape of the polytope (the Hessian
    of its logarithmic barrier), without which an ordering of many parameters mixes slowly.

    Uniform means uniform in unit coordinates. There a constraint that adds a parameter on a
    logarithmic scale to others is curved; it then shortens the chord by slice sampling's
    shrinkage (Neal 2003). Orderings among parameters of one scale stay straight.

    Parameters
    ----------
    space, n, rng
        As in `sample_uniform`.

    Returns
    -------
    (n, d) array
        Points, SI, each of which satisfies `space` and its constraints.

    Raises
    ------
    ConfigurationError
        If the number is negative or has a fraction, or an argument is of another kind.
    """
    n = integer(n, "number of points")
    instance(rng, np.random.Generator, "rng")
    if not instance(space, Space, "space").constrained:
        return sample_uniform(space, n, rng)
    walk = _plan(space)
    unit = np.tile(walk.start, (n, 1))
    with np.errstate(divide="ignore", invalid="ignore"):  # directions along a face
        for _ in range(space.dimension * (STEPS_PER_PARAMETER + space.dimension)):
            unit = _step(walk, unit, rng)
    x = space.from_unit(np.clip(unit, 0.0, 1.0))
    return np.where(space.satisfies(x)[:, None], x, space.centre)


def sample_priors(space: Space, n: int, rng: np.random.Generator) -> Floats:
    """Draw points from the priors of the parameters, as a Latin hypercube; the first one is the reference.

    A prior is cut at the bounds; a parameter without one is uniform on its scale. A point that breaks a constraint is
    pulled towards the centre of the space. Without any prior, but with constraints, draws are those of
    `sample_feasible`.

    `space`: the d parameters and their constraints; `n`: number of points; `rng`: source of the draws. Returns points,
    SI, each of which satisfies `space` (n, d).
    """
    priors = [parameter.prior for parameter in space.parameters]
    if space.constrained and not any(priors):
        x = sample_feasible(space, n, rng)
    else:
        ranks = np.argsort(rng.random((n, space.dimension)), axis=0)
        shares = (ranks + rng.random((n, space.dimension))) / n
        x = space.from_unit(shares)
        for column, prior in enumerate(priors):
            if prior is not None:
                from scipy.special import ndtr, ndtri  # slow to import

                low, high = (ndtr(prior.residual(float(bound[column]))) for bound in (space.lower, space.upper))
                x[:, column] = prior.value + prior.sigma * ndtri(low + shares[:, column] * (high - low))
        x = np.clip(x, space.lower, space.upper)
        x = space.pull_back(np.tile(space.centre, (n, 1)), x)
    if space.satisfies(space.reference):
        x[0] = space.reference
    return x


def reference_start(space: Space) -> Floats:
    """Return the reference values (1, d), SI, as a member of an initial population.

    Raises `ConfigurationError` if they break a bound or a constraint.
    """
    reference = space.reference[None, :]
    if not space.satisfies(reference)[0]:
        raise ConfigurationError(
            'the reference values break the bounds or a constraint; correct them or take initial = "feasible"',
            code="infeasible-start",
        )
    return reference


class _Walk(NamedTuple):
    """Inputs of a step: straight constraints in unit coordinates, and their shape."""

    space: Space
    polytope: Polytope
    shape: Floats
    start: Floats
    curved: bool


def _plan(space: Space) -> _Walk:
    """Straighten what can be straightened and find the shape of the polytope."""
    straight, constraints = _straighten(space)
    bent = space.logarithmic
    lower = np.where(bent, log(np.where(bent, space.lower, 1.0)), space.lower)
    upper = np.where(bent, log(np.where(bent, space.upper, 1.0)), space.upper)
    polytope = Polytope.of(constraints, lower, upper)
    centre, shape = _barrier(polytope)
    curved = bool(len(space.products)) or not bool(straight.all())
    return _Walk(space, polytope, shape, space.to_unit(space.centre) if curved else centre, curved)


def _straighten(space: Space) -> tuple[Bools, LinearConstraints]:
    """Mask of the rows that are linear in ln x of the logarithmic parameters, and these rows in ln x.

    These are the rows without logarithmic parameters, and a x_i >= b x_j with both logarithmic, which is
    ln x_i - ln x_j >= ln(b/a). (A curved row is left out here and tested at each step.)
    """
    matrix, lower = space.rows.matrix.copy(), space.rows.lower.copy()
    uses_log = (matrix[:, space.logarithmic] != 0.0).any(axis=1)
    straight = ~uses_log
    for row in np.flatnonzero(uses_log):
        columns = np.flatnonzero(matrix[row])
        signs = np.sign(matrix[row, columns])
        pair = len(columns) == 2 and signs.sum() == 0.0 and lower[row] == 0.0
        if pair and space.logarithmic[columns].all():
            straight[row] = True
            lower[row] = -float(np.sum(signs * log(np.abs(matrix[row, columns]))))
            matrix[row, columns] = signs
    return straight, LinearConstraints(matrix[straight], lower[straight])


def _barrier(polytope: Polytope) -> tuple[Floats, Floats]:
    """Minimum (d,) of the logarithmic barrier, a root (d, d) of its inverse Hessian there."""
    rows, floor = polytope
    point, _ = deepest_point(polytope)
    for _ in range(_NEWTON_STEPS):
        inverse = 1.0 / (product(point, rows.T) - floor)
        gradient = product(inverse, rows)
        root = cholesky(product((rows * inverse[:, None] ** 2).T, rows))
        newton = solve_upper(root.T, solve_lower(root, gradient))
        # The damped step of a self-concordant barrier never leaves the polytope.
        point = point + newton / (1.0 + np.sqrt(np.sum(gradient * newton)))
    return point, solve_lower(root, np.eye(len(root)))


def _step(walk: _Walk, unit: Floats, rng: np.random.Generator) -> Floats:
    """Move every chain (n, d) along a random chord."""
    direction = product(rng.standard_normal(unit.shape), walk.shape)
    first, last = _chord(walk.polytope, unit, direction)
    step = first + (last - first) * rng.random(len(unit))
    if walk.curved:
        step = _shrink(walk.space, unit, direction, (first, last, step), rng)
    return np.asarray(unit + step[:, None] * direction)


def _chord(polytope: Polytope, unit: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Least and greatest step (n,), (n,) along `direction` (n, d) inside the polytope."""
    rows, floor = polytope
    reach = _along(rows, unit)
    reach -= floor
    np.maximum(reach, 0.0, out=reach)
    reach *= -_CHORD_USED
    rate = _along(rows, direction)
    reach /= rate
    # one row for each constraint: reductions along memory are faster
    reach, rate = np.ascontiguousarray(reach.T), np.ascontiguousarray(rate.T)
    first = np.where(rate > 0.0, reach, -np.inf).max(axis=0)
    last = np.where(rate < 0.0, reach, np.inf).min(axis=0)
    return first, last


def _along(rows: Floats, points: Floats) -> Floats:
    """Products (n, m + 2 d) of the rows of a `Polytope`, of which the last 2 d are its box, with points (n, d)."""
    slanted = rows[: len(rows) - 2 * points.shape[1]]
    return np.concatenate([product(points, slanted.T), points, -points], axis=1)


def _shrink(
    space: Space,
    unit: Floats,
    direction: Floats,
    chord: tuple[Floats, Floats, Floats],
    rng: np.random.Generator,
) -> Floats:
    """Redraw steps (n,) that break a curved constraint, each time from the part nearer to 0."""
    first, last, step = chord
    for _ in range(_SHRINKS):
        broken = ~space.satisfies(space.from_unit(unit + step[:, None] * direction))
        if not broken.any():
            return step
        first = np.where(broken & (step < 0.0), step, first)
        last = np.where(broken & (step > 0.0), step, last)
        step = np.where(broken, first + (last - first) * rng.random(len(step)), step)
    return np.where(broken, 0.0, step)
