"""Most likely values of a likelihood, its noise among them, and their local intervals.

Values given the noise, noise given the residuals, in turn: generalised least squares, iterated. The first round takes
the noise as white, and its several starts tell whether the search has ended.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import special

from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.calibration.optimisers.base import farthest
from commonrail.calibration.optimisers.ensemble import groups_of, moved, size_of
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.space import sample_feasible
from commonrail.data.noise import Law
from commonrail.plugins.certainty.ascent import FEW, Ascent, climb, covariance_at, linearised
from commonrail.plugins.certainty.covariance import Covariance, covariance_of, shifts_by, student, with_integration
from commonrail.plugins.certainty.likelihood import Likelihood, central_slopes
from commonrail.plugins.certainty.noise_fit import sample_count
from commonrail.plugins.certainty.nuisance import SIDES, Nuisance

# Derivatives over the width of the intervals: differences between points three standard errors to both sides.
#
# A likelihood ripples where timing moves samples on steep flanks, the more so where correlated noise is whitened:
# within a fraction of a standard error its slope differs from that over the whole interval. Derivatives at a point
# then state errors that are too small. Differences along the principal axes of the covariance, as long as the interval
# itself, average the ripple; they and the covariance that follows from them are repeated until both agree.

REACH = 3.0  # standard errors; chosen, beyond the two at which an interval of 95 % ends
LONGEST = 0.1  # of the range of a parameter: beyond it curvature counts, which the ripple is not
SHORTEST = 0.1  # of the reach, below which bounds and constraints leave no difference to be taken


def secant_slopes(
    likelihood: Likelihood, unit: Floats, errors: Floats, slopes: Floats, covariance: Covariance
) -> Floats:
    """Derivatives (d, n) of the residuals with respect to the positions, from differences along the principal axes.

    2 d points are simulated in one batch, within the bounds and straight constraints (see `FeasibleSet`). Along an axis
    that these close, or where a simulation fails, the given derivatives stay; so do those of parameters that nothing
    holds.

    `likelihood`: with its noise; `unit` (d,): position between the bounds; `errors` (n,): residuals there; `slopes` (d,
    n): derivatives at the point; `covariance`: by noise.
    """
    held = np.isfinite(np.diag(covariance.noise))
    values, vectors = np.linalg.eigh(covariance.noise[np.ix_(held, held)])
    good = values > 0.0
    if not good.all() or not held.any():
        return slopes
    axes = np.zeros((len(values), len(unit)))
    axes[:, held] = (vectors * np.sqrt(values)).T
    reach = np.minimum(REACH, LONGEST / np.maximum(np.abs(axes).max(axis=1), 1e-300))
    feasible = FeasibleSet.of(likelihood.space)
    ahead, behind = (np.minimum(reach, _distance(feasible, unit, sign * axes)) for sign in (1.0, -1.0))
    points = np.concatenate([unit + ahead[:, None] * axes, unit - behind[:, None] * axes])
    found = likelihood.residuals(likelihood.space.from_unit(np.clip(points, 0.0, 1.0)))  # cuts rounding only
    difference = found[: len(axes)] - found[len(axes) :]
    local = axes @ slopes
    usable = (ahead + behind > SHORTEST * reach) & np.isfinite(difference).all(axis=1)
    length = np.where(usable, ahead + behind, 1.0)
    along = np.where(usable[:, None], difference / length[:, None], local)
    result = slopes.copy()
    result[held] = np.linalg.solve(axes[:, held], along - axes[:, ~held] @ slopes[~held])
    return result


def _distance(feasible: FeasibleSet, unit: Floats, axes: Floats) -> Floats:
    """Farthest multiples (k,) of axes (k, d) that bounds and constraints allow from a position (d,)."""
    rates = axes @ feasible.rows.T
    left = np.maximum(feasible.rows @ unit - feasible.floor, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(rates < 0.0, left / -rates, np.inf).min(axis=1))


def wider(found: Covariance, local: Covariance) -> Covariance:
    """The covariance by differences, no parameter's error smaller than by the derivatives at the point.

    `found`: by differences over the interval; `local`: by derivatives at the point.
    """
    both = np.isfinite(np.diag(found.noise)) & np.isfinite(np.diag(local.noise))
    variances = np.where(both, np.diag(found.noise), 1.0)
    scale = np.sqrt(np.maximum(np.where(both, np.diag(local.noise), 1.0) / np.maximum(variances, 1e-300), 1.0))
    return found._replace(noise=found.noise * np.outer(scale, scale))


# Moves of the estimates by uncertain quantities, from fits with each a standard deviation off.
#
# The likelihood of a curve ripples along the path on which the parameters imitate a delay: derivatives at the most
# likely values promise a quarter of the move at one place and all of it at another. Where they promise a quarter of a
# parameter's error by noise, or more, the parameters are fitted anew with the quantity a standard deviation above and
# below.

LARGE = 0.25  # move over standard error by noise, from which it is taken from fits
TURNS, TOLERANCE = 8, 0.05  # of each fit


def with_refits(known: Covariance, likelihood: Likelihood, unit: Floats) -> tuple[Covariance, int]:
    """The covariance with large moves by uncertain quantities taken from fits, and the points simulated.

    A move is the root mean square of those to both sides, with the signs of the longer one. Bounds and constraints are
    not projected out: where a fit ends at one, derivatives count too.

    `known`: whose moves are those of derivatives; `likelihood`: with its noise; `unit` (d,): position of the most
    likely values.
    """
    moves, simulated = known.nuisances.copy(), 0
    errors = np.sqrt(np.diag(known.noise))
    for i, nuisance in enumerate(likelihood.nuisances):
        if (np.abs(moves[i]) > LARGE * errors).any():
            moves[i], more = _move(likelihood, unit, nuisance, moves[i])
            simulated += more
    return known._replace(nuisances=moves), simulated


def _move(likelihood: Likelihood, unit: Floats, nuisance: Nuisance, linear: Floats) -> tuple[Floats, int]:
    """Move (d,) of the estimates by a standard deviation of a quantity, and the points simulated.

    `unit` (d,); `linear` (d,): the move that derivatives promise.
    """
    feasible, simulated = FeasibleSet.of(likelihood.space), 0
    ends: list[Floats] = []
    floor = np.zeros_like(linear)
    for side in nuisance.sides if nuisance.sides == SIDES else ():
        with_side = likelihood.with_space(likelihood.space, partial(nuisance.residuals, side)).with_noises(
            likelihood.noises
        )
        starts = feasible.within(np.tile(unit, (2, 1)), unit + np.array([[0.0], [side]]) * linear)
        found = climb(with_side, starts, turns=TURNS, tolerance=TOLERANCE)
        simulated += with_side.simulated
        best = int(np.argmin(found.cost))
        if np.isfinite(found.cost[best]):
            ends.append(side * (found.unit[best] - unit))
            if feasible.active(found.unit[best]).any():
                floor = np.abs(linear)
    if not ends:
        return linear, simulated
    longer = max(ends, key=lambda end: float(end @ end))
    size = np.maximum(np.sqrt(np.mean(np.square(ends), axis=0)), floor)
    return np.where(longer < 0.0, -size, size), simulated


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
# A likelihood that ripples has many tops, of which some units of 2 ln L, an accident of the noise, make one the best.
# Tops within the joint region of the best one are not excluded by the data: three of them are agreement. An interval of
# 95 % ends where 2 ln L has fallen by `SEEN`: a top that is less low must be inside, and one that is lower says, by a
# parabola through it, how far the interval reaches at least.
JOINT, SEEN = 0.95, 3.84
NEARBY, DISTANCE = 4, 2.0  # starts about the end of a single ascent, and their distance in standard errors
CLOSEST = 40  # members of a library that are compared as starts
# Members of an ensemble, or more where there are many parameters, and its steps: of nine parameters of a map and six
# curves, 12 of 12 ensembles drawn between the bounds then were at the right top (`tools/walk_bench.py`).
ENSEMBLE, INVERSIONS = 64, 12


@dataclass(frozen=True)
class Estimate:
    """Most likely values."""

    likelihood: Likelihood  # with the noise that was fitted
    # (d,), positions between the bounds, and values [SI]
    unit: Floats
    point: Floats
    cost: float  # −2 ln L with the priors, without constants
    errors: Floats  # (n,), residuals
    slopes: Floats  # (d, n), their derivatives with respect to the positions
    shifts: Floats  # (k, n), their changes for one standard deviation of each uncertain quantity
    second_changes: (
        Floats  # (k, n), second changes, halved, for one standard deviation of each, the values moving with it
    )
    covariance: Covariance
    # starts of the search, and how many of them ended within 0.5 of the largest 2 ln L, or at tops of a ripple within
    # the joint region of the best one
    starts: int
    agreeing: int
    gain: float  # fall of the cost that the last linear model still promises; zero where its step, tried, brings none
    simulated: int  # points simulated
    ends: Floats  # (k, d), where the starts of the search ended
    beyond_ripple: bool = False  # they agree, but only as several tops of a ripple

    @property
    def settled(self) -> bool:
        """True if the search has ended: no gain is left, and enough of several starts agree."""
        return self.gain < SETTLED and (self.starts == 1 or self.agreeing >= min(LEAST_AGREEING, self.starts))

    def apart(self, unit: Floats) -> float:
        """Largest distance of a position (d,) from its own, in standard errors."""
        return float(np.max(np.abs(unit - self.unit) / np.sqrt(np.diag(self.covariance.total))))

    def position_shifts(self, shifts: Floats) -> Floats:
        """Changes (k, d) of the positions by changes (k, n) of the residuals."""
        likelihood = self.likelihood
        tangents, innovations = likelihood.whiten(self.slopes), likelihood.whiten(self.errors)
        return shifts_by(likelihood, self.covariance.inverse, tangents, innovations, likelihood.whiten(shifts))

    def value_shifts(self, shifts: Floats) -> Floats:
        """Changes (k, d) of the values [SI] by changes (k, n) of the residuals."""
        return np.asarray(self.position_shifts(shifts) * self.likelihood.scaled(self.unit))

    def with_errors(self, moves: Floats) -> Estimate:
        """The estimate, its covariance with errors of the positions that add up to moves (k, d)."""
        known = self.covariance
        return replace(self, covariance=known._replace(discrepancy=known.discrepancy + moves.T @ moves))

    def half_widths(self, level: float = 0.95) -> Floats:
        """Half widths of the local intervals (d,) in positions: t quantile of the noise times the total error."""
        return np.asarray(student(self.covariance.freedom, level) * np.sqrt(np.diag(self.covariance.total)))

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

    `seed`: of the draws.
    """
    points = sample_feasible(likelihood.space, many, np.random.default_rng(seed))
    errors = likelihood.residuals(points)
    sound = np.isfinite(errors).all(axis=1)
    return likelihood.space.to_unit(points[sound]), errors[sound]


def assimilated(likelihood: Likelihood, found: tuple[Floats, Floats], many: int) -> Floats:
    """Starts (k, d), k ≤ `many`: best members of as many ensembles, the best of all, after some Kalman inversion.

    From random members the ascents of more than a few parameters end in as many places, most of them far from any that
    agrees with the data. The ensembles have no member in common: that their ascents agree is no chance, though all
    may be led to one place that is not the best.

    `found` (positions, residuals): of `library`.
    """
    unit, errors = found
    feasible, starts, misfits = FeasibleSet.of(likelihood.space), [], []
    group = groups_of(len(unit), max(len(unit) // ENSEMBLE, 1), unit.shape[1])
    for one in np.unique(group):
        own, seen = unit[group == one], errors[group == one]
        for _ in range(INVERSIONS):
            scale = np.empty(likelihood.size)  # no noise is known: each data set has that which its members leave
            for b in likelihood.blocks:
                scale[b.rows] = size_of(seen[:, b.rows])
            own = moved(feasible, own, seen / scale)
            seen = likelihood.residuals(likelihood.space.from_unit(own))
            sound = np.isfinite(seen).all(axis=1)
            own, seen = own[sound], seen[sound]
            if len(own) < 2:
                break
        if len(own):
            left = _misfits(likelihood, seen)
            starts.append(own[int(np.argmin(left))])
            misfits.append(float(left.min()))
    return np.array(starts).reshape(-1, unit.shape[1])[np.argsort(misfits, kind="stable")[:many]]


def _misfits(likelihood: Likelihood, errors: Floats) -> Floats:
    """Σ n ln Σ|e| over the blocks (k,) of residuals (k, n); +inf where a simulation failed.

    No noise need be known for it, and outliers, whose squares lead all starts to another optimum, add little. Values at
    which all members agree with the data do not count in n.
    """
    sound = np.isfinite(errors).all(axis=1)
    terms = [
        sample_count(errors[sound][:, b.rows]) * np.log(np.maximum(np.sum(np.abs(errors[:, b.rows]), axis=1), 1e-300))
        for b in likelihood.blocks
    ]
    return np.where(sound, np.sum(terms, axis=0), np.inf)


def starts_from(likelihood: Likelihood, found: tuple[Floats, Floats], many: int) -> Floats:
    """Starts (k, d): the best member of a library by `_misfits`, and of its best ones those that lie farthest apart.

    `found` (positions, residuals): of `library`.
    """
    unit, errors = found
    if not len(unit):
        return np.empty((0, likelihood.space.dimension))
    near = unit[np.argsort(_misfits(likelihood, errors), kind="stable")[:CLOSEST]]
    return np.asarray(near[farthest(near, min(many, len(near)))])


def estimate(likelihood: Likelihood, starts: Floats, *, rounds: int = ROUNDS, other_tops: bool = False) -> Estimate:
    """Most likely values from several starts.

    `likelihood`: its noise need not be known; `starts` (k, d): positions between the bounds; the first is the best one
    so far; `rounds`: turns of noise and values; `other_tops`: let those of a rippled likelihood
    widen the intervals, and settle a search that ended at several.
    Raises `SimulationError` if the first start cannot be simulated.
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
        own = likelihood.estimated(ends.best.errors[0], [0.0] * len(likelihood.blocks), correlated=False)
        sound = np.isfinite(ends.cost)
        unit, errors, slopes = (part[sound] for part in (ends.unit, ends.errors, ends.slopes))
        ends = climb(own, unit, errors=errors, slopes=slopes, turns=turns, tolerance=tolerance)
        simulated += own.simulated
    near = ends.best
    agreeing = int(np.count_nonzero(ends.cost - near.cost < AGREED))
    for last in range(rounds):
        known, slopes = covariance_at(own, near)
        simulated += own.simulated
        own = likelihood.estimated(near.errors[0], known.used.tolist(), known.root.T @ slopes)
        tolerance = 0.1 if last < rounds - 1 else LEAST_FALL
        near = climb(own, near.unit, errors=near.errors, slopes=slopes[None], turns=NEAR, tolerance=tolerance)
        if last == 0 and len(starts) > 1 and _heavier(likelihood, own):
            near, agreeing = _again(own, near, starts, turns)
    found = replace(_at_top(own, near), starts=len(starts), agreeing=agreeing, ends=ends.unit)
    # points about a single end find tops beside it alone: on a virtual bench of nine parameters three were pinned to
    # values four standard errors off
    if other_tops and (len(starts) > 1 or (short and not found.settled)):
        found = _with_other_tops(found)
    covariance, refitted = with_refits(found.covariance, own, found.unit)
    simulated += own.simulated + refitted + likelihood.simulated - before
    return replace(found, covariance=covariance, simulated=simulated)


def _at_top(own: Likelihood, near: Ascent) -> Estimate:
    """Estimate at the end of one ascent under its noise."""
    unit, errors = near.unit[0], near.errors[0]
    return with_outliers(_over_intervals(_ended(estimate_at(own, unit, errors, central_slopes(own, unit[None])[0]))))


def _with_other_tops(found: Estimate) -> Estimate:
    """The estimate, its intervals widened by other tops of a rippled likelihood, which may settle the search.

    All ends ascend under its noise; for a single one, points about it do. Those within the joint region of the best one
    widen the intervals, and if there are enough, the search has settled.
    """
    own, ends = found.likelihood, found.ends
    single = len(ends) == 1
    if single:
        draws = np.random.default_rng(0).normal(size=(NEARBY, len(found.unit)))
        ends = found.unit + DISTANCE * draws @ found.covariance.root.T
    unit = FeasibleSet.of(own.space).within(np.tile(found.unit, (len(ends), 1)), ends)
    tops = climb(own, unit, turns=NEAR, tolerance=0.1)
    if tops.best.cost[0] < found.cost - AGREED:
        agreeing = int(np.count_nonzero(tops.cost - tops.best.cost < AGREED))
        found = replace(_at_top(own, tops.best), starts=found.starts, agreeing=agreeing, ends=found.ends)
    rise = np.maximum(tops.cost - found.cost, 0.0)
    same = rise < special.chdtri(len(found.unit), 1.0 - JOINT)
    many = int(np.count_nonzero(same))
    reach = (tops.unit[same] - found.unit) / np.sqrt(np.maximum(rise[same], SEEN))[:, None]
    longest = np.abs(reach).max(axis=0, initial=0.0)
    together = np.sqrt(np.sum(reach**2, axis=0))
    found = found.with_errors(reach * longest / np.where(together > 0.0, together, 1.0))
    # at a bound the other parameters take what the data ask for beyond it, all starts alike: with a valve lift fixed
    # 20 % wrong, four were pinned to wrong values that way
    if found.settled or FeasibleSet.of(own.space).active(found.unit, near=1e-3).any():
        return found
    if many < min(LEAST_AGREEING, len(ends)):
        return found if single else replace(found, agreeing=max(many, 1))
    return replace(found, gain=0.0, agreeing=1 if single else many, beyond_ripple=True)


def _heavier(likelihood: Likelihood, own: Likelihood) -> bool:
    """True if outliers were recognised that the first search took for normal noise."""
    stated = [block.noise.law for block in likelihood.blocks]
    return any(law is Law.AUTO and noise.law is not Law.GAUSSIAN for law, noise in zip(stated, own.noises, strict=True))


def _again(likelihood: Likelihood, near: Ascent, starts: Floats, turns: int) -> tuple[Ascent, int]:
    """Best end of all starts under noise with outliers, and the number of ends that agree.

    Outliers can pull the search by least squares, with all of its starts, to another optimum.

    `near`: from the best end of the first search; `starts` (k, d): of the first search.
    """
    others = climb(likelihood, starts, turns=turns, tolerance=0.1)
    best = Ascent(*(np.concatenate(pair) for pair in zip(near, others, strict=True))).best
    return best, int(np.count_nonzero(others.cost - best.cost < AGREED))


def estimate_at(likelihood: Likelihood, unit: Floats, errors: Floats, slopes: Floats) -> Estimate:
    """Estimate at an end of the search, its noise known; by the curvature alone, see `with_outliers`.

    `unit` (d,); `errors` (n,): residuals there; `slopes` (d, n): their derivatives with respect to the positions.
    """
    point = likelihood.space.from_unit(unit)
    many = len(likelihood.nuisances)
    shifts = np.array([n.shift(point) for n in likelihood.nuisances]).reshape(many, likelihood.size)
    likelihood.simulated += 5 * many
    covariance = covariance_of(likelihood, unit, slopes, errors, shifts)
    ends = FeasibleSet.of(likelihood.space).within(np.tile(unit, (many, 1)), unit + covariance.nuisances)
    moves = likelihood.space.from_unit(ends) - point
    second_changes = np.zeros((many, likelihood.size))
    for i, nuisance in enumerate(likelihood.nuisances):
        second_changes[i] = nuisance.second_change(point, moves[i])
    innovations = likelihood.whiten(errors)
    cost = float(likelihood.block_costs(innovations).sum() + likelihood.priors.costs(point[None])[0])
    _, gain = _promised(likelihood, unit, slopes, errors, covariance)
    return Estimate(
        likelihood, unit, point, cost, errors, slopes, shifts, second_changes, covariance, 1, 1, gain, 0, unit[None]
    )


def with_outliers(found: Estimate) -> Estimate:
    """The estimate, outliers of Student's t integrated out of its covariance, see `covariance`."""
    covariance = with_integration(found.covariance, found.likelihood, found.unit, found.slopes, found.errors)
    return replace(found, covariance=covariance)


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
    """Estimate whose derivatives are `secant_slopes` over its intervals, and moved as these promise."""
    likelihood, local = found.likelihood, found.covariance
    for _ in range(SECANTS):
        slopes = secant_slopes(likelihood, found.unit, found.errors, found.slopes, found.covariance)
        again = estimate_at(likelihood, found.unit, found.errors, slopes)
        before, after = (np.diag(one.covariance.noise) for one in (found, again))
        found = _stepped(again, slopes)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios = np.nan_to_num(after / before, nan=1.0, posinf=1.0)
        if found is again and (np.abs(np.log(np.maximum(ratios, 1e-300))) < AGREEING).all():
            break
    return with_step_error(replace(found, covariance=wider(found.covariance, local)))


def with_step_error(found: Estimate) -> Estimate:
    """The estimate, its covariance with what the time step of the simulations moves the values by.

    By a step a quarter as long: at least 3/4 of the step's whole error, which falls with the step or faster.
    """
    likelihood, point = found.likelihood, found.point[None]
    if likelihood.finer is None:
        return found
    shift = likelihood.residuals(point) - likelihood.finer(point)
    likelihood.simulated += 1
    return found.with_errors(found.position_shifts(shift)) if np.isfinite(shift).all() else found


def _stepped(found: Estimate, slopes: Floats | None = None) -> Estimate:
    """The estimate after one step of its linear model, or a share of it, if that lowers the cost.

    `slopes` (d, n): derivatives to take there; central differences by default.
    """
    likelihood = found.likelihood
    if found.gain < SETTLED:
        return found
    step, _ = _promised(likelihood, found.unit, found.slopes, found.errors, found.covariance)
    ends = FeasibleSet.of(likelihood.space).within(
        np.tile(found.unit, (len(SHARES), 1)), found.unit + SHARES[:, None] * step
    )
    points = likelihood.space.from_unit(ends)
    errors = likelihood.residuals(points)
    costs = likelihood.block_costs(likelihood.whiten(errors)).sum(axis=1) + likelihood.priors.costs(points)
    costs = np.where(np.isfinite(costs), costs, np.inf)
    best = int(np.argmin(costs))
    if costs[best] >= found.cost:
        return replace(found, gain=0.0) if found.gain < AGREED else found
    slopes = central_slopes(likelihood, ends[best][None])[0] if slopes is None else slopes
    return estimate_at(likelihood, ends[best], errors[best], slopes)


def _promised(
    likelihood: Likelihood, unit: Floats, slopes: Floats, errors: Floats, covariance: Covariance
) -> tuple[Floats, float]:
    """Step of a linear model about a position within bounds and constraints, and the fall of the cost it promises."""
    metric = np.asarray(np.linalg.pinv(covariance.inverse, hermitian=True), float)
    metric += (1e-10 * np.diag(metric).max() + 1e-300) * np.eye(len(unit))
    steps, gains = linearised(likelihood, unit, slopes, errors)._replace(hessian=metric[None]).full_step()
    return steps[0], float(gains[0])


WIDEST = 12.0**-0.5  # standard deviation of a position between the bounds of which nothing is known


def bounded(estimate: Estimate) -> Floats:
    """Covariance (d, d) of the positions, of which none is known worse than to lie between the bounds."""
    total = np.array(estimate.covariance.total)
    loose = ~np.isfinite(np.diag(total))
    total[loose, :] = total[:, loose] = 0.0
    total[loose, loose] = WIDEST**2
    shrink = np.minimum(1.0, WIDEST / np.sqrt(np.maximum(np.diag(total), 1e-300)))
    return np.asarray(total * np.outer(shrink, shrink))
