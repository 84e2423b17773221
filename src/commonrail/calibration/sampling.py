"""Draws of starting points: uniform in the bounds, or uniform where the constraints hold too."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.arrays import Bools, Floats
from commonrail.calibration.constraints import LinearConstraints, Polytope, deepest_point
from commonrail.calibration.space import Space
from commonrail.elementary import log, product
from commonrail.errors import ConfigurationError
from commonrail.linear import cholesky, inverse_of_lower, solve_lower, solve_upper

__all__ = ["reference_start", "sample_feasible", "sample_priors", "sample_uniform"]


# Steps of each chain, s d + d^2 for d parameters. The paper's seven parameters then have the means
# and spreads of rejection sampling, and an ordering of 20 those of order statistics, to within
# the noise of thousands of draws; half as many steps leave the latter 15 % of a spread off.
STEPS_PER_PARAMETER = 20
# A step uses this much of its chord, which keeps rounding from carrying a point outside.
_CHORD_USED = 1.0 - 1e-9
# Halvings (on average) of a chord that a curved constraint cuts, before the point stays.
_SHRINKS = 40
_NEWTON_STEPS = 30


def sample_uniform(space: Space, n: int, rng: np.random.Generator) -> Floats:
    """Draw points uniformly in the bounds, constraints ignored, Eq. (17).

    Parameters
    ----------
    space : Space
        The d parameters.
    n : int
        Number of points.
    rng : numpy.random.Generator
        Source of the draws.

    Returns
    -------
    (n, d) array
        Points, SI; uniform in the logarithm for parameters on a logarithmic scale.
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
    """
    if not space.constrained:
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

    Parameters
    ----------
    space : Space
        The d parameters and their constraints.
    n : int
        Number of points.
    rng : numpy.random.Generator
        Source of the draws.

    Returns
    -------
    (n, d) array
        Points, SI, each of which satisfies `space`.
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

                low, high = (ndtr(prior.pull(float(bound[column]))) for bound in (space.lower, space.upper))
                x[:, column] = prior.value + prior.sigma * ndtri(low + shares[:, column] * (high - low))
        x = np.clip(x, space.lower, space.upper)
        x = space.pull_back(np.tile(space.centre, (n, 1)), x)
    if space.satisfies(space.reference):
        x[0] = space.reference
    return x


def reference_start(space: Space) -> Floats:
    """Return the reference values (1, d), SI, as a member of an initial population.

    Raises
    ------
    ConfigurationError
        If they break a bound or a constraint.
    """
    reference = space.reference[None, :]
    if not space.satisfies(reference)[0]:
        raise ConfigurationError(
            'the reference values break the bounds or a constraint; correct them or take initial = "feasible"'
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
    """Mask of the rows that are linear in ln x of the logarithmic parameters, and those rows so written.

    They are the rows without such parameters, and a x_i >= b x_j with both logarithmic, which is
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
    return point, inverse_of_lower(root)


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
