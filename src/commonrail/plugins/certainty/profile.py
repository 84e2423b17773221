"""Profile likelihood: each parameter moved and held, all others fitted anew, until the likelihood has fallen enough.

All ends of all parameters go on together, in one batch of simulations a round. An end starts from its neighbour along
the tangent, every point is a fit within bounds and constraints, and a point that beats the optimum is reported: the
caller starts anew from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.stages import tell, telling
from commonrail.calibration.optimisers.least_squares import FeasibleSet, constrained_step
from commonrail.plugins.certainty.ascent import climb
from commonrail.plugins.certainty.covariance import student
from commonrail.plugins.certainty.estimate import Estimate

ROUNDS = 6
TURNS = 6  # steps of the fit at each point
CLOSE = 0.05  # relative distance from the wanted fall of the root, at which an end is found
BETTER = 0.5  # rise of 2 ln L by which a point beats the optimum


class ProfileEnd(NamedTuple):
    """One end of a profile."""

    unit: float  # position of the parameter
    value: float  # the same [SI]
    finished: bool  # the likelihood has fallen as far as wanted
    wall: bool  # a bound or a constraint was met before


class Profile(NamedTuple):
    """Profile of a parameter: its ends, and the points on the way."""

    name: str
    low: ProfileEnd
    high: ProfileEnd
    points: Floats  # (m, 2), values [SI] and falls of 2 ln L there, by falling likelihood on each side


class Profiles(NamedTuple):
    """Profiles of several parameters."""

    found: list[Profile]
    better: Floats | None  # (d,), position that beats the optimum, if one was met; the profiles are then not to be used
    simulated: int  # points simulated


class _Ends:
    """Ends of profiles that go on together; arrays have one entry for each end."""

    def __init__(self, estimate: Estimate, which: Sequence[int], level: float) -> None:
        self.estimate, self.own = estimate, estimate.likelihood
        self.feasible = FeasibleSet.of(self.own.space)
        self.column = np.repeat(np.asarray(which, dtype=np.intp), 2)
        self.sign = np.tile([-1.0, 1.0], len(which))
        covariance, freedom = estimate.covariance.noise, estimate.covariance.freedom
        variance = np.diag(covariance)
        self.error = np.sqrt(np.where(np.isfinite(variance), variance, 0.25))[self.column]
        reach = student(freedom, level)[self.column]
        self.wanted = reach * estimate.covariance.beyond[self.column]
        with np.errstate(invalid="ignore", divide="ignore"):  # of a parameter that nothing holds
            tangents = np.where(np.isfinite(variance), covariance / variance, 0.0).T
        self.tangent = tangents[self.column]
        self.tangent[np.arange(len(self.column)), self.column] = 1.0
        self.limit = self._limits()
        many = len(self.column)
        self.at = np.tile(estimate.unit, (many, 1))
        self.step = reach * self.error
        self.inner, self.inner_root = np.zeros(many), np.zeros(many)
        self.outer, self.outer_root = np.full(many, np.inf), np.full(many, np.inf)
        self.done, self.wall = np.zeros(many, bool), np.zeros(many, bool)
        self.seen: list[list[tuple[float, float]]] = [[] for _ in range(many)]
        self.best = self._fall(estimate.errors[None], estimate.unit[None])[0]
        self.better: Floats | None = None

    def _limits(self) -> Floats:
        """Farthest position of each end within bounds and constraints."""
        found = np.empty(len(self.column))
        for k, (i, sign) in enumerate(zip(self.column, self.sign, strict=True)):
            along = np.zeros(self.own.space.dimension)
            along[i] = sign
            if self.feasible.constraints:
                end = linprog(-along, A_ub=-self.feasible.rows, b_ub=-self.feasible.floor, bounds=(None, None)).x
                found[k] = self.estimate.unit[i] if end is None else end[i]
            else:
                found[k] = float(sign > 0.0)
        return found

    def _fall(self, errors: Floats, unit: Floats) -> Floats:
        """Deviance (k,): Σ n ln Σ u² of Gaussian blocks whose scale is estimated, the scaled cost of the others."""
        own, total = self.own, np.zeros(len(errors))
        innovations = own.whiten(errors)
        costs = own.block_costs(innovations)
        for b, noise in enumerate(own.noises):
            if noise.known or noise.law.value != "gaussian":
                total += self.estimate.covariance.ratios[b] * costs[:, b]
            else:
                total += noise.freedom * np.log(np.maximum(costs[:, b], 1e-300))
        return np.asarray(total + own.priors.costs(own.space.from_unit(unit)))

    def round(self) -> None:
        """One point for each end that is not found."""
        live = np.flatnonzero(~self.done)
        origin = self.estimate.unit[self.column[live]]
        wanted = origin + self.sign[live] * self.step[live]
        over = self.sign[live] * (wanted - self.limit[live]) >= 0.0
        wanted = np.where(over, self.limit[live], wanted)
        start = self._start(live, wanted)
        ends = climb(self.own, start, self.column[live], turns=TURNS, tolerance=0.03)
        fall = np.where(np.isfinite(ends.cost), self._fall(ends.errors, ends.unit) - self.best, np.inf)
        self._note(live, wanted, ends.unit, fall)
        root, away = np.sqrt(np.maximum(fall, 0.0)), self.sign[live] * (wanted - origin)
        self.wall[live] = over & (root < self.wanted[live])
        self.done[live] = self.wall[live] | (np.abs(root - self.wanted[live]) < CLOSE * self.wanted[live])
        self.step[live] = away
        self._bracket(live, away, root)

    def _start(self, live: IndexArray, wanted: Floats) -> Floats:
        """Points near the last ones, moved along the tangent, within bounds and constraints."""
        rows, column = np.arange(len(live)), self.column[live]
        start = self.at[live] + self.tangent[live] * (wanted - self.at[live, column])[:, None]
        start = np.clip(start, 0.0, 1.0)
        start[rows, column] = wanted
        for k in np.flatnonzero(~self.feasible.keep(start)):
            free = np.delete(np.arange(start.shape[1]), column[k])
            own = self.feasible.rows[:, free]
            start[k, free] += constrained_step(
                np.eye(len(free)), np.zeros(len(free)), own, self.feasible.floor - self.feasible.rows @ start[k]
            )
        return np.asarray(start)

    def _note(self, live: IndexArray, wanted: Floats, unit: Floats, fall: Floats) -> None:
        good = np.isfinite(fall)
        self.at[live[good]] = unit[good]
        values = self.own.space.from_unit(unit)
        for k, end in enumerate(live):
            if good[k]:
                self.seen[end].append((float(values[k, self.column[end]]), float(fall[k])))
        if good.any() and fall[good].min() < -BETTER:
            self.better = unit[int(np.argmin(np.where(good, fall, np.inf)))]

    def _bracket(self, live: IndexArray, away: Floats, root: Floats) -> None:
        """Next distances: the secant of the root of the fall, or farther out."""
        wanted, error = self.wanted[live], self.error[live]
        beyond = root >= wanted
        nearer = beyond & (away < self.outer[live])
        self.outer[live] = np.where(nearer, away, self.outer[live])
        self.outer_root[live] = np.where(nearer, root, self.outer_root[live])
        farther = ~beyond & (away > self.inner[live])
        self.inner_root[live] = np.where(farther, root, self.inner_root[live])
        self.inner[live] = np.where(farther, away, self.inner[live])
        a, za, b, zb = self.inner[live], self.inner_root[live], self.outer[live], self.outer_root[live]
        inside = np.where(np.isfinite(zb), (wanted - za) / np.maximum(zb - za, 1e-9), 0.5)
        with np.errstate(invalid="ignore"):
            secant = a + np.clip(inside, 0.05, 0.95) * (b - a)
        longest = 3.0 * np.maximum(a, error)
        out = a + np.clip((wanted - za) / np.maximum(za, 0.2 * wanted) * np.maximum(a, error), 0.3 * error, longest)
        self.step[live] = np.where(self.done[live], self.step[live], np.where(np.isfinite(b), secant, out))

    def end(self, k: int) -> ProfileEnd:
        """Result of an end."""
        i = int(self.column[k])
        unit = float(np.clip(self.estimate.unit[i] + self.sign[k] * self.step[k], 0.0, 1.0))
        point = self.estimate.unit.copy()
        point[i] = unit
        value = float(self.own.space.from_unit(point)[i])
        return ProfileEnd(unit, value, bool(self.done[k] and not self.wall[k]), bool(self.wall[k]))


def profiles_of(estimate: Estimate, which: Sequence[int] | None = None, level: float = 0.95) -> Profiles:
    """Profiles of parameters.

    `which`: columns of the parameters; all by default; `level`: share of intervals that hold the truth. An end takes at
    most `ROUNDS` points. Returns as soon as a point beats the optimum, with that point in `better`.
    """
    likelihood = estimate.likelihood
    columns = list(range(likelihood.space.dimension)) if which is None else list(which)
    before = likelihood.simulated
    ends = _Ends(estimate, columns, level)
    for done in range(ROUNDS):
        if ends.done.all() or ends.better is not None:
            break
        tell("profiles", done, ROUNDS, f"{ends.done.sum()} of {len(ends.done)} ends found")
        with telling(None):  # a round is a step
            ends.round()
    found = [
        Profile(
            likelihood.names[i],
            ends.end(2 * k),
            ends.end(2 * k + 1),
            np.array(sorted(ends.seen[2 * k] + ends.seen[2 * k + 1])).reshape(-1, 2),
        )
        for k, i in enumerate(columns)
    ]
    return Profiles(found, ends.better, likelihood.simulated - before)


def fall_along(estimate: Estimate, distances: Sequence[float]) -> Floats:
    """Falls (k, d, 2) of 2 ln L below and above each parameter, the others moved along with it as the curvature says.

    NaN beyond bounds and constraints, and where a simulation fails.

    `distances` (k,): in standard errors of the curvature.
    """
    likelihood, d = estimate.likelihood, len(estimate.unit)
    ends = _Ends(estimate, range(d), 0.95)
    live = np.arange(2 * d)
    error = ends.error / estimate.covariance.beyond[ends.column]
    origin = estimate.unit[ends.column]
    wanted = [origin + ends.sign * distance * error for distance in distances]
    units = np.concatenate([ends._start(live, one) for one in wanted])
    falls = ends._fall(likelihood.residuals(likelihood.space.from_unit(units)), units) - ends.best
    over = np.concatenate([ends.sign * (one - ends.limit) >= 0.0 for one in wanted])
    return np.where(over, np.nan, falls).reshape(len(distances), d, 2)


# Comparison of the curvature with the simulated likelihood, one and two standard errors from the most likely values.
#
# A likelihood ripples where samples on steep flanks, or innovations of correlated noise, change faster with a
# parameter than its standard error. The curvature at one point of a ripple is then no measure of the error.

DISTANCES = (1.0, 2.0)  # standard errors: within and at the end of a 95 % interval
MOST_RATIO = 1.2  # an interval 1.2 times too short holds 90 % instead of 95 % (normal distribution, 1.96/1.2)


class Ripple(NamedTuple):
    """Curvature against simulated likelihood."""

    # (d,), largest distance at which the simulated likelihood has fallen as far as the curvature promises at one, in
    # distances; infinite where it does not fall, NaN where no point could be simulated
    ratios: Floats
    rippled: Bools  # (d,), true where a ratio, of any distance and side, lies outside 1/`MOST_RATIO` … `MOST_RATIO`
    simulated: int  # points simulated


def ripple_of(estimate: Estimate) -> Ripple:
    """Ratios of an estimate, from 4 d simulations in one batch."""
    before = estimate.likelihood.simulated
    falls = fall_along(estimate, DISTANCES)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.array(DISTANCES)[:, None, None] / np.sqrt(np.maximum(falls, 0.0))
    ratios = np.where(np.isfinite(falls), ratios, np.nan)
    outside = np.asarray((ratios > MOST_RATIO) | (ratios < 1.0 / MOST_RATIO))
    largest = np.max(np.where(np.isnan(ratios), 0.0, ratios), axis=(0, 2))
    known = np.isfinite(falls).any(axis=(0, 2))
    return Ripple(
        np.where(known, largest, np.nan), np.asarray(outside.any(axis=(0, 2))), estimate.likelihood.simulated - before
    )
