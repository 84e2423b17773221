"""Slow drift of a record: what it explains of the residuals, and what it moves the estimates by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from commonrail.analysis.certainty.block import Block, fit_noise
from commonrail.analysis.certainty.covariance import moved_by
from commonrail.analysis.certainty.estimate import Estimate
from commonrail.arrays import Floats

__all__ = ["DRIFT", "drift_courses", "drift_probability", "with_drift"]


DRIFT, HALF_PERIODS = "drift", 3  # cosines of half a period to one and a half over the record
LEAST_DRIFTING = 50  # samples, from which the asymptotic distribution is used; chosen


def drift_courses(block: Block) -> Floats:
    """Constant and cosines (1 + `HALF_PERIODS`, n) over the record, in the unit of the residuals."""
    times = block.places[:, 0] - block.places[:, 0].min()
    phase = np.pi * times / max(float(np.ptp(times)), 1e-300)
    return np.asarray(np.cos(np.arange(HALF_PERIODS + 1)[:, None] * phase) * block.offset)


def drift_probability(block: Block, errors: Floats, used: float) -> float:
    """Probability of what a drift explains, its amplitudes and the noise that then remains estimated together.

    Autoregressive noise follows a drift, and its innovations show none: the likelihoods of both are compared, each
    order paying twice (AIC), with the χ² distribution of the four amplitudes.

    Parameters
    ----------
    block : Block
    errors : (n,)
        Residuals of the block.
    used : float
        Parameters that the block pays for.
    """
    courses = drift_courses(block)
    sampled = errors != 0.0  # exact agreement is no sample
    if np.count_nonzero(sampled) < LEAST_DRIFTING:
        return 1.0
    weights, *_ = np.linalg.lstsq(courses[:, sampled].T, errors[sampled], rcond=None)
    rest = np.where(sampled, errors - weights @ courses, 0.0)
    before, after = fit_noise(block, errors, used), fit_noise(block, rest, used)
    if before.law is not after.law or block.noise.sigma is not None:
        return 1.0
    orders = after.autoregression.order - before.autoregression.order
    fall = 2.0 * np.count_nonzero(sampled) * math.log(before.scale / after.scale) - 2.0 * orders
    return float(special.chdtrc(len(courses), max(fall, 0.0)))


def with_drift(found: Estimate, drifting: Sequence[str]) -> Estimate:
    """The estimate, its covariance with what the drift of data sets moves the parameters by.

    The amplitude is that of the part of the drift that the parameters do not imitate, the noise removed.

    Parameters
    ----------
    found : Estimate
    drifting : sequence of str
        Names of the data sets whose residuals drift.
    """
    own = found.likelihood
    blocks = [block for block in own.blocks if block.name in drifting and block.ordered]
    if not blocks:
        return found
    shifts = np.zeros((len(blocks) * (HALF_PERIODS + 1), own.size))
    for i, block in enumerate(blocks):
        courses = drift_courses(block)
        amplitude = _amplitude(found.slopes[:, block.rows], found.errors[block.rows], courses)
        shifts[i * len(courses) : (i + 1) * len(courses), block.rows] = amplitude * courses
    tangents, innovations = own.whiten(found.slopes), own.whiten(found.errors)
    known = found.covariance
    moves = moved_by(own, known.inverse, tangents, innovations, own.whiten(shifts))
    return replace(found, covariance=known._replace(discrepancy=known.discrepancy + moves.T @ moves))


def _amplitude(slopes: Floats, errors: Floats, courses: Floats) -> float:
    """Root mean square amplitude of courses (k, n) in residuals (n,) whose derivatives (d, n) a fit has followed.

    By the part of the courses that the parameters do not imitate: the squares of its products with the residuals are,
    on average, those of courses of independent amplitudes and of white noise.
    """
    base, _ = np.linalg.qr((slopes / np.maximum(np.abs(slopes).max(axis=1, keepdims=True), 1e-300)).T)
    apart = courses - (courses @ base) @ base.T
    left = np.linalg.lstsq(apart.T, errors, rcond=None)[0] @ apart
    noise = float(np.var(errors - left))
    by_drift = float(np.sum((apart @ errors) ** 2)) - noise * float(np.sum(apart**2))
    return math.sqrt(max(by_drift, 0.0) / max(float(np.sum((apart @ apart.T) ** 2)), 1e-300))
