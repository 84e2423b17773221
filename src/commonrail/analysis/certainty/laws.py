"""Laws of noise: cost, weight and slope of a standardised residual u, and what belongs to its density.

The cost ρ is −2 ln of the density without its constant, ψ = ρ′/2, the weight is ψ/u, and the slope is ψ′. The slope of
the Laplace law is a kernel density estimate: its mean over residuals is twice their density at zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.arrays import Floats
from commonrail.kinds.noise import Law

__all__ = ["LAWS", "DensityLaw", "agreed", "as_normal", "sample_count", "scale_of", "unequal"]


FREEDOM = 4.0  # of Student's t
ROUNDING = 0.2  # of the corner of the Laplace law, and width of the kernel of its density, in scales
_NORMAL = 1.4826  # standard deviation of a normal sample over its median magnitude
_TURNS = 60


class DensityLaw(NamedTuple):
    """A law.

    Attributes
    ----------
    cost, weight, slope : function of (…)
        ρ, ψ/u and ψ′ of standardised residuals.
    constant : float
        −2 ln of the density at zero, with scale 1.
    deviation : float
        Standard deviation over the scale.
    tail : function of (…)
        Probability that a standardised residual exceeds a value u ≥ 0.
    """

    cost: Callable[[Floats], Floats]
    weight: Callable[[Floats], Floats]
    slope: Callable[[Floats], Floats]
    constant: float
    deviation: float
    tail: Callable[[Floats], Floats]


def _student_slope(u: Floats) -> Floats:
    square = u * u
    return np.asarray((FREEDOM + 1.0) * (FREEDOM - square) / (FREEDOM + square) ** 2)


def _rounded(u: Floats) -> Floats:
    return np.asarray(np.sqrt(u * u + ROUNDING**2))


_STUDENT_CONSTANT = 2.0 * (
    math.lgamma(0.5 * FREEDOM) + 0.5 * math.log(FREEDOM * math.pi) - math.lgamma(0.5 * (FREEDOM + 1.0))
)

LAWS: dict[Law, DensityLaw] = {
    Law.GAUSSIAN: DensityLaw(
        lambda u: u * u,
        np.ones_like,
        np.ones_like,
        math.log(2.0 * math.pi),
        1.0,
        lambda u: np.asarray(special.ndtr(-u)),
    ),
    Law.STUDENT: DensityLaw(
        lambda u: np.asarray((FREEDOM + 1.0) * np.log1p(u * u / FREEDOM)),
        lambda u: np.asarray((FREEDOM + 1.0) / (FREEDOM + u * u)),
        _student_slope,
        _STUDENT_CONSTANT,
        math.sqrt(FREEDOM / (FREEDOM - 2.0)),
        lambda u: np.asarray(special.stdtr(FREEDOM, -u)),
    ),
    Law.LAPLACE: DensityLaw(
        lambda u: 2.0 * (_rounded(u) - ROUNDING),
        lambda u: 1.0 / _rounded(u),
        lambda u: ROUNDING**2 / _rounded(u) ** 3,
        2.0 * math.log(2.0),
        math.sqrt(2.0),
        lambda u: np.asarray(0.5 * np.exp(-u)),
    ),
}


def as_normal(law: Law, u: Floats) -> Floats:
    """Magnitudes (n,) of normal variables that are as likely to be exceeded as standardised residuals (n,) of a law."""
    if law is Law.GAUSSIAN:
        return np.asarray(np.abs(u))
    return np.asarray(-special.ndtri(np.maximum(LAWS[law].tail(np.abs(u)), np.finfo(float).tiny)))


def unequal(errors: Floats) -> Floats:
    """Errors that are not exactly zero, or all where none is.

    Meters and evaluations state exactly zero before and after an injection, as the model does: such agreement is no
    sample of the noise, and as one it would make outliers of all others.
    """
    found = errors[errors != 0.0]
    return found if len(found) else errors


def sample_count(errors: Floats) -> int:
    """Number of samples of the noise among errors (n,), see `unequal`; of several series (k, n) those of any."""
    return int(errors.shape[-1] - agreed(errors))


def agreed(errors: Floats) -> int:
    """Number of values of errors (n,), or of all series (k, n), that agree exactly; none where all do."""
    exact = (np.atleast_2d(errors) == 0.0).all(axis=0)
    return 0 if exact.all() else int(np.count_nonzero(exact))


def scale_of(law: Law, errors: Floats, freedom: float) -> float:
    """Scale of errors (n,): the root of Σ weight · error²/freedom, which the weights depend on.

    Parameters
    ----------
    law : Law
        Not "auto".
    errors : (n,)
    freedom : float
        Degrees of freedom: errors that are not exactly zero, less what the fit has used.
    """
    if law is Law.GAUSSIAN:
        return float(np.sqrt(np.sum(errors**2) / freedom))
    variance = max((_NORMAL * float(np.median(np.abs(unequal(errors))))) ** 2, np.finfo(float).tiny)
    for _ in range(_TURNS):
        variance = float(np.sum(LAWS[law].weight(errors / math.sqrt(variance)) * errors**2) / freedom)
        if not variance > 0.0:
            return 0.0
    return math.sqrt(variance)
