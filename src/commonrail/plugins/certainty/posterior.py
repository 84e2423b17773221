"""Draws from the posterior of a fit by ensembles of walkers (emcee), and the refusal to use them before they agree.

Several ensembles that know nothing of each other start from an over-dispersed distribution about the most likely
values. A step is differential evolution among the walkers of an ensemble (ter Braak 2006) or an independent proposal
from a t distribution, which is refined once. All walkers of a half step are simulated in one batch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from commonrail.base.arguments import instance, whole
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.base.text import listed
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.data.noise import Law
from commonrail.plugins.certainty.estimate import Estimate, bounded
from commonrail.plugins.certainty.likelihood import Likelihood, weights_of
from commonrail.plugins.certainty.noise_fit import FittedNoise, sample_count, stated_courses

# Starts of the chains and independent proposals, from a multivariate t distribution about the most likely values.

FREEDOM = 5.0  # degrees of freedom: tails wider than those of the posterior
_LEAST = 1e-10  # eigenvalue over the largest
_STEPS = 30  # of a walk for each parameter: chosen; the starts need no more than to lie apart


class Surrogate:
    """Multivariate t distribution of positions.

    `centre` (d,); `covariance` (d, d): of the normal distribution with the same scale.
    """

    def __init__(self, centre: Floats, covariance: Floats) -> None:
        self.centre = centre
        values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
        scale = np.sqrt(np.maximum(values, _LEAST * max(float(values.max(initial=0.0)), 1e-300)))
        self._root, self._inverse = vectors * scale, vectors / scale

    def draw(self, n: int, random: Any) -> Floats:
        """Positions (n, d) by a `RandomState`."""
        normal = random.standard_normal((n, len(self.centre)))
        stretched = normal / np.sqrt(random.chisquare(FREEDOM, n) / FREEDOM)[:, None]
        return np.asarray(self.centre + stretched @ self._root.T)

    def spread(self, feasible: FeasibleSet, many: int, random: Any, wider: float = 1.0) -> Floats:
        """Positions (many, d) spread evenly over the part of an ellipsoid that bounds and linear constraints leave.

        By hit-and-run walks (Smith 1984) from a point off the feasible. Where the centre touches an ordering of many
        parameters nearly all draws of the distribution itself break it. The whole ellipsoid, uniformly filled, has the
        covariance of the distribution times the square of `wider`.

        `wider`: factor of all distances from the centre.
        """
        d = len(self.centre)
        radius = wider * np.sqrt(d + 2.0)  # a ball's variance along an axis is radius²/(d + 2)
        inward = (feasible.space.to_unit(feasible.space.centre) - self.centre) @ self._inverse
        inward *= min(0.5, 0.5 * radius / max(float(np.linalg.norm(inward)), 1e-300))
        ball, rows = np.tile(inward, (many, 1)), feasible.rows @ self._root
        floor = feasible.floor - feasible.rows @ self.centre
        for _ in range(_STEPS * d):
            along = random.standard_normal((many, d))
            along /= np.linalg.norm(along, axis=1)[:, None]
            first, last = _chord(ball, along, radius)
            reach, rate = np.minimum(floor - ball @ rows.T, 0.0), along @ rows.T
            with np.errstate(divide="ignore", invalid="ignore"):
                steps = reach / rate
            first = np.maximum(first, np.where(rate > 0.0, steps, -np.inf).max(axis=1))
            last = np.minimum(last, np.where(rate < 0.0, steps, np.inf).min(axis=1))
            ball += (first + (last - first) * random.random_sample(many))[:, None] * along
        return np.asarray(self.centre + ball @ self._root.T)

    def log_density(self, unit: Floats) -> Floats:
        """Logarithm (m,) without its constant."""
        squares = np.sum(((unit - self.centre) @ self._inverse) ** 2, axis=1)
        return np.asarray(-0.5 * (FREEDOM + len(self.centre)) * np.log1p(squares / FREEDOM))

    def propose(self, coords: Floats, random: Any) -> tuple[Floats, Floats]:
        """Proposals that do not depend on the walkers' places, and logarithms of the ratios of their densities."""
        proposed = self.draw(len(coords), random)
        return proposed, self.log_density(coords) - self.log_density(proposed)


def _chord(points: Floats, along: Floats, radius: float) -> tuple[Floats, Floats]:
    """Steps (n,), (n,) to both ends of the chord of a ball through points (n, d) along unit directions (n, d)."""
    middle = -np.sum(points * along, axis=1)
    half = np.sqrt(np.maximum(middle**2 + radius**2 - np.sum(points**2, axis=1), 0.0))
    return middle - half, middle + half


def local_surrogate(estimate: Estimate) -> Surrogate:
    """Distribution of the linear approximation, no wider than the bounds."""
    return Surrogate(estimate.unit, bounded(estimate))


LARGEST_R_HAT, LEAST_SIZE = 1.05, 400.0  # beyond which nothing is said from the draws
MOST = 100_000  # simulations
ENSEMBLES = 4
OVERDISPERSED = 1.5  # spread of the starts over that of the linear approximation
_ROUND = 50  # steps
_DISCARDED = 0.25  # share of the steps after the refinement
_TRIES = 30  # each nine tenths as wide as the one before: a twentieth of the first width at last


@dataclass(frozen=True, repr=False)
class Posterior(Shown):
    """Draws from a posterior.

    Attributes
    ----------
    estimate : Estimate
        Most likely values that the chains started about, with the noise.
    unit : (chains, steps, d)
        Positions between the bounds.
    log_density : (chains, steps)
        Without its constant.
    r_hat, effective : (d,)
        Of each parameter: rank-normalised split R-hat, and the smaller of the effective numbers of draws of bulk and
        tails (Vehtari et al. 2021).
    accepted : float
        Share of proposals.
    simulated, failed : int
        Simulations, and those that failed: their density is zero.
    seed : int
    beside : tuple of str
        Quantities that were drawn too, and are none of the parameters.
    """

    presenter = "commonrail.plugins.certainty.notebook:POSTERIOR"

    estimate: Estimate
    unit: Floats
    log_density: Floats
    r_hat: Floats
    effective: Floats
    accepted: float
    simulated: int
    failed: int
    seed: int
    beside: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.estimate.likelihood.names

    @property
    def converged(self) -> bool:
        """True if intervals and bands may be taken from the draws."""
        return not self.refusal

    @property
    def refusal(self) -> str:
        """Reason why nothing may be said from the draws; empty if there is none."""
        worst, fewest = int(np.argmax(self.r_hat)), int(np.argmin(self.effective))
        reasons = []
        if not self.r_hat[worst] <= LARGEST_R_HAT:
            reasons.append(f"R-hat of {self.names[worst]} is {self.r_hat[worst]:.3g}, above {LARGEST_R_HAT:g}")
        if not self.effective[fewest] >= LEAST_SIZE:
            size = f"{self.effective[fewest]:.0f}"
            reasons.append(f"the draws of {self.names[fewest]} are worth {size}, fewer than {LEAST_SIZE:.0f}")
        return " and ".join(reasons)

    def points(self, most: int | None = None) -> Floats:
        """Draws (n, d) [SI], or as many of them, evenly spaced along the chains.

        Raises
        ------
        SimulationError
            If the chains do not agree.
        """
        self.require()
        flat = self.unit.reshape(-1, self.unit.shape[-1])
        if most is not None and most < len(flat):
            flat = flat[np.linspace(0, len(flat) - 1, most).round().astype(int)]
        return np.asarray(self.estimate.likelihood.space.from_unit(flat))

    def interval(self, level: float = 0.95) -> tuple[Floats, Floats]:
        """Ends (d,) [SI] of the central intervals.

        Raises
        ------
        SimulationError
            If the chains do not agree.
        """
        low, high = np.quantile(self.points(), [0.5 * (1.0 - level), 0.5 * (1.0 + level)], axis=0)
        return low, high

    def of_first(self, estimate: Estimate) -> Posterior:
        """Draws of the first parameters alone, those of an estimate; what was drawn beside them is integrated out."""
        d = len(estimate.unit)
        return replace(
            self,
            estimate=estimate,
            unit=self.unit[..., :d],
            r_hat=self.r_hat[:d],
            effective=self.effective[:d],
            beside=self.names[d:],
        )

    def require(self) -> None:
        """Raise a `SimulationError` if the chains do not agree."""
        if self.refusal:
            raise SimulationError(
                f"The posterior cannot be used: {self.refusal}, after {self.simulated} simulations; allow more draws, "
                "or fix or state priors of parameters that the data do not see."
            )


def sample_posterior(
    estimate: Estimate, *, seed: int = 0, most: int = MOST, note: Callable[[str], None] = lambda _: None
) -> Posterior:
    """Draw from the posterior until the chains agree, or `most` is reached.

    Parameters
    ----------
    estimate : Estimate
    seed : int
        Equal seeds give equal draws, for any number of threads.
    most : int
        Largest number of density evaluations; those beyond bounds and constraints count too.
    note : function of str
        Called with the state of the chains.

    Raises
    ------
    ConfigurationError
        If the libraries emcee and arviz-stats are not installed, or an argument is of another kind.
    SimulationError
        If no starts can be simulated.
    """
    instance(estimate, Estimate, "estimate")
    seed, most = whole(seed, "seed", 0), whole(most, "most", 1)
    density = PosteriorDensity(estimate)
    ensembles = _Ensembles(density, local_surrogate(estimate), seed)
    ensembles.run(2 * _ROUND)
    ensembles.refine()
    found = None
    while found is None or not (found.converged or ensembles.evaluated + ensembles.next_round > most):
        ensembles.run(ensembles.steps or _ROUND)
        unit, logs = ensembles.draws(_DISCARDED)
        found = Posterior(
            estimate,
            unit,
            logs,
            *_agreement(unit),
            ensembles.accepted,
            density.likelihood.simulated,
            density.likelihood.failed,
            seed,
        )
        note(
            f"posterior: {found.simulated} simulations, R-hat {found.r_hat.max():.3f}, "
            f"effective size {found.effective.min():.0f} ..."
        )
    return found


class _Ensembles:
    """Independent ensembles of walkers."""

    def __init__(self, density: PosteriorDensity, surrogate: Surrogate, seed: int) -> None:
        self.density = density
        dimension = len(surrogate.centre)
        self.walkers = 2 * max(dimension + 1, 4)
        seeds = np.random.SeedSequence(seed).generate_state(ENSEMBLES)
        self.states: list[Any] = []
        for own in seeds:
            random = np.random.RandomState(own)
            start = _start(density, surrogate, self.walkers, random)
            self.states.append(_libraries()[0].State(start, random_state=random.get_state()))
        self.evaluated = 0
        self._begin(surrogate)

    def _begin(self, surrogate: Surrogate) -> None:
        emcee, _ = _libraries()
        dimension = len(surrogate.centre)
        self.samplers = []
        for state in self.states:
            moves = [
                (emcee.moves.DEMove(), 0.5),
                (emcee.moves.DEMove(gamma0=1.0), 0.1),
                (emcee.moves.MHMove(surrogate.propose, ndim=dimension), 0.4),
            ]
            sampler = emcee.EnsembleSampler(self.walkers, dimension, self.density, moves=moves, vectorize=True)
            sampler.random_state = state.random_state
            self.samplers.append(sampler)

    @property
    def steps(self) -> int:
        """Steps since the proposals were refined."""
        return int(self.samplers[0].iteration)

    @property
    def next_round(self) -> int:
        """Evaluations of the next round: the chains are doubled."""
        return int(self.steps * ENSEMBLES * self.walkers)

    @property
    def accepted(self) -> float:
        """Share of proposals."""
        return float(np.mean([sampler.acceptance_fraction for sampler in self.samplers]))

    def run(self, steps: int) -> None:
        """Advance all ensembles."""
        for i, sampler in enumerate(self.samplers):
            self.states[i] = sampler.run_mcmc(self.states[i], steps)
        self.evaluated += steps * ENSEMBLES * self.walkers

    def refine(self) -> None:
        """Forget the chains so far but for their ends, and propose from their later half."""
        unit, _ = self.draws(0.5)
        flat = unit.reshape(-1, unit.shape[-1])
        self._begin(Surrogate(flat.mean(axis=0), np.atleast_2d(np.cov(flat.T))))

    def draws(self, discarded: float) -> tuple[Floats, Floats]:
        """Positions (chains, steps, d) and logarithms of their density (chains, steps)."""
        first = int(discarded * self.steps)
        unit = np.concatenate([sampler.get_chain(discard=first) for sampler in self.samplers], axis=1)
        logs = np.concatenate([sampler.get_log_prob(discard=first) for sampler in self.samplers], axis=1)
        return unit.swapaxes(0, 1), logs.T


def _start(density: PosteriorDensity, surrogate: Surrogate, many: int, random: Any) -> Floats:
    """Over-dispersed positions (many, d) of finite density; narrower where few of them have one."""
    space = density.likelihood.space
    feasible = FeasibleSet.of(space)
    found = np.empty((0, len(surrogate.centre)))
    wider = OVERDISPERSED
    for _ in range(_TRIES):
        unit = surrogate.spread(feasible, many, random, wider)
        found = np.vstack([found, unit[np.isfinite(density(unit))]])[:many]
        if len(found) == many:
            return found
        wider *= 0.9
    limits = listed([f'"{label}"' for label in dict.fromkeys([*space.rows.labels, *space.products.labels])])
    raise SimulationError(
        f"{len(found)} of {many} starts of a chain near the most likely values can be simulated within the bounds"
        f"{f' and the constraints {limits}' if limits else ''}: {density.likelihood.failed} of "
        f"{density.likelihood.simulated} simulations failed; correct the bounds or constraints, or fix a parameter."
    )


def _agreement(unit: Floats) -> tuple[Floats, Floats]:
    """R-hat and effective number of draws (d,) of chains (chains, steps, d)."""
    _, diagnostics = _libraries()
    chains = {"chain_axis": 0, "draw_axis": 1}
    with np.errstate(divide="ignore", invalid="ignore"):
        r_hat = diagnostics.rhat(unit, **chains)
    bulk = diagnostics.ess(unit, **chains)
    tails = diagnostics.ess(unit, **chains, method="tail", prob=(0.05, 0.95))
    return np.nan_to_num(r_hat, nan=np.inf, posinf=np.inf), np.minimum(bulk, tails)  # NaN: chains that do not move


def _libraries() -> tuple[Any, Any]:
    """Modules of emcee and of ArviZ's diagnostics."""
    try:
        import emcee
        from arviz_stats.base import array_stats
    except ImportError as error:
        raise ConfigurationError(
            "A posterior needs the libraries emcee and arviz-stats, which are not both installed: "
            'pip install "commonrail[posterior]".'
        ) from error
    return emcee, array_stats


# Logarithm of the posterior density of positions between the bounds, what is uncertain besides them integrated out.
#
# Uncertain quantities and discrepancies that a study states move the innovations u by u + z G, z of unit deviation,
# with the derivatives G at the most likely values. A scale that is estimated is integrated out too, under a density
# of 1/scale: −2 ln p = n ln Σρ in place of Σρ; one of repeated measurements with ν degrees of freedom gives (n + ν)
# ln(1 + Σρ/ν). Values at which data and best fit agree exactly do not count in n, see `noise.unequal`.
# Autocorrelations are those of the estimate. The density of the parameters is that of their priors, uniform between
# the bounds on the scale of each, and zero beyond bounds and constraints.

_TURNS = 3  # of reweighting, for laws that are not Gaussian


class PosteriorDensity:
    """Logarithm of a posterior density, a batch of positions at a time.

    `estimate`: its likelihood has the fitted noise. `likelihood`: counts the simulations of this density, and those
    that failed.
    """

    def __init__(self, estimate: Estimate) -> None:
        self.likelihood: Likelihood = estimate.likelihood.with_noises(estimate.likelihood.noises)
        likelihood = self.likelihood
        self._moves = likelihood.whiten(np.vstack([estimate.shifts, stated_courses(likelihood.blocks)]))
        self._samples = [sample_count(estimate.errors[block.rows]) for block in likelihood.blocks]

    def __call__(self, unit: Floats) -> Floats:
        """Logarithm (m,) without its constant of positions (m, d); −inf beyond bounds and where a simulation fails.

        Positions beyond bounds and constraints are not simulated.
        """
        likelihood = self.likelihood
        inside = ((unit >= 0.0) & (unit <= 1.0)).all(axis=1)
        points = likelihood.space.from_unit(np.clip(unit, 0.0, 1.0))
        found = np.where(inside, likelihood.log_prior(points), -np.inf)
        which = np.flatnonzero(np.isfinite(found))
        if len(which):
            found[which] += self._data(likelihood.whiten(likelihood.residuals(points[which])))
        return np.where(np.isfinite(found), found, -np.inf)

    def _data(self, innovations: Floats) -> Floats:
        """Part (m,) of innovations (m, n)."""
        left, total = self._moved(innovations)
        costs = self.likelihood.block_costs(left)
        for i, (samples, noise) in enumerate(zip(self._samples, self.likelihood.noises, strict=True)):
            total = total + _integrated(samples, noise, costs[:, i])
        return -0.5 * total

    def _moved(self, innovations: Floats) -> tuple[Floats, Floats]:
        """Innovations (m, n) with what is uncertain at its most likely, and the cost (m,) of that."""
        moves = self._moves
        if not len(moves):
            return innovations, np.zeros(len(innovations))
        found: Floats = innovations
        z: Floats = np.zeros((len(innovations), len(moves)))
        linear = all(noise.law is Law.GAUSSIAN for noise in self.likelihood.noises)
        for _ in range(1 if linear else _TURNS):
            weighted = moves[None] * self._weights(found)[:, None, :]
            metric = np.eye(len(moves)) + weighted @ moves.T
            z = np.asarray(-np.linalg.solve(metric, weighted @ innovations[:, :, None])[..., 0], float)
            found = np.asarray(innovations + z @ moves, float)
        return found, np.sum(z**2, axis=1)

    def _weights(self, innovations: Floats) -> Floats:
        found = weights_of(self.likelihood, innovations)
        return np.where(np.isfinite(found), found, 1.0)


def _integrated(samples: int, noise: FittedNoise, cost: Floats) -> Floats:
    """Cost (m,) of a block of `samples` with the scale of its noise integrated out, as far as it is not known."""
    if noise.law is not Law.GAUSSIAN or (noise.known and np.isinf(noise.freedom)):
        return cost
    if noise.known:
        return np.asarray((samples + noise.freedom) * np.log1p(cost / noise.freedom))
    return np.asarray(samples * np.log(np.maximum(cost, 1e-300)))
