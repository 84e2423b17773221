"""Non-linear least squares within bounds, whose bits do not depend on the processor.

A projected Levenberg–Marquardt method (Kanzow, Yamashita, Fukushima 2004) with Nielsen's (1999) rule for the damping.
SciPy's `least_squares`, which studies without `same_bits` use, rests on LAPACK, and that takes its inner loops by
processor; here all sums have a stated order (`commonrail.linear`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Bools, Floats
from commonrail.elementary import norm, product
from commonrail.linear import least_squares

__all__ = ["Ended", "Limits", "soft_l1", "within_unit_box"]


_FIRST_DAMPING = 1e-3  # of the largest square of a column of the Jacobian
_FLAT = 1e-8  # a projected gradient below this is zero


class Limits(NamedTuple):
    """Ends of a search, and the residual beyond which the loss grows linearly.

    Attributes
    ----------
    scale : float
        Of residuals, for the soft-L1 loss.
    tolerance : float
        Relative change of cost, or of the point, below which the search ends.
    evaluations : int
        Points tried at most, the start included.
    """

    scale: float
    tolerance: float
    evaluations: int


class Ended(NamedTuple):
    """Best point (d,) and the reason for the end."""

    x: Floats
    message: str


class _Slope(NamedTuple):
    """Problem linearised at a point: weighted Jacobian (m, d) and residuals (m,), gradient of the cost (d,)."""

    jacobian: Floats
    residuals: Floats
    gradient: Floats


def soft_l1(residuals: Floats, scale: float) -> float:
    """Half the sum of the soft-L1 losses of residuals (m,).

    Parameters
    ----------
    residuals : (m,)
    scale : float
        Residual beyond which the loss grows linearly; infinite for half the sum of squares.
    """
    if np.isinf(scale):
        return float(0.5 * np.sum(residuals * residuals))
    square = (residuals / scale) * (residuals / scale)
    return float(scale * scale * np.sum(square / (1.0 + np.sqrt(1.0 + square))))


def within_unit_box(
    values: Callable[[Floats], Floats], jacobian: Callable[[Floats], Floats], start: Floats, limits: Limits
) -> Ended:
    """Minimise the soft-L1 cost of residuals over 0 ≤ x ≤ 1.

    Parameters
    ----------
    values : function (d,) → (m,)
        Finite residuals at a point.
    jacobian : function (d,) → (m, d)
    start : (d,)
    limits : Limits
    """
    x, left = np.clip(start, 0.0, 1.0), limits.evaluations - 1
    found = values(x)
    cost, damping, growth = soft_l1(found, limits.scale), -1.0, 2.0
    while left > 0:
        slope = _linearised(jacobian(x), found, limits.scale)
        free = ~(((x <= 0.0) & (slope.gradient > 0.0)) | ((x >= 1.0) & (slope.gradient < 0.0)))
        if not np.any(np.abs(slope.gradient[free]) > _FLAT):
            return Ended(x, "the gradient vanishes within the bounds")
        if damping < 0.0:
            damping = _FIRST_DAMPING * float(np.max(np.sum(slope.jacobian * slope.jacobian, axis=0)))
        while left > 0:
            move = np.clip(x + _step(slope, free, damping), 0.0, 1.0) - x
            if norm(move) < limits.tolerance * (limits.tolerance + norm(x)):
                return Ended(x, "the point no longer moves")
            there, left = values(x + move), left - 1
            lower = soft_l1(there, limits.scale)
            ratio = (cost - lower) / max(_predicted(slope, move), np.finfo(float).tiny)
            if lower < cost:
                break
            damping, growth = damping * growth, 2.0 * growth
        if not lower < cost:
            break
        ended = cost - lower < limits.tolerance * cost and ratio > 0.25
        x, found, cost, growth = x + move, there, lower, 2.0
        gain = 2.0 * ratio - 1.0
        damping *= max(1.0 / 3.0, 1.0 - gain * gain * gain)
        if ended:
            return Ended(x, "the cost no longer falls")
    return Ended(x, "the largest number of evaluations is reached")


def _linearised(jacobian: Floats, residuals: Floats, scale: float) -> _Slope:
    """Weigh a linearisation so that half its sum of squares has the slope and curvature of the soft-L1 cost.

    Parameters
    ----------
    jacobian : (m, d)
    residuals : (m,)
    scale : float
        As in `soft_l1`.
    """
    ratio = residuals / scale
    root = np.sqrt(1.0 + ratio * ratio)
    gradient = np.sum((residuals / root)[:, None] * jacobian, axis=0)
    curvature = 1.0 / (root * root * root)
    weight = np.sqrt(curvature)
    return _Slope(weight[:, None] * jacobian, residuals / root / weight, gradient)


def _step(slope: _Slope, free: Bools, damping: float) -> Floats:
    """Damped step (d,) of the linearised problem, 0 for parameters held at a bound.

    Parameters
    ----------
    slope : _Slope
    free : (d,) bool
    damping : float
    """
    count = int(np.count_nonzero(free))
    rows = np.vstack([slope.jacobian[:, free], np.sqrt(damping) * np.eye(count)])
    step = np.zeros(len(free))
    step[free] = least_squares(rows, np.concatenate([-slope.residuals, np.zeros(count)]))
    return step


def _predicted(slope: _Slope, move: Floats) -> float:
    """Fall of the cost along a move by the linearised problem."""
    change = product(slope.jacobian, move[:, None])[:, 0]
    return -float(np.sum(slope.gradient * move) + 0.5 * np.sum(change * change))
