"""Probabilities and quantiles of Student's t, of F and of χ², and the normal quantile, from Python's own functions.

They are what a calibration asks for, some ten numbers; SciPy has the same and takes longer to import than they take.
Accurate to 1e-10 of their value up to 1e5 degrees of freedom, beyond that to 1e-7; tests compare them with SciPy's.
"""

from __future__ import annotations

import functools
import math

__all__ = ["beta_share", "gamma_rest", "normal_quantile", "student_quantile", "student_tail"]

_STIRLING = 15.0  # from here on the series of Stirling's formula is exact to rounding
_MANY = 1e5  # degrees of freedom from which rounding of the fraction is larger than the rest of the expansion
_TINY = 1e-300
_TERMS = 1_000_000  # of a fraction or series; they take some sqrt(a)


def normal_quantile(share: float) -> float:
    """Value that a normal variable stays below with a probability."""
    from statistics import NormalDist

    return NormalDist().inv_cdf(share)


def student_tail(t: float, freedom: float) -> float:
    """Probability that Student's t exceeds a value t ≥ 0.

    Parameters
    ----------
    t : float
    freedom : float
        Degrees of freedom.
    """
    if freedom >= _MANY and t**4 <= 1e-3 * freedom:
        return _nearly_normal(t, freedom)
    square = t * t / freedom
    rest = square / (1.0 + square)
    return 0.5 * _share(0.5 * freedom, 0.5, 1.0 / (1.0 + square), rest)


def _nearly_normal(t: float, freedom: float) -> float:
    """Tail of Student's t of many degrees of freedom: the normal one and two terms of its expansion (Fisher 1925)."""
    density = math.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi)
    first = t * (t**2 + 1.0) / (4.0 * freedom)
    second = t * (3.0 * t**6 - 7.0 * t**4 - 5.0 * t**2 - 3.0) / (96.0 * freedom**2)
    return 0.5 * math.erfc(t / math.sqrt(2.0)) + density * (first + second)


@functools.lru_cache(maxsize=64)  # the parameters of a fit have the same freedom
def student_quantile(freedom: float, share: float) -> float:
    """Value ≥ 0 that Student's t stays below with a probability of one half or more.

    Parameters
    ----------
    freedom : float
        Degrees of freedom.
    share : float
        Probability, from 0.5 to below 1.
    """
    tail, low, high = 1.0 - share, 0.0, 1.0
    while student_tail(high, freedom) > tail:
        low, high = high, 2.0 * high
    at = 0.5 * (low + high)
    scale = math.exp(-_log_beta(0.5 * freedom, 0.5)) / math.sqrt(freedom)
    for _ in range(200):  # Newton's steps, halved where they leave the bracket
        excess = student_tail(at, freedom) - tail
        low, high = (at, high) if excess > 0.0 else (low, at)
        density = scale * math.exp(-0.5 * (freedom + 1.0) * math.log1p(at * at / freedom))
        wanted = at + excess / density if density > 0.0 else low
        after = wanted if low < wanted < high else 0.5 * (low + high)
        if abs(after - at) <= 1e-15 * after:
            return after
        at = after
    return at


def beta_share(a: float, b: float, x: float) -> float:
    """Regularised incomplete beta function I_x(a, b).

    Parameters
    ----------
    a, b : float
        Positive.
    x : float
        From 0 to 1.
    """
    return _share(a, b, x, 1.0 - x)


def gamma_rest(a: float, x: float) -> float:
    """Regularised upper incomplete gamma function Q(a, x); of χ² with k degrees of freedom Q(k/2, χ²/2).

    Parameters
    ----------
    a : float
        Positive.
    x : float
        Not negative.
    """
    if x <= 0.0:
        return 1.0
    distance = (x - a) / a
    if a >= _STIRLING and distance > -1.0:
        front = a * (math.log1p(distance) - distance) + 0.5 * math.log(a / (2.0 * math.pi)) - _stirling(a)
    else:
        front = a * math.log(x) - x - math.lgamma(a)
    if front < -745.0:  # smaller than any number
        return 1.0 if x < a else 0.0
    return 1.0 - math.exp(front) * _gamma_series(a, x) if x < a + 1.0 else math.exp(front) * _gamma_fraction(a, x)


def _gamma_series(a: float, x: float) -> float:
    """Sum of xⁿ / (a (a + 1) … (a + n))."""
    term = total = 1.0 / a
    for n in range(1, _TERMS):
        term *= x / (a + n)
        total += term
        if term <= 1e-17 * total:
            break
    return total


def _gamma_fraction(a: float, x: float) -> float:
    """Continued fraction of Γ(a, x) eˣ x⁻ᵃ by Lentz's method."""
    b = x + 1.0 - a
    c, d = 1.0 / _TINY, 1.0 / b
    found = d
    for n in range(1, _TERMS):
        step, b = -n * (n - a), b + 2.0
        d = 1.0 / _not_zero(b + step * d)
        c = _not_zero(b + step / c)
        found *= c * d
        if abs(c * d - 1.0) <= 1e-16:
            break
    return found


def _share(a: float, b: float, x: float, rest: float) -> float:
    """I_x(a, b), with 1 − x given, which may be too small for a difference."""
    if x <= 0.0 or rest <= 0.0:
        return 0.0 if x <= 0.0 else 1.0
    log_x = math.log1p(-rest) if rest < 0.5 else math.log(x)
    log_rest = math.log1p(-x) if x < 0.5 else math.log(rest)
    front = a * log_x + b * log_rest - _log_beta(a, b)
    front = math.exp(front) if front > -745.0 else 0.0
    if x < (a + 1.0) / (a + b + 2.0):
        return front * _beta_fraction(a, b, x) / a
    return 1.0 - front * _beta_fraction(b, a, rest) / b


def _beta_fraction(a: float, b: float, x: float) -> float:
    """Continued fraction of the incomplete beta function by Lentz's method."""
    c, d = 1.0, 1.0 / _not_zero(1.0 - (a + b) * x / (a + 1.0))
    found = d
    for m in range(1, _TERMS):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        for step in (even, odd):
            d = 1.0 / _not_zero(1.0 + step * d)
            c = _not_zero(1.0 + step / c)
            found *= c * d
        if abs(c * d - 1.0) <= 1e-16:
            break
    return found


def _not_zero(value: float) -> float:
    return value if abs(value) > _TINY else _TINY


def _log_beta(a: float, b: float) -> float:
    """Return ln B(a, b), without the difference of large logarithms."""
    large, small = max(a, b), min(a, b)
    if large < _STIRLING:
        return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)
    both = large + small
    # ln Γ(large + small) − ln Γ(large)
    rise = small * math.log(large) + (both - 0.5) * math.log1p(small / large) - small
    rise += _stirling(both) - _stirling(large)
    if small < _STIRLING:
        return math.lgamma(small) - rise
    own = (small - 0.5) * math.log(small) - small + 0.5 * math.log(2.0 * math.pi) + _stirling(small)
    return own - rise


def _stirling(x: float) -> float:
    """Remainder of Stirling's formula for ln Γ(x)."""
    square = 1.0 / (x * x)
    series = 1.0 / 12.0 + square * (
        -1.0 / 360.0
        + square * (1.0 / 1260.0 + square * (-1.0 / 1680.0 + square * (1.0 / 1188.0 - square * 691.0 / 360360.0)))
    )
    return series / x
