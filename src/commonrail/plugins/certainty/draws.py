"""Draws from the posterior of a fit: intervals, correlations and bands are summaries of them.

1. Positions from a widened posterior are simulated in batches. A polynomial regression of the residuals on the
   positions replaces the model, and the noise is estimated again from its residuals. This is repeated until centre and
   spread of the posterior converge.
2. The posterior of the regression is drawn by importance sampling from a multivariate t distribution. The weights are
   smoothed (Vehtari, Simpson, Gelman, Yao, Gabry 2024, JMLR 25(72)); scales of the noise are integrated out. If k-hat
   rejects these draws, walkers draw from the posterior (differential evolution; ter Braak 2006, Stat. Comput. 16, 239).
   Neither method simulates.
3. Some of the draws are simulated: k-hat of the ratio of simulated to regressed density decides whether the draws are
   accepted.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.base.stages import tell, telling
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.data.noise import Law
from commonrail.plugins.certainty.ascent import climb
from commonrail.plugins.certainty.covariance import covariance_of
from commonrail.plugins.certainty.estimate import Estimate, bounded
from commonrail.plugins.certainty.likelihood import Likelihood, prior_slopes_at
from commonrail.plugins.certainty.noise_fit import FittedNoise, sample_count

EACH, FEWEST, MOST = 12, 100, 3000  # simulated positions for each coefficient of the regression, and limits
QUADRATIC, CUBIC = 12, 8  # largest numbers of parameters for products and for cubes in the regression
ROUNDS = 6
MOVED, SCALED = 0.3, 0.15  # tolerances of convergence: standard errors of the centre, logarithm of a spread
SPREAD = 2.6  # additional spread of the positions, over the root of the number of parameters
NOISE_TURNS = 3  # alternating estimates of noise and most likely values per regression
STEP_DRAWS, LEFT = 8, 8  # draws for the error of the time step; directions of a regression's residuals
FIRM = 1e-12

DRAWS = 4000  # number from importance sampling
LARGEST_K = 0.7  # largest k-hat of accepted weights (Vehtari et al. 2024)
LEAST_SIZE = 200.0  # least effective number of draws
FREEDOM = 5.0  # of the multivariate t distribution
WALKERS, STEPS, THINNED = 200, 800, 20  # of differential evolution; every `THINNED`th step of the second half is kept
CHECKS = 128  # draws that are simulated
LEAST_SOUND = 0.9  # share of these that must be simulated
LARGEST_GAP = 2.0  # standard deviation of 2 ln L by which the regression may be off


class Draws(NamedTuple):
    """Equally weighted draws from the posterior."""

    unit: Floats  # (m, d), positions between the bounds
    k_hat: float  # of the ratio of simulated to regressed density
    effective: float  # effective number of simulated draws
    gap: float  # standard deviation of 2 ln L, simulated less regression
    rounds: int
    converged: bool  # centre and spread stayed in the last round
    walked: bool  # drawn by walkers, because importance sampling was refused
    checked: int  # draws simulated
    failure: str = ""  # reason why draws from a normal distribution replace the posterior

    @property
    def refusal(self) -> str:
        """Reason to reject the draws; empty if they are accepted."""
        if self.failure:
            return self.failure
        if self.k_hat > LARGEST_K and self.gap > LARGEST_GAP:
            return f"the draws do not follow the simulated likelihood (k-hat {self.k_hat:.2f})"
        return ""


class Regression:
    """Polynomial model of the residuals over positions, scaled about a centre.

    `unit` (m, d) and `errors` (m, n): simulated positions and residuals; `centre` (d,), `root` (d, d): scaling;
    `order`: 2 or 3, without products for more than `QUADRATIC` parameters.
    """

    def __init__(self, unit: Floats, errors: Floats, centre: Floats, root: Floats, order: int) -> None:
        self.centre, self._inverse, d = centre, np.linalg.inv(root), len(centre)
        terms = terms_of(d, order)
        # columns that each term multiplies, padded with the column of ones
        self._columns = np.array([[*term, *([d] * (order - len(term)))] for term in terms])
        features = self.features(unit)
        self.coefficients = np.asarray(np.linalg.lstsq(features, errors, rcond=None)[0], float)  # (terms, n)
        self.left = errors - features @ self.coefficients
        self.free = max(len(unit) - features.shape[1], 1)

    def features(self, unit: Floats) -> Floats:
        """Terms (m, k) at positions (m, d)."""
        z = np.column_stack([(unit - self.centre) @ self._inverse.T, np.ones(len(unit))])
        product = z[:, self._columns[:, 0]]
        for column in self._columns.T[1:]:
            product = product * z[:, column]
        return np.column_stack([z[:, -1:], product])

    def residuals(self, unit: Floats) -> Floats:
        """Residuals (m, n)."""
        return np.asarray(self.features(unit) @ self.coefficients)

    def slopes(self, unit: Floats) -> Floats:
        """Derivatives (d, n) at a position (d,)."""
        step = 1e-3 * np.linalg.inv(self._inverse).T
        ends = self.residuals(np.vstack([unit + step, unit - step]))
        return np.asarray(self._inverse.T @ ((ends[: len(unit)] - ends[len(unit) :]) / 2e-3))

    def directions(self, near: np.ndarray) -> Floats:
        """Courses (k, n) of the regression's residuals at the simulated positions of a mask (m,)."""
        rest = self.left[near] / math.sqrt(max(np.count_nonzero(near) * self.free / len(self.left), 1.0))
        values, vectors = np.linalg.eigh(rest.T @ rest if rest.shape[1] < len(rest) else rest @ rest.T)
        axes = vectors[:, ::-1][:, :LEFT]
        scaled = np.sqrt(np.maximum(values[::-1][:LEFT], 0.0))[:, None] * axes.T
        return np.asarray(scaled if rest.shape[1] < len(rest) else axes.T @ rest)


def terms_of(d: int, order: int) -> list[tuple[int, ...]]:
    """Columns that each term of a polynomial in d variables multiplies."""
    terms = [c for o in range(1, order + 1) for c in itertools.combinations_with_replacement(range(d), o)]
    return terms if d <= QUADRATIC else [c for c in terms if len(c) == 1 or (len(c) == 2 and c[0] == c[1])]


class Posterior:
    """Logarithm of the posterior density of a regression.

    Coordinates are positions, then, for each block under Student's t, the logarithms of its scale over the fitted scale
    and of its degrees of freedom. Other estimated scales are integrated out under a density of 1/scale.

    `likelihood`: likelihood with its noise; `samples`: number of noise samples of each block.
    """

    def __init__(self, likelihood: Likelihood, regression: Regression, samples: list[int]) -> None:
        self.likelihood, self.regression, self.samples = likelihood, regression, samples
        self.d = likelihood.space.dimension
        self.heavy = [i for i, noise in enumerate(likelihood.noises) if noise.law is Law.STUDENT]
        self.feasible = FeasibleSet.of(likelihood.space)
        white = likelihood.whiten(regression.coefficients)
        self._parts = [white[:, block.rows] for block in likelihood.blocks]
        self._grams = [matrix @ matrix.T for matrix in self._parts]

    def prior(self, unit: Floats) -> Floats:
        """Part (m,) of the priors; −inf beyond bounds and constraints."""
        space = self.likelihood.space
        inside = ((unit >= 0.0) & (unit <= 1.0)).all(axis=1) & self.feasible.keep(unit)
        points = space.from_unit(np.clip(unit, 0.0, 1.0))
        inside &= space.satisfies(points) if space.constrained else True
        return np.where(inside, -0.5 * self.likelihood.priors.costs(points), -np.inf)

    def __call__(self, wide: Floats) -> Floats:
        """Logarithm (m,) of the density, without constant, at coordinates (m, d + 2 h)."""
        result = self.prior(wide[:, : self.d])
        sound = np.flatnonzero(np.isfinite(result))
        f = self.regression.features(wide[sound, : self.d])
        for i, noise in enumerate(self.likelihood.noises):
            if noise.law is Law.GAUSSIAN:
                cost = np.einsum("mi,mi->m", f @ self._grams[i], f)
            else:
                cost = self._cost(i, f @ self._parts[i], wide[sound])
            result[sound] -= 0.5 * integrated(self.samples[i], noise, cost)
        return np.where(np.isnan(result), -np.inf, result)

    def simulated(self, wide: Floats, errors: Floats) -> Floats:
        """Logarithm (m,) of the density for simulated residuals (m, n)."""
        innovations, result = self.likelihood.whiten(errors), self.prior(wide[:, : self.d])
        for i, (block, noise) in enumerate(zip(self.likelihood.blocks, self.likelihood.noises, strict=True)):
            result -= 0.5 * integrated(self.samples[i], noise, self._cost(i, innovations[:, block.rows], wide))
        return np.where(np.isfinite(result), result, -np.inf)

    def _cost(self, i: int, innovations: Floats, wide: Floats) -> Floats:
        """Cost (m,) of a block; under Student's t with the scale and the freedom among the coordinates."""
        if i not in self.heavy:
            return np.asarray(np.sum(self.likelihood.noises[i].density.cost(innovations), axis=1))
        at = self.d + 2 * self.heavy.index(i)
        scale, log_freedom = wide[:, at], wide[:, at + 1]
        freedom = np.exp(np.clip(log_freedom, 0.0, math.log(MOST_FREEDOM)))
        u = innovations / np.exp(scale)[:, None]
        constant = special.gammaln(0.5 * (freedom + 1.0)) - special.gammaln(0.5 * freedom) - 0.5 * np.log(freedom)
        cost = np.sum((freedom[:, None] + 1.0) * np.log1p(u * u / freedom[:, None]), axis=1)
        cost += 2.0 * self.samples[i] * (scale - constant)
        noise = self.likelihood.noises[i]
        if noise.stated:  # a scale that is stated or from repeated measurements has its own density
            cost += min(noise.freedom, MOST_KNOWN) * (2.0 * scale + np.exp(-2.0 * scale))
        return np.where((log_freedom < 0.0) | (log_freedom > math.log(MOST_FREEDOM)), np.inf, cost)


MOST_FREEDOM = 60.0  # of Student's t, which is then nearly normal
MOST_KNOWN = 1e3  # degrees of freedom of a stated scale, which is then known to 2 %
MOST_ABSORBED = 0.2  # share of the values that courses absorb, above which the scale is not integrated out


def integrated(samples: int, noise: FittedNoise, cost: Floats) -> Floats:
    """Cost (m,) of a block of `samples`, with the unknown part of its noise scale integrated out."""
    fixed = (noise.stated and np.isinf(noise.freedom)) or noise.absorbed > MOST_ABSORBED * samples
    if noise.law is Law.STUDENT or fixed:  # the sizes of courses do not depend on the scale
        return cost
    twice = 2 if noise.law is Law.LAPLACE else 1  # the mean of its cost is twice as large
    if noise.stated:
        return np.asarray(twice * (samples + twice * noise.freedom) * np.log1p(cost / (twice**2 * noise.freedom)))
    return np.asarray(twice * samples * np.log(np.maximum(cost, 1e-300)))


def smoothed(logs: Floats) -> tuple[Floats, float]:
    """Normalised weights (m,) from their logarithms, with a smoothed tail, and k-hat.

    A generalised Pareto distribution replaces the tail (Vehtari et al. 2024); it is fitted as by Zhang, Stephens (2009,
    Technometrics 51, 316).
    """
    m = len(logs)
    weights = np.exp(np.maximum(logs - logs.max(), -700.0))
    tail = int(min(0.2 * m, 3.0 * math.sqrt(m)))
    order = np.argsort(weights, kind="stable")
    x = weights[order[-tail:]] - weights[order[-tail - 1]]
    quarter = x[int(tail / 4 + 0.5) - 1] if tail >= 5 else 0.0
    if not quarter > 0.0:
        even = weights.sum() ** 2 > 0.9 * m * np.sum(weights**2)  # all weights are equal, except for rounding
        return weights / weights.sum(), -math.inf if even else math.inf
    many = 30 + int(math.sqrt(tail))
    b = 1.0 / x[-1] + (1.0 - np.sqrt(many / (np.arange(1, many + 1) - 0.5))) / (3.0 * quarter)
    shape = np.mean(np.log1p(-b[:, None] * x), axis=1)
    length = tail * (np.log(np.maximum(-b / shape, 1e-300)) - shape - 1.0)
    share = 1.0 / np.sum(np.exp(np.clip(length - length[:, None], -700.0, 700.0)), axis=1)
    mean = float(np.sum(b * share) / share.sum())
    k = float(np.mean(np.log1p(-mean * x)))
    sigma, k = -k / mean, (k * tail + 5.0) / (tail + 10.0)  # a prior of ten values at 0.5 steadies a short tail
    rest = np.log1p(-(np.arange(tail) + 0.5) / tail)
    smooth = sigma * np.expm1(np.minimum(-k * rest, 700.0)) / k if abs(k) > 1e-9 else -sigma * rest
    weights[order[-tail:]] = np.minimum(weights[order[-tail - 1]] + smooth, 1.0)
    return weights / weights.sum(), k


def _importance(posterior: Posterior, centre: Floats, covariance: Floats, rng: np.random.Generator) -> Floats | None:
    """Equally weighted coordinates (m, d + 2 h) about a centre; None if their weights are rejected."""
    d, more = posterior.d, 2 * len(posterior.heavy)
    wide, big = np.append(centre, np.tile([0.0, math.log(4.0)], more // 2)), np.zeros((d + more, d + more))
    big[:d, :d] = covariance
    for at in range(d, d + more, 2):  # scale and freedom at the centre, from a grid
        pairs = [*itertools.product(np.linspace(-2.0, 1.0, 41), np.linspace(0.1, 4.0, 21))]
        grid = np.tile(wide, (len(pairs), 1))
        grid[:, at : at + 2] = pairs
        logs = posterior(grid)
        share = np.exp(logs - logs.max())
        wide = share @ grid / share.sum()
        big[at : at + 2, at : at + 2] = np.cov(grid[:, at : at + 2].T, aweights=share) + np.diag([0.02**2, 0.1**2])
    for turn in range(3):
        root = np.linalg.cholesky(big + FIRM * np.trace(big) / len(big) * np.eye(len(big)))
        z = rng.standard_normal((DRAWS, len(wide))) / np.sqrt(rng.chisquare(FREEDOM, DRAWS) / FREEDOM)[:, None]
        draws = wide + 1.2 * z @ root.T
        logs = posterior(draws) + 0.5 * (FREEDOM + len(wide)) * np.log1p(np.sum(z**2, axis=1) / FREEDOM)
        if not np.isfinite(logs).any():
            return None
        shares, k = smoothed(logs)
        size = 1.0 / float(np.sum(shares**2))
        if k < LARGEST_K and size > LEAST_SIZE and turn:
            places = (rng.random() + np.arange(DRAWS)) / DRAWS
            return np.asarray(draws[np.searchsorted(np.cumsum(shares), places).clip(0, DRAWS - 1)])
        if size < 5 * len(wide):
            return None
        wide = shares @ draws
        big = (shares * (draws - wide).T) @ (draws - wide)
    return None


def _walked(posterior: Posterior, centre: Floats, covariance: Floats, rng: np.random.Generator) -> Floats:
    """Coordinates (m, d + 2 h) from walkers that begin about a centre, half of which move at a time."""
    d, pairs, half = posterior.d, len(posterior.heavy), WALKERS // 2
    away = rng.standard_normal((WALKERS, d)) @ np.linalg.cholesky(0.5 * covariance + FIRM * np.eye(d)).T
    base = posterior.feasible.within(np.tile(centre, (WALKERS, 1)), centre + away)
    scales = np.tile([0.0, math.log(4.0)], (WALKERS, pairs)) + 0.1 * rng.standard_normal((WALKERS, 2 * pairs))
    state, samples = np.hstack([base, scales]), list[Floats]()
    logs = posterior(state)
    for step in range(STEPS):
        for moving, pool in ((slice(0, half), state[half:]), (slice(half, None), state[:half])):
            a, b = rng.integers(len(pool), size=(2, half))
            gamma = 1.0 if step % 10 == 9 else 2.38 / math.sqrt(2 * state.shape[1]) * rng.uniform(0.3, 1.2, (half, 1))
            jitter = 1e-4 * pool.std(axis=0) * rng.standard_normal((half, state.shape[1]))
            asked = state[moving] + gamma * (pool[a] - pool[b]) + jitter
            new = posterior(asked)
            take = np.log(rng.random(half)) < new - np.where(np.isfinite(logs[moving]), logs[moving], -1e300)
            state[moving] = np.where(take[:, None], asked, state[moving])
            logs[moving] = np.where(take, new, logs[moving])
        if step >= STEPS // 2 and step % THINNED == 0:
            samples.append(state.copy())
    return np.concatenate(samples)


def draw(estimate: Estimate, seed: int = 0) -> tuple[Estimate, Draws]:
    """Draws from the posterior around an estimate, and the estimate improved by the draws.

    Raises `SimulationError` if too few positions around the estimate can be simulated.
    """
    likelihood, rng = estimate.likelihood.with_noises(estimate.likelihood.noises), np.random.default_rng(seed)
    population = _Population(likelihood, estimate, rng)
    order, rounds = 2, 0
    while True:
        for _ in range(ROUNDS):
            tell("draws", rounds, ROUNDS, f"{len(population.unit)} positions simulated")
            rounds += 1
            if population.round(order) and rounds > 1:
                break
        wide = population.wide
        walked = wide is None
        if wide is None:
            wide = _walked(population.posterior, population.top, population.local, rng)
        k, size, gap = _checked(population, wide, rng)
        poor = k > LARGEST_K or gap > LARGEST_GAP
        if not poor or order == 3 or len(estimate.unit) > CUBIC:
            break
        order = 3
    draws = Draws(
        np.clip(wide[:, : len(estimate.unit)], 0.0, 1.0), k, size, gap, rounds, population.converged, walked, CHECKS
    )
    return (estimate if draws.refusal else population.better_than(estimate)), draws


def _checked(population: _Population, wide: Floats, rng: np.random.Generator) -> tuple[float, float, float]:
    """K-hat and effective number of draws for the ratio of simulated to regressed density, and their gap."""
    posterior, d = population.posterior, population.posterior.d
    tried = wide[rng.choice(len(wide), CHECKS, replace=False)]
    errors = population.simulate(np.clip(tried[:, :d], 0.0, 1.0))
    sound = np.isfinite(errors).all(axis=1)
    if np.mean(sound) < LEAST_SOUND:
        return math.inf, 0.0, math.inf
    ratio = np.full(CHECKS, -1e6)
    ratio[sound] = posterior.simulated(tried[sound], errors[sound]) - posterior(tried[sound])
    ratio = np.maximum(ratio, -1e6)
    shares, k = smoothed(ratio)
    return k, 1.0 / float(np.sum(shares**2)), 2.0 * float(np.std(ratio[ratio > -1e5])) if sound.any() else math.inf


class _Population:
    """Simulated positions about the posterior, and the regression on them."""

    def __init__(self, likelihood: Likelihood, estimate: Estimate, rng: np.random.Generator) -> None:
        self.likelihood, self._rng, d = likelihood, rng, len(estimate.unit)
        self.centre, self.top = estimate.unit, estimate.unit
        self.local = self.covariance = bounded(estimate.covariance.noise) + FIRM * np.eye(d)
        self.unit, self.errors = np.empty((0, d)), np.empty((0, likelihood.size))
        self.converged, self.wide = False, np.empty((0, d))  # type: bool, Floats | None

    def simulate(self, unit: Floats) -> Floats:
        """Residuals (m, n) of positions (m, d)."""
        return self.likelihood.residuals(self.likelihood.space.from_unit(unit))

    def round(self, order: int) -> bool:
        """Simulate positions from a widened posterior, and draw from the new posterior; true if it has converged."""
        d = len(self.centre)
        root = np.asarray(np.linalg.cholesky(self.covariance), float)
        inverse = np.linalg.inv(root)
        terms = 1 + len(terms_of(d, order))
        many = int(np.clip(EACH * terms, FEWEST, MOST))
        wider = 1.0 + SPREAD / math.sqrt(d)
        drawn = _reflected(self.centre + wider * self._rng.standard_normal((many, d)) @ root.T)
        seen = self.simulate(drawn)
        sound = np.isfinite(seen).all(axis=1)
        radius = wider**2 * (d + 2.0 * math.sqrt(2.0 * d))
        near = np.sum(((self.unit - self.centre) @ inverse.T) ** 2, axis=1) < 2.0 * radius
        self.unit = np.vstack([self.unit[near], drawn[sound]])[-MOST:]
        self.errors = np.vstack([self.errors[near], seen[sound]])[-MOST:]
        if len(self.unit) < 1.5 * terms:
            raise SimulationError(
                f"Only {len(self.unit)} of {len(drawn)} positions about the best values can be simulated, so nothing "
                "can be said of their certainty; correct bounds or constraints, or fix a parameter."
            )
        regression = Regression(self.unit, self.errors, self.centre, root, order)
        inside = np.sum(((self.unit - self.centre) @ inverse.T) ** 2, axis=1) < radius
        directions = np.vstack([regression.directions(inside), self._step_change()])
        self._fit_noise(regression, directions)
        self.wide = _importance(self.posterior, self.top, self.local, self._rng)
        believed = self.wide is not None
        middle = self.wide[:, :d].mean(axis=0) if self.wide is not None else self.top
        spread = np.cov(self.wide[:, :d].T).reshape(d, d) if self.wide is not None else self.local
        moved = np.abs(middle - self.centre) / np.sqrt(np.diag(spread))
        scaled = np.abs(0.5 * np.log(np.diag(spread) / np.diag(self.covariance)))
        self.converged = bool((moved < MOVED).all() and (scaled < SCALED).all())
        self.centre, self.covariance = middle, bounded(spread) + FIRM * np.eye(d)
        return self.converged and believed

    def _step_change(self) -> Floats:
        """Error (k, n) of the residuals due to the time step, at the last positions."""
        if self.likelihood.finer is None:
            return np.empty((0, self.likelihood.size))
        points = self.likelihood.space.from_unit(self.unit[-STEP_DRAWS:])
        change = self.errors[-STEP_DRAWS:] - self.likelihood.finer(points)
        sound = np.isfinite(change).all(axis=1)
        return change[sound].mean(axis=0, keepdims=True) if sound.any() else np.empty((0, self.likelihood.size))

    def _fit_noise(self, regression: Regression, directions: Floats) -> None:
        """Estimate noise and most likely values of a regression alternately."""
        plain = self.likelihood.with_residuals(
            lambda points: regression.residuals(self.likelihood.space.to_unit(points))
        )
        with_courses, top = _with_courses(plain, directions), self.top
        for _ in range(NOISE_TURNS):
            with telling(None):  # progress counts rounds only
                end = climb(with_courses, np.clip(top, 0.0, 1.0)[None], turns=40, tolerance=1e-3)
            top, errors = end.unit[0], end.errors[0]
            slopes = regression.slopes(top)
            covariance = covariance_of(with_courses, top, slopes, errors)
            plain = plain.estimated(
                errors, covariance.used.tolist(), covariance.root.T @ slopes, like=self.likelihood.noises
            )
            with_courses = _with_courses(plain, directions)
        self.top, self._slopes = top, slopes
        tangents, pulls = with_courses.whiten(slopes), prior_slopes_at(with_courses, top)
        metric = tangents @ tangents.T + pulls.T @ pulls + FIRM * np.eye(len(top))
        self.local = bounded(np.asarray(np.linalg.pinv(metric, hermitian=True), float)) + FIRM * np.eye(len(top))
        self.noises, self._whole = plain.noises, with_courses
        samples = [sample_count(errors[block.rows]) for block in with_courses.blocks]
        self.posterior = Posterior(with_courses, regression, samples)

    def better_than(self, before: Estimate) -> Estimate:
        """Estimate at the last regression's optimum, with its noise; `before` if the simulated optimum is worse."""
        likelihood = self.likelihood.with_noises(self._whole.noises)
        errors = self.simulate(np.vstack([self.top, before.unit]))
        points = likelihood.space.from_unit(np.vstack([self.top, before.unit]))
        costs = likelihood.block_costs(likelihood.whiten(errors)).sum(axis=-1) + likelihood.priors.costs(points)
        if not costs[0] <= costs[1] + LARGEST_GAP:
            return before
        covariance = covariance_of(likelihood, self.top, self._slopes, errors[0])
        return replace(
            before,
            likelihood=likelihood,
            unit=self.top,
            point=likelihood.space.from_unit(self.top),
            cost=float(costs[0]),
            gain=0.0,
            errors=errors[0],
            slopes=self._slopes,
            covariance=covariance,
            simulated=before.simulated + self.likelihood.simulated,
        )


def _with_courses(likelihood: Likelihood, courses: Floats) -> Likelihood:
    """Likelihood with additional error courses (k, n)."""
    noises = [
        replace(noise, courses=np.vstack([noise.courses.reshape(-1, block.size), courses[:, block.rows]]))
        for block, noise in zip(likelihood.blocks, likelihood.noises, strict=True)
    ]
    return likelihood.with_noises(noises)


def _reflected(unit: Floats) -> Floats:
    """Positions (m, d), mirrored into the bounds."""
    inside = np.abs(unit)
    return np.clip(np.where(inside > 1.0, 2.0 - inside, inside), 0.0, 1.0)
