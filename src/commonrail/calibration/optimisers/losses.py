"""Losses of residuals that descents lower: weights, curvature, and which of them an objective is the sum of."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from commonrail.arrays import Floats

__all__ = ["DescentLoss", "recognised"]


_ALIKE = 1e-6  # relative difference between an objective and a sum of losses that counts as rounding


class DescentLoss(StrEnum):
    """Loss of a residual; `scale` smooths the absolute value only."""

    SQUARES = "squares"
    """r²."""

    ABSOLUTE = "absolute errors"
    """sqrt(r² + scale²) − scale, which is |r| for residuals far above the scale."""

    SOFT = "soft L1"
    """2 (sqrt(1 + r²) − 1)."""

    def values(self, residuals: Floats, scale: float) -> Floats:
        """Loss of each residual."""
        if self is DescentLoss.SQUARES:
            return residuals * residuals
        if self is DescentLoss.SOFT:
            return 2.0 * (np.sqrt(1.0 + residuals * residuals) - 1.0)
        return np.sqrt(residuals * residuals + scale * scale) - scale

    def sums(self, residuals: Floats, scale: float) -> Floats:
        """Sum (…,) of the losses of residuals (…, m); +inf where one is not finite."""
        with np.errstate(invalid="ignore", over="ignore"):
            total = np.sum(self.values(residuals, scale), axis=-1)
        return np.where(np.isfinite(total), total, np.inf)

    def weights(self, residuals: Floats, scale: float) -> Floats:
        """Weights w with which the slope of Σ w r², w held, is that of the loss."""
        if self is DescentLoss.SQUARES:
            return np.ones_like(residuals)
        if self is DescentLoss.SOFT:
            return 1.0 / np.sqrt(1.0 + residuals * residuals)
        return 0.5 / np.sqrt(residuals * residuals + scale * scale)

    def bend(self, residuals: Floats, scale: float) -> float:
        """Mean curvature of the loss over that of Σ w r², which is above it: from a quarter to 1."""
        if self is DescentLoss.SQUARES:
            return 1.0
        width = 1.0 if self is DescentLoss.SOFT else scale
        root = np.sqrt(residuals * residuals + width * width)
        share = float(np.sum(width * width / (root * root * root)) / np.sum(1.0 / root))
        return min(max(share, 0.25), 1.0)

    @property
    def units(self) -> float:
        """2 ln L per residual for a relative change of the sum: 2 for a Laplace distribution of errors, else 1."""
        return 2.0 if self is DescentLoss.ABSOLUTE else 1.0


def recognised(costs: Floats, residuals: Floats) -> DescentLoss:
    """Loss whose sums over residuals are the objective; squares where none is.

    Parameters
    ----------
    costs : (n,)
        Objective of candidates.
    residuals : (n, m)
        Their residuals.
    """
    usable = np.isfinite(costs) & np.isfinite(residuals).all(axis=1)
    for loss in DescentLoss:
        sums = loss.sums(residuals[usable], 0.0)
        if usable.any() and np.all(np.abs(sums - costs[usable]) <= _ALIKE * np.abs(costs[usable])):
            return loss
    return DescentLoss.SQUARES
