"""Mean and spread of a parameter over parts whose own values are known with errors (random effects)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arrays import Floats

__all__ = ["Estimate", "FEWEST", "over_parts", "without_prior"]

FEWEST = 2  # parts that data hold, for a spread
_FAINT = 0.1  # data that tell less than this share of what the prior does tell nothing


_HALVINGS = 200  # of the interval that holds the variance between parts: to the last bit


class Estimate(NamedTuple):
    """Mean over parts, and the standard deviation of the next part's value about it.

    Attributes
    ----------
    value : float
        Mean over the parts, each weighed by its own error.
    spread : float
        sqrt(between² + error of the mean²): that of the next part's value about `value`.
    between : float
        Standard deviation between parts beyond what their errors explain; 0 if they explain it all.
    """

    value: float
    spread: float
    between: float


def over_parts(values: ArrayLike, errors: ArrayLike) -> Estimate:
    """Two-step estimate of the distribution of a parameter over parts.

    Each part's value x_i has been fitted by itself, with the standard error e_i. The variance between parts, τ², is
    that for which Σ (x_i − μ)²/(e_i² + τ²) equals n − 1 (Paule and Mandel 1982), with μ the mean weighed by
    1/(e_i² + τ²). A part whose error is not known is left out: its data do not hold the parameter.

    Parameters
    ----------
    values : (n,)
        At least two of them with a known error.
    errors : (n,)
        Standard errors by the data alone (see `without_prior`) in the unit of the values, ≥ 0; NaN where not known.

    Returns
    -------
    Estimate
    """
    known = np.isfinite(np.asarray(errors, float))
    x, variance = np.asarray(values, float)[known], np.asarray(errors, float)[known] ** 2
    low, high = 0.0, float(np.sum((x - np.mean(x)) ** 2))
    if _excess(x, variance) > 0.0:  # the errors alone do not explain the differences
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _excess(x, variance + middle) > 0.0 else (low, middle)
    else:
        high = 0.0
    mean, error = _mean(x, variance + high)
    return Estimate(mean, float(np.sqrt(high + error**2)), float(np.sqrt(high)))


def without_prior(values: ArrayLike, errors: ArrayLike, prior: tuple[float, float] | None) -> tuple[Floats, Floats]:
    """Values and errors that the data alone give, of a fit with a prior.

    Every part had the same prior: counted once a part, it would draw the parts together and to its value. With the
    posterior's x and e and the prior's μ and σ, the data's weight is 1/e² − 1/σ².

    Parameters
    ----------
    values, errors : (n,)
        Of fits; NaN for an error that is not known.
    prior : (value, sigma) or None

    Returns
    -------
    values, errors : (n,)
        Both NaN where the data tell less than a tenth of what the prior tells.
    """
    x, e = np.asarray(values, float), np.asarray(errors, float)
    if prior is None:
        return x, e
    mean, own = prior[0], prior[1] ** -2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        total = e**-2.0
        weight = np.where(total - own > _FAINT * own, total - own, np.nan)
        return np.where(np.isinf(total), x, (x * total - mean * own) / weight), weight**-0.5


def _mean(x: Floats, variance: Floats) -> tuple[float, float]:
    """Weighed mean and its standard error."""
    if not np.all(variance > 0.0):  # all parts alike, or exact
        return float(np.mean(x)), 0.0
    weights = 1.0 / variance
    return float(np.sum(weights * x) / np.sum(weights)), float(1.0 / np.sqrt(np.sum(weights)))


def _excess(x: Floats, variance: Floats) -> float:
    """Σ (x − μ)²/variance beyond n − 1."""
    if not np.all(variance > 0.0):
        return float(np.ptp(x) > 0.0)
    mean, _ = _mean(x, variance)
    return float(np.sum((x - mean) ** 2 / variance)) - (len(x) - 1)
