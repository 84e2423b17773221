"""Covariance of the most likely values, from the curvature of the prewhitened likelihood.

With whitened derivatives J_b of block b, the bread is B = Σ m_b J_bᵀJ_b, m_b being the mean slope of its law, and the
covariance is V = B⁻¹ (Σ τ_b J_bᵀJ_b) B⁻¹ with τ_b = K² Σψ²/ν_b (Huber's factor K): that of the estimator in use,
whatever its law. A Gaussian block has m = τ = 1. Priors are a block with stated deviations. Bounds and constraints are
not projected out. Of a block under Student's t the noise's part is replaced at the end, see below.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Bools, Floats
from commonrail.data.noise import Law
from commonrail.plugins.certainty.likelihood import Likelihood, prior_slopes_at
from commonrail.plugins.certainty.noise_fit import LAWS, stated_courses, unequal

NEGLIGIBLE = 1e-11  # eigenvalue of the scaled information, below which a direction counts as unseen


class Covariance(NamedTuple):
    """Covariance of the estimates in positions between the bounds."""

    inverse: Floats  # (d, d), inverse of the bread, see above
    noise: Floats  # (d, d), by noise alone; +inf on the diagonal where nothing holds a parameter
    # (k, d), change of the estimates for one standard deviation of each uncertain quantity; large ones from fits, see
    # `with_refits`
    nuisances: Floats
    discrepancy: Floats  # (d, d), by what the model cannot do, as the blocks state it
    shares: Floats  # (blocks + 1, d), parts of the variance by noise that come from each block, the priors last
    freedom: Floats  # (d,), degrees of freedom of each standard error by noise (Satterthwaite)
    alone: Floats  # (d,), standard errors where all other parameters are known
    used: Floats  # (blocks,), parameters that each block pays for
    ratios: Floats  # (blocks,), mean slope over scatter of ψ of each block, by which differences of its cost are scaled
    # (d,), standard errors by noise over those of the likelihood's curvature, 1 at least; more only where outliers were
    # integrated out
    beyond: Floats

    @property
    def root(self) -> Floats:
        """Root R (d, d) of the covariance by noise, R Rᵀ; zero where nothing holds a parameter."""
        finite = np.isfinite(np.diag(self.noise))
        values, vectors = np.linalg.eigh(np.where(np.outer(finite, finite), self.noise, 0.0))
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    @property
    def total(self) -> Floats:
        """Covariance (d, d) by noise, uncertain quantities and discrepancy."""
        return np.asarray(self.noise + self.nuisances.T @ self.nuisances + self.discrepancy)


def covariance_of(likelihood: Likelihood, unit: Floats, slopes: Floats, errors: Floats, shifts: Floats) -> Covariance:
    """Covariance at the most likely values.

    `likelihood`: with its noise; `unit` (d,): position; `slopes` (d, n): derivatives of the residuals with respect to
    the positions; `errors` (n,): residuals; `shifts` (k, n): changes of the residuals for one standard deviation of
    each uncertain quantity.
    """
    tangents, innovations = likelihood.whiten(slopes), likelihood.whiten(errors)
    parts = [tangents[:, b.rows] @ tangents[:, b.rows].T for b in likelihood.blocks]
    prior_slopes = prior_slopes_at(likelihood, unit)
    prior = prior_slopes.T @ prior_slopes
    bread, used, meat, ratios = _bread(likelihood, parts, prior, innovations)
    inverse, loose = _inverse(bread)
    spread = [inverse @ (t * part) @ inverse for t, part in zip(meat, parts, strict=True)]
    spread.append(inverse @ prior @ inverse)
    shares = np.array([np.diag(part) for part in spread])
    shares = shares / np.maximum(shares.sum(axis=0), 1e-300)
    freedom = combined_freedom(shares, [noise.freedom for noise in likelihood.noises])
    noise = np.sum(spread, axis=0)
    noise[loose, loose] = np.inf
    with np.errstate(divide="ignore"):
        alone = 1.0 / np.sqrt(np.diag(bread))
    moved = shifts_by(likelihood, inverse, tangents, innovations, likelihood.whiten(shifts))
    courses = likelihood.whiten(stated_courses(likelihood.blocks))
    lacking = shifts_by(likelihood, inverse, tangents, innovations, courses)
    return Covariance(
        inverse, noise, moved, lacking.T @ lacking, shares, freedom, alone, used, ratios, np.ones(len(bread))
    )


def combined_freedom(shares: Floats, freedoms: Sequence[float]) -> Floats:
    """Degrees of freedom (d,) of variances with shares (blocks + 1, d), the last of which is exactly known."""
    parts = np.array([*freedoms, np.inf])
    return np.asarray(1.0 / np.maximum(np.sum(shares**2 / parts[:, None], axis=0), 1e-300))


def _bread(
    likelihood: Likelihood, parts: list[Floats], prior: Floats, innovations: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Bread (d, d), parameters that each block pays for, scatter of ψ, and slope over scatter."""
    many = len(parts)
    sizes = np.empty(many)
    slope, mean_square, spread = np.ones(many), np.ones(many), np.zeros(many)
    for i, (block, noise) in enumerate(zip(likelihood.blocks, likelihood.noises, strict=True)):
        u = unequal(innovations[block.rows])
        sizes[i] = len(u)
        slopes = noise.density.slope(u)
        slope[i] = max(float(slopes.mean()), 0.05)
        spread[i] = float(slopes.var()) / slope[i] ** 2
        if not (noise.known and noise.law is Law.GAUSSIAN):
            mean_square[i] = float(np.mean((u * noise.density.weight(u)) ** 2))
    bread = np.sum([m * part for m, part in zip(slope, parts, strict=True)], axis=0) + prior
    inverse, _ = _inverse(bread)
    used = np.array([m * np.sum(inverse * part) for m, part in zip(slope, parts, strict=True)])
    huber = (1.0 + used / sizes * spread) ** 2
    known = np.array([noise.known and noise.law is Law.GAUSSIAN for noise in likelihood.noises])
    meat = np.where(known, 1.0, huber * mean_square * sizes / np.maximum(sizes - used, 1.0))
    with np.errstate(divide="ignore"):
        return bread, used, meat, slope / meat


def _inverse(matrix: Floats) -> tuple[Floats, Bools]:
    """Pseudo-inverse of a symmetric matrix, scaled to a unit diagonal, and the parameters that it does not hold."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    held = values > NEGLIGIBLE * max(values.max(initial=0.0), 1e-300)
    inverse = (vectors[:, held] / values[held]) @ vectors[:, held].T
    loose = (np.sum(vectors[:, held] ** 2, axis=1) < 1.0 - 1e-6) | (np.diag(matrix) <= 0.0)
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


# Covariance of the parameters under Student's t, with weights, scale and degrees of freedom integrated out.
#
# Where few values hold a parameter, its uncertainty depends on which of them are outliers. The curvature of the
# likelihood, whose weights are averages over all values, does not know that: in the bed of outliers
# (`tools/coverage.py`) 11 of 520 samples hold k7, and its intervals were a fifth too narrow. Student's t is a normal
# distribution of unknown weight for each value: given the weights, the parameters of the linear model are normal;
# given the parameters, the weights are gamma variables. Both are drawn in turn (Gibbs sampling; Geweke 1993), for
# scales and degrees of freedom from their own posterior at the fitted residuals, with flat priors on the logarithms of
# both. A stated standard deviation is that of every degree of freedom above two, whose scales differ.
#
# The second moment is taken about the most likely values, which the intervals are centred on. No simulation is added.

FREEDOMS = np.exp(np.linspace(0.0, math.log(30.0), 12))  # of Student's t: from a Cauchy to nearly a normal distribution
SCALES = 41  # tried about the fitted one
FARTHEST, SPREAD = 0.35, 4.0  # logarithm of these: change by another freedom, and standard errors of the estimate
STATED = 2.0  # of the same, over the root of the degrees of freedom of a stated scale
CHAINS, BEFORE, KEPT = 32, 6, 12  # chains, and their turns before and while the moments are collected
SEED = 1
AT_ONCE = 2_000_000  # numbers of the chains that are in memory together
HELD = 1e-13  # eigenvalue of the correlation of the parameters, below which a direction is not seen


class Robust(NamedTuple):
    """Values of one data set under Student's t, as the parameters' linear model has them."""

    innovations: Floats  # (n,), in fitted scales
    tangents: Floats  # (r, n), their derivatives
    weights: Floats  # (n,), those with which the most likely values were found
    used: float  # parameters that the data set pays for
    # degrees of freedom of a stated deviation, infinite where it is exactly known; zero where it is estimated
    stated: float = 0.0


def with_integration(
    known: Covariance, likelihood: Likelihood, unit: Floats, slopes: Floats, errors: Floats
) -> Covariance:
    """Covariance whose part by noise has the outliers of Student's t integrated out; the same where no block has them.

    `known`: by the curvature of the likelihood; other arguments as those of `covariance_of`.
    """
    if not any(noise.law is Law.STUDENT for noise in likelihood.noises):
        return known
    try:
        return _integrated(known, likelihood, unit, slopes, errors)
    except np.linalg.LinAlgError:  # no value is left that tells of the noise, so nothing bounds the interval
        return known._replace(noise=np.diag(np.full(len(known.noise), np.inf)))


def _integrated(known: Covariance, likelihood: Likelihood, unit: Floats, slopes: Floats, errors: Floats) -> Covariance:
    """Covariance with the outliers integrated out, see `with_integration`.

    Raises `numpy.linalg.LinAlgError` if the fit meets all values that hold a parameter.
    """
    heavy = [noise.law is Law.STUDENT for noise in likelihood.noises]
    root, unseen = _root(known.inverse)
    tangents, innovations = root.T @ likelihood.whiten(slopes), likelihood.whiten(errors)
    held = prior_slopes_at(likelihood, unit) @ root
    fixed = held.T @ held + unseen
    curved, robust = fixed.copy(), []
    for i, (block, noise) in enumerate(zip(likelihood.blocks, likelihood.noises, strict=True)):
        u, own = innovations[block.rows], tangents[:, block.rows]
        slope = noise.density.slope(u)
        if heavy[i]:
            if not np.isfinite(known.ratios[i]):
                raise np.linalg.LinAlgError("no scatter")
            live = u != 0.0  # exact agreement, as before an injection, is no sample of the noise
            weights, stated = noise.density.weight(u[live]), noise.freedom if noise.known else 0.0
            robust.append(Robust(u[live], own[:, live], weights, float(known.used[i]), stated))
            curved += known.ratios[i] * (own * slope) @ own.T
        else:
            part = known.ratios[i] * max(float(slope.mean()), 0.05) * own @ own.T
            fixed, curved = fixed + part, curved + part
    moment = root @ second_moment(robust, fixed) @ root.T
    variance, loose = np.diag(moment), ~np.isfinite(np.diag(known.noise))
    local = np.einsum("ij,jk,ik->i", root, np.linalg.pinv(curved, hermitian=True), root)
    if np.linalg.eigvalsh(curved)[0] <= 0.0:  # an outlier decides: the curvature at the top is no measure of the width
        local = variance
    # an outlier at the turn of its weight makes the top nearly flat, which is no reason for a profile to end sooner
    beyond = np.sqrt(np.maximum(np.where(local > 0.0, variance / np.where(local > 0.0, local, 1.0), 1.0), 1.0))
    moment[loose, loose] = np.inf
    freedoms = [np.inf if one else noise.freedom for one, noise in zip(heavy, likelihood.noises, strict=True)]
    return known._replace(noise=moment, freedom=combined_freedom(known.shares, freedoms), beyond=beyond)


def _root(inverse: Floats) -> tuple[Floats, Floats]:
    """Symmetric root R (d, d) of the inverse of the information, scaled, and the projector (d, d) on what is not seen.

    The symmetric root changes smoothly with the matrix: neighbouring fits use the same draws in the same way.
    """
    scale = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    values, vectors = np.linalg.eigh(inverse / np.outer(scale, scale))
    seen = values > HELD * max(values.max(initial=0.0), 1e-300)
    root = (vectors[:, seen] * np.sqrt(values[seen])) @ vectors[:, seen].T
    return np.asarray(scale[:, None] * root), np.asarray(vectors[:, ~seen] @ vectors[:, ~seen].T)


def second_moment(blocks: Sequence[Robust], fixed: Floats) -> Floats:
    """Second moment (r, r) of the parameters about their most likely values.

    The most likely values stay so: a bound or a constraint that holds them is a constant force.

    `blocks`: at least one; `fixed` (r, r): information of all other data sets and of the priors; with that of the
    blocks it is positive definite.
    """
    rng = np.random.default_rng(SEED)
    noises = [_noises(block, rng) for block in blocks]
    size = max(1, AT_ONCE // max(block.tangents.size for block in blocks))
    sums = [
        _chains(blocks, fixed, [(s[at : at + size], f[at : at + size]) for s, f in noises], rng)
        for at in range(0, CHAINS, size)
    ]
    return np.asarray(np.sum(sums, axis=0) / (CHAINS * KEPT))


def _noises(block: Robust, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Scales, over the fitted one, and degrees of freedom (`CHAINS`,): evenly spread over their posterior."""
    square = block.innovations**2
    n = len(square)
    reach = FARTHEST + SPREAD / math.sqrt(n) + (STATED / math.sqrt(block.stated) if block.stated else 0.0)
    grid = np.linspace(-reach, reach, SCALES)
    scales = np.tile(np.exp(grid)[:, None], len(FREEDOMS))
    if block.stated:  # of one standard deviation, over that of the fitted law; zero where there is none
        scales *= LAWS[Law.STUDENT].deviation * np.sqrt(np.maximum(1.0 - 2.0 / FREEDOMS, 0.0))
    half = 0.5 * (FREEDOMS + 1.0)
    constants = np.array([math.lgamma(h) - math.lgamma(h - 0.5) - 0.5 * math.log(2.0 * h - 1.0) for h in half])
    logarithms = np.empty((SCALES, len(FREEDOMS)))
    for i, scale in enumerate(np.where(scales > 0.0, scales, 1.0)):
        tails = np.log1p(square / (scale**2 * FREEDOMS)[:, None]).sum(axis=1)
        logarithms[i] = n * constants - half * tails - max(n - block.used, 1.0) * np.log(scale)
    if block.stated:
        logarithms += _stated(np.exp(grid), block.stated)[:, None]
    logarithms[scales == 0.0] = -np.inf
    share = np.cumsum(np.exp(logarithms - logarithms.max()))
    wanted = (rng.permutation(CHAINS) + 0.5) / CHAINS
    chosen = np.searchsorted(share / share[-1], wanted)
    return scales.ravel()[chosen], FREEDOMS[chosen % len(FREEDOMS)]


def _stated(scales: Floats, freedom: float) -> Floats:
    """Logarithm of the density (`SCALES`,) of deviations over a stated one of some degrees of freedom."""
    if math.isinf(freedom):
        return np.where(np.arange(SCALES) == SCALES // 2, 0.0, -np.inf)
    return np.asarray(-freedom * (np.log(scales) + 0.5 / scales**2))


def _chains(
    blocks: Sequence[Robust], fixed: Floats, noises: Sequence[tuple[Floats, Floats]], rng: np.random.Generator
) -> Floats:
    """Sum (r, r) of the second moments of some chains.

    `fixed` (r, r); `noises`: of the chains, for each block.
    """
    many, r = len(noises[0][0]), len(fixed)
    at, total = np.zeros((many, r)), np.zeros((r, r))
    balance = np.sum([block.tangents @ (block.weights * block.innovations) for block in blocks], axis=0)
    for turn in range(BEFORE + KEPT):
        matrix, force = np.tile(fixed, (many, 1, 1)), np.tile(balance, (many, 1))
        for block, (scale, freedom) in zip(blocks, noises, strict=True):
            errors = (block.innovations + at @ block.tangents) / scale[:, None]
            shape = np.broadcast_to(0.5 * (freedom[:, None] + 1.0), errors.shape)
            weights = 2.0 * rng.standard_gamma(shape) / (freedom[:, None] + errors**2) / scale[:, None] ** 2
            matrix += (block.tangents * weights[:, None, :]) @ block.tangents.T
            force -= (weights * block.innovations) @ block.tangents.T
        inverse = np.linalg.inv(matrix)
        middle = np.einsum("cij,cj->ci", inverse, force)
        if turn >= BEFORE:
            total += inverse.sum(axis=0) + middle.T @ middle
        at = middle + np.einsum("cij,cj->ci", np.linalg.cholesky(inverse), rng.standard_normal((many, r)))
    return total
