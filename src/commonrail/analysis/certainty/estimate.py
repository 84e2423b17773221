"""Most likely values of a likelihood, its noise among them, and their local intervals.

Values given the noise, noise given the residuals, in turn: generalised least squares, iterated. The first round takes
the noise as white, and its several starts tell whether the search has ended.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from commonrail.analysis.certainty.ascent import FEW, Ascent, climb, linearised
from commonrail.analysis.certainty.covariance import Covariance, covariance_of, half_widths, moved_by
from commonrail.analysis.certainty.integrated import with_integration
from commonrail.analysis.certainty.laws import sample_count
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.refits import with_refits
from commonrail.analysis.certainty.secants import secant_slopes, wider
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.optimisers.members import farthest
from commonrail.calibration.sampling import sample_feasible
from commonrail.errors import SimulationError
from commonrail.kinds.noise import Law

__all__ = [
    "ROUNDS",
    "Estimate",
    "estimate",
    "estimate_at",
    "library",
    "starts_from",
    "with_outliers",
    "with_step_error",
]


ROUNDS = 3  # of noise given residuals
AGREED = 0.5  # of 2 ln L within which ends of the search agree
LEAST_AGREEING = 3  # ends, the best among them
SETTLED = 0.01  # fall of −2 ln L that the last linear model may still promise
LAST_STEPS, SHARES = 3, np.array([1.0, 0.5, 0.25])  # of the linear model at the end of a search, tried side by side
SECANTS = 4  # turns of differences over the intervals, and intervals by these
AGREEING = 0.2  # of the logarithm of a variance between two turns, at which they end: 10 % of an interval
LEAST_FALL = 5e-3  # of −2 ln L in a step of the last ascent
SHORT, LONG = 25, 60  # steps of an ascent with few parameters and with more
NEAR = 15  # steps of one under noise that the last one's end showed
CLOSEST = 40  # members of a library that are compared as starts


@dataclass(frozen=True)
class Estimate:
    """Most likely values.

    Attributes
    ----------
    likelihood : Likelihood
        With the noise that was fitted.
    unit, point : (d,)
        Positions between the bounds, and values [SI].
    cost : float
        −2 ln L with the priors, without constants.
    errors : (n,)
        Residuals.
    slopes : (d, n)
        Their derivatives with respect to the positions.
    shifts : (k, n)
        Their changes for one standard deviation of each uncertain quantity.
    bends : (k, n)
        Second changes, halved, for one standard deviation of each, the values moving with it.
    covariance : Covariance
    starts, agreeing : int
        Starts of the search, and how many of them ended within 0.5 of the largest 2 ln L.
    gain : float
        Fall of the cost that the last linear model still promises; zero where its step, tried, brings none.
    simulated : int
        Points simulated.
    """

    likelihood: Likelihood
    unit: Floats
    point: Floats
    cost: float
    errors: Floats
    slopes: Floats
    shifts: Floats
    bends: Floats
    covariance: Covariance
    starts: int
    agreeing: int
    gain: float
    simulated: int

    @property
    def settled(self) -> bool:
        """True if the search has ended: no gain is left, and enough of several starts agree."""
        return self.gain < SETTLED and (self.starts == 1 or self.agreeing >= min(LEAST_AGREEING, self.starts))

    def moved(self, shifts: Floats) -> Floats:
        """Changes (k, d) of the values [SI] by changes (k, n) of the residuals."""
        own = self.likelihood
        tangents, innovations = own.whiten(self.slopes), own.whiten(self.errors)
        move = moved_by(own, self.covariance.inverse, tangents, innovations, own.whiten(shifts))
        return np.asarray(move * own.scaled(self.unit))

    def half_widths(self, level: float = 0.95) -> Floats:
        """Half widths of the local intervals (d,) in positions."""
        return half_widths(self.covariance, level)

    def interval(self, level: float = 0.95) -> tuple[Floats, Floats]:
        """Ends of the local intervals (d,) [SI], which bounds and constraints do not cut."""
        half, space = self.half_widths(level), self.likelihood.space
        linear = half * self.likelihood.scaled(self.unit)
        low, high = self.point - linear, self.point + linear
        if space.logarithmic.any():
            with np.errstate(over="ignore"):
                low = np.where(space.logarithmic, space.from_unit(self.unit - half), low)
                high = np.where(space.logarithmic, space.from_unit(self.unit + half), high)
        return low, high


def library(likelihood: Likelihood, many: int, seed: int = 0) -> tuple[Floats, Floats]:
    """Positions (m, d) drawn where bounds and constraints hold, and their residuals (m, n), without those that fail.

    Parameters
    ----------
    likelihood : Likelihood
    many : int
    seed : int
        Of the draws.
    """
    points = sample_feasible(likelihood.space, many, np.random.default_rng(seed))
    errors = likelihood.residuals(points)
    sound = np.isfinite(errors).all(axis=1)
    return likelihood.space.to_unit(points[sound]), errors[sound]


def starts_from(likelihood: Likelihood, found: tuple[Floats, Floats], many: int) -> Floats:
    """Starts (k, d): the best member of a library, and of its best ones those that lie farthest apart.

    Members are compared by Σ n ln Σ|e| over the blocks: no noise need be known for that, and outliers, whose squares
    lead all starts to another optimum, add little. Values at which all members agree with the data do not count in n.

    Parameters
    ----------
    likelihood : Likelihood
    found : (positions, residuals)
        Of `library`.
    many : int
    """
    unit, errors = found
    if not len(unit):
        return np.empty((0, likelihood.space.dimension))
    sums = [np.sum(np.abs(errors[:, b.rows]), axis=1) for b in likelihood.blocks]
    sizes = [sample_count(errors[:, b.rows]) for b in likelihood.blocks]
    cost = np.sum([n * np.log(np.maximum(s, 1e-300)) for n, s in zip(sizes, sums, strict=True)], axis=0)
    near = unit[np.argsort(cost, kind="stable")[:CLOSEST]]
    return np.asarray(near[farthest(near, min(many, len(near)))])


def estimate(likelihood: Likelihood, starts: Floats, *, rounds: int = ROUNDS) -> Estimate:
    """Most likely values from several starts.

    Parameters
    ----------
    likelihood : Likelihood
        Its noise need not be known.
    starts : (k, d)
        Positions between the bounds; the first is the best one so far.
    rounds : int
        Turns of noise and values.

    Raises
    ------
    SimulationError
        If the first start cannot be simulated.
    """
    before = likelihood.simulated
    first = likelihood.residuals(likelihood.space.from_unit(starts[:1]))[0]
    if not np.isfinite(first).all():
        raise SimulationError("The best values cannot be simulated, so nothing can be said of their certainty.")
    own = likelihood.estimated(first, [0.0] * len(likelihood.blocks), correlated=False)
    short = likelihood.space.dimension <= FEW
    turns, tolerance = (SHORT, 1e-2) if short else (LONG, 1e-3)
    if len(starts) == 1:  # its first noise is not kept, and no other end is compared with
        tolerance = max(tolerance, 0.1)
    ends = climb(own, starts, turns=turns, tolerance=tolerance)
    simulated = own.simulated
    if len(starts) > 1:  # the first noise is that of a start, which is no measure of how near an end is
        best = int(np.argmin(ends.cost))
        own = likelihood.estimated(ends.errors[best], [0.0] * len(likelihood.blocks), correlated=False)
        sound = np.isfinite(ends.cost)
        ends = climb(
            own,
            ends.unit[sound],
            errors=ends.errors[sound],
            slopes=ends.slopes[sound],
            turns=turns,
            tolerance=tolerance,
        )
        simulated += own.simulated
    best = int(np.argmin(ends.cost))
    agreeing = int(np.count_nonzero(ends.cost - ends.cost[best] < AGREED))
    unit, errors, slopes = ends.unit[best], ends.errors[best], ends.slopes[best]
    for last in range(rounds):
        if np.isnan(slopes[0, 0]):
            slopes = own.slopes(unit[None], errors[None])[0]
        known = covariance_of(own, slopes, errors, np.zeros((0, own.size)), own.prior_slopes(unit))
        simulated += own.simulated
        own = likelihood.estimated(errors, known.used.tolist(), known.root.T @ slopes)
        tolerance = 0.1 if last < rounds - 1 else LEAST_FALL
        near = climb(own, unit[None], errors=errors[None], slopes=slopes[None], turns=NEAR, tolerance=tolerance)
        if last == 0 and len(starts) > 1 and _heavier(likelihood, own):
            near, agreeing = _again(own, near, starts, turns)
        unit, errors, slopes = near.unit[0], near.errors[0], near.slopes[0]
    found = with_outliers(_over_intervals(_ended(estimate_at(own, unit, errors, own.jacobian(unit[None])[0]))))
    covariance, refitted = with_refits(found.covariance, own, found.unit)
    simulated += own.simulated + refitted + likelihood.simulated - before
    return replace(found, covariance=covariance, starts=len(starts), agreeing=agreeing, simulated=simulated)


def _heavier(likelihood: Likelihood, own: Likelihood) -> bool:
    """True if outliers were recognised that the first search took for normal noise."""
    stated = [block.noise.law for block in likelihood.blocks]
    return any(law is Law.AUTO and noise.law is not Law.GAUSSIAN for law, noise in zip(stated, own.noises, strict=True))


def _again(own: Likelihood, near: Ascent, starts: Floats, turns: int) -> tuple[Ascent, int]:
    """Best end of all starts under noise with outliers, and the number of ends that agree.

    Outliers can pull the search by least squares, with all of its starts, to another optimum.

    Parameters
    ----------
    own : Likelihood
    near : Ascent
        From the best end of the first search.
    starts : (k, d)
        Of the first search.
    turns : int
    """
    others = climb(own, starts, turns=turns, tolerance=0.1)
    ends = Ascent(*(np.concatenate(pair) for pair in zip(near, others, strict=True)))
    best = int(np.argmin(ends.cost))
    agreeing = int(np.count_nonzero(others.cost - ends.cost[best] < AGREED))
    return Ascent(*(part[best : best + 1] for part in ends)), agreeing


def estimate_at(likelihood: Likelihood, unit: Floats, errors: Floats, slopes: Floats) -> Estimate:
    """Estimate at an end of the search, its noise known; by the curvature alone, see `with_outliers`.

    Parameters
    ----------
    likelihood : Likelihood
    unit : (d,)
    errors : (n,)
        Residuals there.
    slopes : (d, n)
        Their derivatives with respect to the positions.
    """
    point = likelihood.space.from_unit(unit)
    many = len(likelihood.nuisances)
    shifts = np.array([n.shift(point) for n in likelihood.nuisances]).reshape(many, likelihood.size)
    likelihood.simulated += 5 * many
    covariance = covariance_of(likelihood, slopes, errors, shifts, likelihood.prior_slopes(unit))
    ends = FeasibleSet.of(likelihood.space).within(np.tile(unit, (many, 1)), unit + covariance.nuisances)
    moves = likelihood.space.from_unit(ends) - point
    bends = np.zeros((many, likelihood.size))
    for i, nuisance in enumerate(likelihood.nuisances):
        bends[i] = nuisance.bend(point, moves[i])
    innovations = likelihood.whiten(errors)
    cost = float(likelihood.block_costs(innovations).sum() + likelihood.priors.costs(point[None])[0])
    _, gain = _promised(likelihood, unit, slopes, errors, covariance)
    return Estimate(likelihood, unit, point, cost, errors, slopes, shifts, bends, covariance, 1, 1, gain, 0)


def with_outliers(found: Estimate) -> Estimate:
    """The estimate, outliers of Student's t integrated out of its covariance, see `integrated`."""
    own = found.likelihood
    pulls = own.prior_slopes(found.unit)
    return replace(found, covariance=with_integration(found.covariance, own, found.slopes, found.errors, pulls))


def _ended(found: Estimate) -> Estimate:
    """Estimate after the steps of its linear model, as far as they bring it nearer to the top.

    Central differences see a smoother likelihood than the search does: a small fall that they promise and that none of
    the steps brings is its ripple.
    """
    for _ in range(LAST_STEPS):
        before, found = found, _stepped(found)
        if found.unit is before.unit:
            break
    return found


def _over_intervals(found: Estimate) -> Estimate:
    """Estimate whose derivatives are differences over its intervals, see `secants`, and moved as these promise."""
    own, local = found.likelihood, found.covariance
    for _ in range(SECANTS):
        slopes = secant_slopes(own, found.unit, found.errors, found.slopes, found.covariance)
        again = estimate_at(own, found.unit, found.errors, slopes)
        before, after = (np.diag(one.covariance.noise) for one in (found, again))
        found = _stepped(again, slopes)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios = np.nan_to_num(after / before, nan=1.0, posinf=1.0)
        if found is again and (np.abs(np.log(np.maximum(ratios, 1e-300))) < AGREEING).all():
            break
    return with_step_error(replace(found, covariance=wider(found.covariance, local)))


def with_step_error(found: Estimate) -> Estimate:
    """The estimate, its covariance with what the time step of the simulations moves the values by."""
    own, known = found.likelihood, found.covariance
    shift = own.step_error(found.point)
    if not np.isfinite(shift).all():
        return found
    whitened = own.whiten(np.stack([*found.slopes, found.errors, shift]))
    move = moved_by(own, known.inverse, whitened[:-2], whitened[-2], whitened[-1:])
    return replace(found, covariance=known._replace(discrepancy=known.discrepancy + move.T @ move))


def _stepped(found: Estimate, slopes: Floats | None = None) -> Estimate:
    """The estimate after one step of its linear model, or a share of it, if that lowers the cost.

    Parameters
    ----------
    found : Estimate
    slopes : (d, n), optional
        Derivatives to take there; central differences by default.
    """
    own = found.likelihood
    if found.gain < SETTLED:
        return found
    step, _ = _promised(own, found.unit, found.slopes, found.errors, found.covariance)
    ends = FeasibleSet.of(own.space).within(np.tile(found.unit, (len(SHARES), 1)), found.unit + SHARES[:, None] * step)
    points = own.space.from_unit(ends)
    errors = own.residuals(points)
    costs = own.block_costs(own.whiten(errors)).sum(axis=1) + own.priors.costs(points)
    costs = np.where(np.isfinite(costs), costs, np.inf)
    best = int(np.argmin(costs))
    if costs[best] >= found.cost:
        return replace(found, gain=0.0) if found.gain < AGREED else found
    slopes = own.jacobian(ends[best][None])[0] if slopes is None else slopes
    return estimate_at(own, ends[best], errors[best], slopes)


def _promised(
    likelihood: Likelihood, unit: Floats, slopes: Floats, errors: Floats, covariance: Covariance
) -> tuple[Floats, float]:
    """Step of a linear model about a position within bounds and constraints, and the fall of the cost it promises."""
    metric = np.asarray(np.linalg.pinv(covariance.inverse, hermitian=True), float)
    metric += (1e-10 * np.diag(metric).max() + 1e-300) * np.eye(len(unit))
    steps, gains = linearised(likelihood, unit, slopes, errors)._replace(hessian=metric[None]).full_step()
    return steps[0], float(gains[0])
