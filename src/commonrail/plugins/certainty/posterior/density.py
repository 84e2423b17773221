"""Logarithm of the posterior density of positions between the bounds, what is uncertain besides them integrated out.

Uncertain quantities and discrepancies that a study states move the innovations u by u + z G, z of unit deviation, with
the derivatives G at the most likely values. A scale that is estimated is integrated out too, under a density of
1/scale: −2 ln p = n ln Σρ in place of Σρ; one of repeated measurements with ν degrees of freedom gives
(n + ν) ln(1 + Σρ/ν). Values at which data and best fit agree exactly do not count in n, see `noise.unequal`.
Autocorrelations are those of the estimate. The density of the parameters is that of their priors, uniform between the
bounds on the scale of each, and zero beyond bounds and constraints.
"""

from __future__ import annotations

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.data.noise import Law
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise_fit import FittedNoise, sample_count, stated_courses

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
        """Logarithm (m,) without its constant of positions (m, d); −inf beyond the walls and where a simulation fails.

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
        found = self.likelihood.weights(innovations)
        return np.where(np.isfinite(found), found, 1.0)


def _integrated(samples: int, noise: FittedNoise, cost: Floats) -> Floats:
    """Cost (m,) of a block of `samples` with the scale of its noise integrated out, as far as it is not known."""
    if noise.law is not Law.GAUSSIAN or (noise.known and np.isinf(noise.freedom)):
        return cost
    if noise.known:
        return np.asarray((samples + noise.freedom) * np.log1p(cost / noise.freedom))
    return np.asarray(samples * np.log(np.maximum(cost, 1e-300)))
