"""Covariance of the most likely values, from the curvature of the prewhitened likelihood.

With whitened derivatives J_b of block b, the covariance is the sandwich V = B⁻¹ (Σ τ_b J_bᵀJ_b) B⁻¹. The bread is B = Σ
m_b J_bᵀJ_b with the mean slope m_b of the block's law, and τ_b = K² Σψ²/ν_b (Huber's factor K). V holds for any law; a
Gaussian block has m = τ = 1. Priors are a block with stated deviations. Bounds and constraints are not projected out.
The draws start from V, and the intervals come from V if the draws fail.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Bools, Floats
from commonrail.data.noise import Law
from commonrail.plugins.certainty.likelihood import Likelihood, prior_slopes_at
from commonrail.plugins.certainty.noise_fit import samples_of

NEGLIGIBLE = 1e-11  # eigenvalue of the scaled information, below which a direction counts as unseen


class Covariance(NamedTuple):
    """Covariance of the estimates in positions between the bounds."""

    noise: Floats  # (d, d), by noise alone; +inf on the diagonal of an insensitive parameter
    shares: Floats  # (blocks + 1, d), parts of the variance by noise that come from each block, the priors last
    freedom: Floats  # (d,), degrees of freedom of each standard error by noise (Satterthwaite)
    alone: Floats  # (d,), standard errors if all other parameters are known
    used: Floats  # (blocks,), degrees of freedom that the fit takes from each block

    @property
    def root(self) -> Floats:
        """Root R (d, d) of the covariance by noise, R Rᵀ; zero for insensitive parameters."""
        finite = np.isfinite(np.diag(self.noise))
        values, vectors = np.linalg.eigh(np.where(np.outer(finite, finite), self.noise, 0.0))
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def covariance_of(likelihood: Likelihood, unit: Floats, slopes: Floats, errors: Floats) -> Covariance:
    """Covariance at the most likely values, for known noise.

    `unit` (d,): position; `slopes` (d, n): derivatives of the residuals with respect to the positions; `errors` (n,).
    """
    tangents, innovations = likelihood.whiten(slopes), likelihood.whiten(errors)
    parts = [tangents[:, b.rows] @ tangents[:, b.rows].T for b in likelihood.blocks]
    prior_slopes = prior_slopes_at(likelihood, unit)
    prior = prior_slopes.T @ prior_slopes
    many = len(parts)
    sizes = np.empty(many)
    slope, mean_square, variation = np.ones(many), np.ones(many), np.zeros(many)
    exact = np.array([noise.stated and noise.law is Law.GAUSSIAN for noise in likelihood.noises])
    for i, (block, noise) in enumerate(likelihood.pairs):
        u = samples_of(innovations[block.rows])
        sizes[i], slope[i] = len(u), noise.mean_slope(u)
        variation[i] = float(noise.density.slope(u).var()) / slope[i] ** 2
        if not exact[i]:
            mean_square[i] = float(np.mean((u * noise.density.weight(u)) ** 2))
    bread = np.sum([m * matrix for m, matrix in zip(slope, parts, strict=True)], axis=0) + prior
    inverse, loose = _inverse(bread)
    used = np.array([m * np.sum(inverse * matrix) for m, matrix in zip(slope, parts, strict=True)])
    huber = (1.0 + used / sizes * variation) ** 2
    meat = np.where(exact, 1.0, huber * mean_square * sizes / np.maximum(sizes - used, 1.0))
    variances = [inverse @ (t * matrix) @ inverse for t, matrix in zip(meat, parts, strict=True)]
    variances.append(inverse @ prior @ inverse)
    noise_covariance = np.sum(variances, axis=0)
    noise_covariance[loose, loose] = np.inf
    shares = np.array([np.diag(matrix) for matrix in variances])
    shares = shares / np.maximum(shares.sum(axis=0), 1e-300)
    freedoms = np.array([*(noise.freedom for noise in likelihood.noises), np.inf])
    freedom = np.asarray(1.0 / np.maximum(np.sum(shares**2 / freedoms[:, None], axis=0), 1e-300))
    with np.errstate(divide="ignore"):
        alone = 1.0 / np.sqrt(np.diag(bread))
    return Covariance(noise_covariance, shares, freedom, alone, used)


def _inverse(matrix: Floats) -> tuple[Floats, Bools]:
    """Pseudo-inverse of a symmetric matrix, scaled to a unit diagonal, and the parameters that it does not hold."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    supported = values > NEGLIGIBLE * max(values.max(initial=0.0), 1e-300)
    inverse = (vectors[:, supported] / values[supported]) @ vectors[:, supported].T
    loose = (np.sum(vectors[:, supported] ** 2, axis=1) < 1.0 - 1e-6) | (np.diag(matrix) <= 0.0)
    return np.asarray(inverse / np.outer(scale, scale)), loose


def student(freedom: Floats, level: float) -> Floats:
    """Two-sided quantile of Student's t (…)."""
    return np.asarray(special.stdtrit(np.clip(freedom, 1.0, 1e9), 0.5 * (1.0 + level)))
