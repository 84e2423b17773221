"""Convergence of Markov chains: rank-normalised split R-hat and effective sample size (Vehtari et al. 2021)."""

from __future__ import annotations

import numpy as np

from commonrail.arrays import Floats

__all__ = ["effective_size", "r_hat"]


_SHORTEST = 8  # draws of a chain, below which nothing can be said


def r_hat(draws: Floats) -> float:
    """R-hat of one quantity: the larger of that of its ranks and that of its distances from the median.

    Parameters
    ----------
    draws : (chains, steps)

    Returns
    -------
    float
        1 for chains that tell the same; +inf for chains that do not move or are too short.
    """
    if draws.shape[1] < _SHORTEST:
        return float("inf")
    halves = _split(draws)
    return max(_ratio(_ranked(halves)), _ratio(_ranked(np.abs(halves - np.median(halves)))))


def effective_size(draws: Floats) -> float:
    """Effective number of independent draws of one quantity: the smaller of that of the bulk and that of the tails.

    Parameters
    ----------
    draws : (chains, steps)
    """
    if draws.shape[1] < _SHORTEST:
        return 0.0
    halves = _split(draws)
    tails = [(halves <= np.quantile(halves, q)).astype(float) for q in (0.05, 0.95)]
    return min(_independent(_ranked(halves)), *(_independent(tail) for tail in tails))


def _split(draws: Floats) -> Floats:
    """First and last halves of the chains (2 chains, steps // 2)."""
    half = draws.shape[1] // 2
    return np.concatenate([draws[:, :half], draws[:, -half:]])


def _ranked(draws: Floats) -> Floats:
    """Normal quantiles of the ranks of all draws."""
    from scipy.special import ndtri
    from scipy.stats import rankdata  # slow to import

    return np.asarray(ndtri((rankdata(draws).reshape(draws.shape) - 0.375) / (draws.size + 0.25)))


def _ratio(chains: Floats) -> float:
    """Root of the variance of all chains over that within them."""
    steps = chains.shape[1]
    within = float(np.mean(chains.var(axis=1, ddof=1)))
    between = float(chains.mean(axis=1).var(ddof=1))
    if not within > 0.0:
        return float("inf")
    return float(np.sqrt((steps - 1) / steps + between / within))


def _independent(chains: Floats) -> float:
    """Effective number of draws by Geyer's initial monotone sequence of pairs of autocorrelations."""
    many, steps = chains.shape
    centred = chains - chains.mean(axis=1, keepdims=True)
    spectrum = np.fft.rfft(centred, 2 * steps, axis=1)
    products = np.fft.irfft(np.abs(spectrum) ** 2, axis=1)[:, :steps].mean(axis=0) / steps
    within = products[0] * steps / (steps - 1)
    total = within * (steps - 1) / steps + float(chains.mean(axis=1).var(ddof=1))
    if not total > 0.0:
        return 0.0
    correlations = 1.0 - (within - products * steps / (steps - 1)) / total
    correlations[0] = 1.0
    pairs = correlations[: steps // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0.0)
    pairs = np.minimum.accumulate(pairs[: negative[0]] if len(negative) else pairs)
    size = many * steps
    time = max(2.0 * float(pairs.sum()) - 1.0, 1.0 / np.log10(size))
    return float(size / time)
