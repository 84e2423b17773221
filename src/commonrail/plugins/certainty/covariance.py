"""Covariance of the most likely values, from the curvature of the prewhitened likelihood.

With whitened derivatives J_b of block b, the bread is B = Σ m_b J_bᵀJ_b, m_b being the mean slope of its law, and the
covariance is V = B⁻¹ (Σ τ_b J_bᵀJ_b) B⁻¹ with τ_b = K² Σψ²/ν_b (Huber's factor K): that of the estimator in use,
whatever its law. A Gaussian block has m = τ = 1. Priors are a block with stated deviations. Bounds and constraints are
not projected out. It is where draws begin, and what is said where they fail.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Bools, Floats
from commonrail.data.noise import Law
from commonrail.plugins.certainty.likelihood import Likelihood, prior_slopes_at
from commonrail.plugins.certainty.noise_fit import unequal

NEGLIGIBLE = 1e-11  # eigenvalue of the scaled information, below which a direction counts as unseen


class Covariance(NamedTuple):
    """Covariance of the estimates in positions between the bounds."""

    inverse: Floats  # (d, d), inverse of the bread, see above
    noise: Floats  # (d, d), by noise alone; +inf on the diagonal where nothing holds a parameter
    shares: Floats  # (blocks + 1, d), parts of the variance by noise that come from each block, the priors last
    freedom: Floats  # (d,), degrees of freedom of each standard error by noise (Satterthwaite)
    alone: Floats  # (d,), standard errors where all other parameters are known
    used: Floats  # (blocks,), parameters that each block pays for

    @property
    def root(self) -> Floats:
        """Root R (d, d) of the covariance by noise, R Rᵀ; zero where nothing holds a parameter."""
        finite = np.isfinite(np.diag(self.noise))
        values, vectors = np.linalg.eigh(np.where(np.outer(finite, finite), self.noise, 0.0))
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def covariance_of(likelihood: Likelihood, unit: Floats, slopes: Floats, errors: Floats) -> Covariance:
    """Covariance at the most likely values.

    `likelihood`: with its noise; `unit` (d,): position; `slopes` (d, n): derivatives of the residuals with respect to
    the positions; `errors` (n,): residuals.
    """
    tangents, innovations = likelihood.whiten(slopes), likelihood.whiten(errors)
    parts = [tangents[:, b.rows] @ tangents[:, b.rows].T for b in likelihood.blocks]
    prior_slopes = prior_slopes_at(likelihood, unit)
    prior = prior_slopes.T @ prior_slopes
    bread, used, meat = _bread(likelihood, parts, prior, innovations)
    inverse, loose = _inverse(bread)
    spread = [inverse @ (t * matrix) @ inverse for t, matrix in zip(meat, parts, strict=True)]
    spread.append(inverse @ prior @ inverse)
    shares = np.array([np.diag(matrix) for matrix in spread])
    shares = shares / np.maximum(shares.sum(axis=0), 1e-300)
    freedom = combined_freedom(shares, [noise.freedom for noise in likelihood.noises])
    noise = np.sum(spread, axis=0)
    noise[loose, loose] = np.inf
    with np.errstate(divide="ignore"):
        alone = 1.0 / np.sqrt(np.diag(bread))
    return Covariance(inverse, noise, shares, freedom, alone, used)


def combined_freedom(shares: Floats, freedoms: Sequence[float]) -> Floats:
    """Degrees of freedom (d,) of variances with shares (blocks + 1, d), the last of which is exactly known."""
    parts = np.array([*freedoms, np.inf])
    return np.asarray(1.0 / np.maximum(np.sum(shares**2 / parts[:, None], axis=0), 1e-300))


def _bread(
    likelihood: Likelihood, parts: list[Floats], prior: Floats, innovations: Floats
) -> tuple[Floats, Floats, Floats]:
    """Bread (d, d), parameters that each block pays for, and scatter of ψ."""
    many = len(parts)
    sizes = np.empty(many)
    slope, mean_square, spread = np.ones(many), np.ones(many), np.zeros(many)
    for i, (block, noise) in enumerate(zip(likelihood.blocks, likelihood.noises, strict=True)):
        u = unequal(innovations[block.rows])
        sizes[i] = len(u)
        slopes = noise.density.slope(u)
        slope[i] = max(float(slopes.mean()), 0.05)
        spread[i] = float(slopes.var()) / slope[i] ** 2
        if not (noise.stated and noise.law is Law.GAUSSIAN):
            mean_square[i] = float(np.mean((u * noise.density.weight(u)) ** 2))
    bread = np.sum([m * matrix for m, matrix in zip(slope, parts, strict=True)], axis=0) + prior
    inverse, _ = _inverse(bread)
    used = np.array([m * np.sum(inverse * matrix) for m, matrix in zip(slope, parts, strict=True)])
    huber = (1.0 + used / sizes * spread) ** 2
    exact = np.array([noise.stated and noise.law is Law.GAUSSIAN for noise in likelihood.noises])
    meat = np.where(exact, 1.0, huber * mean_square * sizes / np.maximum(sizes - used, 1.0))
    return bread, used, meat


def _inverse(matrix: Floats) -> tuple[Floats, Bools]:
    """Pseudo-inverse of a symmetric matrix, scaled to a unit diagonal, and the parameters that it does not hold."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    supported = values > NEGLIGIBLE * max(values.max(initial=0.0), 1e-300)
    inverse = (vectors[:, supported] / values[supported]) @ vectors[:, supported].T
    loose = (np.sum(vectors[:, supported] ** 2, axis=1) < 1.0 - 1e-6) | (np.diag(matrix) <= 0.0)
    return np.asarray(inverse / np.outer(scale, scale)), loose


def shifts_by(likelihood: Likelihood, inverse: Floats, tangents: Floats, innovations: Floats, shifts: Floats) -> Floats:
    """Changes (k, d) of the estimates, in positions, by changes (k, n) of the innovations.

    `inverse` (d, d): of the bread; `tangents` (d, n): whitened derivatives; `innovations` (n,); `shifts` (k, n).
    """
    weighted = tangents.copy()
    for block, noise in zip(likelihood.blocks, likelihood.noises, strict=True):
        weighted[:, block.rows] *= noise.mean_slope(innovations[block.rows])
    return np.asarray(-(shifts @ weighted.T) @ inverse)


def student(freedom: Floats, level: float) -> Floats:
    """Two-sided quantile of Student's t (…)."""
    return np.asarray(special.stdtrit(np.clip(freedom, 1.0, 1e9), 0.5 * (1.0 + level)))
