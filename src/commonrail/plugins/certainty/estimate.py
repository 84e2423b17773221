"""Most likely values of a likelihood, its noise among them.

Values given the noise and noise given the residuals, in turn: generalised least squares, iterated. The first round
takes the noise as white; its several starts tell whether the search has converged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.calibration.optimisers.base import farthest
from commonrail.calibration.optimisers.ensemble import groups_of, moved, size_of
from commonrail.calibration.optimisers.least_squares import FeasibleSet, answered, differences
from commonrail.calibration.space import sample_feasible
from commonrail.plugins.certainty.ascent import FEW, Ascent, climb, linearised
from commonrail.plugins.certainty.covariance import Covariance, covariance_of, student
from commonrail.plugins.certainty.likelihood import Likelihood, central_slopes
from commonrail.plugins.certainty.noise_fit import cost_of, sample_count

ROUNDS = 3  # of noise and values
AGREED = 0.5  # of 2 ln L within which ends of the search agree
LEAST_AGREEING = 2  # ends, the best among them
SETTLED = 0.1  # fall of −2 ln L that the last linear model may still promise
SHORT, LONG = 25, 60  # steps of an ascent with few parameters and with more
NEAR = 15  # steps of an ascent from the end of another one
CLOSEST = 40  # members of a library that are compared as starts
WIDEST = 12.0**-0.5  # standard deviation of a position between the bounds of which nothing is known
# Members of an ensemble, or more where there are many parameters, and its steps: of nine parameters of a map and six
# curves, 12 of 12 ensembles drawn between the bounds then were at the right top (`studies/walk_bench.py`).
ENSEMBLE, INVERSIONS = 64, 12


@dataclass(frozen=True)
class Estimate:
    """Most likely values."""

    likelihood: Likelihood  # with the noise that was fitted
    unit: Floats  # (d,), positions between the bounds
    point: Floats  # (d,), values [SI]
    cost: float  # −2 ln L with the priors, without constants
    errors: Floats  # (n,), residuals
    slopes: Floats  # (d, n), their derivatives with respect to the positions
    covariance: Covariance
    gain: float  # fall of the cost that the last linear model still promises
    simulated: int  # points simulated
    ends: Floats  # (k, d), where the starts of the search ended
    starts: int = 1  # of the search
    agreeing: int = 1  # of them that ended within 0.5 of the largest 2 ln L

    @property
    def settled(self) -> bool:
        """True if the search has converged: no gain is left, and enough of several starts agree."""
        return self.gain < SETTLED and (self.starts == 1 or self.agreeing >= min(LEAST_AGREEING, self.starts))

    @property
    def whole_cost(self) -> float:
        """−2 ln L with the priors and with all that depends on the noise, comparable between noises."""
        data = sum(cost_of(block, noise, self.errors[block.rows]) for block, noise in self.likelihood.pairs)
        return float(data + self.likelihood.priors.costs(self.point[None])[0])

    def half_widths(self, level: float = 0.95) -> Floats:
        """Half widths (d,) of intervals by the curvature, in positions: t quantile times the standard error."""
        return np.asarray(student(self.covariance.freedom, level) * np.sqrt(np.diag(self.covariance.noise)))


def estimate(likelihood: Likelihood, starts: Floats, *, first: int | None = None, rounds: int = ROUNDS) -> Estimate:
    """Most likely values from several starts (k, d), positions between the bounds, of which the first is the best.

    `likelihood`: its noise need not be known; `first`: number of parameters that the search begins with, the later ones
    being fixed: far from the best values a prior has no weight, and quantities of the bench would leave it; `rounds`:
    of noise and values. Raises `SimulationError` if the first start cannot be simulated.
    """
    before = likelihood.simulated
    begun = likelihood.residuals(likelihood.space.from_unit(starts[:1]))[0]
    if not np.isfinite(begun).all():
        raise SimulationError("The best values cannot be simulated, so nothing can be said of their certainty.")
    nothing = [0.0] * len(likelihood.blocks)
    white = likelihood.estimated(begun, nothing, correlated=False)
    turns = SHORT if likelihood.space.dimension <= FEW else LONG
    fixed = np.arange(first or likelihood.space.dimension, likelihood.space.dimension)
    ends = climb(white, starts, fixed, turns=turns, tolerance=1e-2)
    simulated = white.simulated
    if len(starts) > 1:  # the first noise is that of a start, which is no measure of how near an end is
        white = likelihood.estimated(ends.best.errors[0], nothing, correlated=False)
        sound = np.isfinite(ends.cost)
        ends = climb(white, ends.unit[sound], fixed, errors=ends.errors[sound], turns=turns, tolerance=1e-2)
        simulated += white.simulated
    if len(fixed):
        ends = climb(white, ends.unit, errors=ends.errors, turns=turns, tolerance=1e-2)
    near, noisy = ends.best, white
    agreeing = int(np.count_nonzero(ends.cost - near.cost < AGREED))
    for last in range(rounds):
        slopes = near.slopes[0]
        if np.isnan(slopes[0, 0]):
            step = np.array([noisy.forward])
            slopes = answered(differences(noisy.space, near.unit, near.errors, step), noisy.residuals)[0]
        covariance = covariance_of(noisy, near.unit[0], slopes, near.errors[0])
        simulated += noisy.simulated if last else 0
        noisy = likelihood.estimated(near.errors[0], covariance.used.tolist(), covariance.root.T @ slopes)
        tolerance = 0.1 if last < rounds - 1 else 1e-2
        near = climb(noisy, near.unit, errors=near.errors, slopes=slopes[None], turns=NEAR, tolerance=tolerance)
        if last == 0 and len(starts) > 1:  # outliers and discrepancies can pull all starts elsewhere under white noise
            others = climb(noisy, ends.unit, errors=ends.errors, slopes=ends.slopes, turns=turns, tolerance=0.1)
            near = Ascent(*(np.concatenate(pair) for pair in zip(near, others, strict=True))).best
            agreeing = int(np.count_nonzero(others.cost - near.cost < AGREED))
    result = replace(estimate_at(noisy, near), starts=len(starts), agreeing=agreeing, ends=ends.unit)
    return replace(result, simulated=simulated + noisy.simulated + likelihood.simulated - before)


def estimate_at(likelihood: Likelihood, end: Ascent, slopes: Floats | None = None) -> Estimate:
    """Estimate at the best end of an ascent, its noise known; `slopes` (d, n): derivatives there if not central."""
    unit, errors = end.best.unit[0], end.best.errors[0]
    slopes = central_slopes(likelihood, unit) if slopes is None else slopes
    return Estimate(
        likelihood=likelihood,
        unit=unit,
        point=likelihood.space.from_unit(unit),
        cost=float(end.best.cost[0]),
        errors=errors,
        slopes=slopes,
        covariance=covariance_of(likelihood, unit, slopes, errors),
        gain=float(linearised(likelihood, unit, slopes, errors).full_step()[1][0]),
        simulated=likelihood.simulated,
        ends=unit[None],
    )


def bounded(covariance: Floats) -> Floats:
    """Covariance (d, d) of positions, none of which is known worse than by its bounds."""
    total = np.array(covariance)
    loose = ~np.isfinite(np.diag(total))
    total[loose, :] = total[:, loose] = 0.0
    total[loose, loose] = WIDEST**2
    shrink = np.minimum(1.0, WIDEST / np.sqrt(np.maximum(np.diag(total), 1e-300)))
    return np.asarray(total * np.outer(shrink, shrink))


def library(likelihood: Likelihood, many: int, seed: int = 0) -> tuple[Floats, Floats]:
    """Random positions (m, d) within bounds and constraints, and their residuals (m, n), without those that fail."""
    points = sample_feasible(likelihood.space, many, np.random.default_rng(seed))
    errors = likelihood.residuals(points)
    sound = np.isfinite(errors).all(axis=1)
    return likelihood.space.to_unit(points[sound]), errors[sound]


def assimilated(likelihood: Likelihood, library: tuple[Floats, Floats], many: int) -> Floats:
    """Starts (k, d), k ≤ `many`: best members of as many ensembles of a library after Kalman inversion, the best first.

    From random members the ascents of more than a few parameters end in as many places, most of them far from any that
    agrees with the data. The ensembles have no member in common, so that ascents do not agree by chance.
    """
    unit, errors = library
    feasible, starts, misfits = FeasibleSet.of(likelihood.space), [], []
    group = groups_of(len(unit), max(len(unit) // ENSEMBLE, 1), unit.shape[1])
    for label in np.unique(group):
        members, simulated = unit[group == label], errors[group == label]
        for _ in range(INVERSIONS):
            scale = np.empty(likelihood.size)  # no noise is known: each data set has the one that its members leave
            for b in likelihood.blocks:
                scale[b.rows] = size_of(simulated[:, b.rows])
            members = moved(feasible, members, simulated / scale)
            simulated = likelihood.residuals(likelihood.space.from_unit(members))
            sound = np.isfinite(simulated).all(axis=1)
            members, simulated = members[sound], simulated[sound]
            if len(members) < 2:
                break
        if len(members):
            misfit = _misfits(likelihood, simulated)
            starts.append(members[int(np.argmin(misfit))])
            misfits.append(float(misfit.min()))
    return np.array(starts).reshape(-1, unit.shape[1])[np.argsort(misfits, kind="stable")[:many]]


def starts_from(likelihood: Likelihood, library: tuple[Floats, Floats], many: int) -> Floats:
    """Starts (k, d): the best member of a library, and of its best ones the members that lie farthest apart."""
    unit, errors = library
    if not len(unit):
        return np.empty((0, likelihood.space.dimension))
    near = unit[np.argsort(_misfits(likelihood, errors), kind="stable")[:CLOSEST]]
    return np.asarray(near[farthest(near, min(many, len(near)))])


def _misfits(likelihood: Likelihood, errors: Floats) -> Floats:
    """Σ n ln Σ|e| over the blocks (k,) of finite residuals (k, n), n without the values at which all agree exactly.

    It needs no noise, and outliers, whose squares lead all starts to another optimum, add little.
    """
    terms = [
        sample_count(errors[:, b.rows]) * np.log(np.maximum(np.sum(np.abs(errors[:, b.rows]), axis=1), 1e-300))
        for b in likelihood.blocks
    ]
    return np.asarray(np.sum(terms, axis=0))
