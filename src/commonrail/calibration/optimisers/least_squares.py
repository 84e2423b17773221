"""Losses of residuals that descents lower: weights, curvature, and which of them is nearest to an objective."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats


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

    def curvature(self, residuals: Floats, scale: float) -> Floats:
        """Mean curvature (k,) of the loss of residuals (k, m) over that of Σ w r², which is above it: from 1/4 to 1."""
        if self is DescentLoss.SQUARES:
            return np.ones(len(residuals))
        width = 1.0 if self is DescentLoss.SOFT else scale
        root = np.sqrt(residuals * residuals + width * width)
        share = np.sum(width * width / (root * root * root), axis=1) / np.sum(1.0 / root, axis=1)
        return np.asarray(np.clip(share, 0.25, 1.0))

    @property
    def units(self) -> float:
        """2 ln L per residual for a relative change of the sum: 2 for a Laplace distribution of errors, else 1."""
        return 2.0 if self is DescentLoss.ABSOLUTE else 1.0


def recognised(costs: Floats, residuals: Floats) -> DescentLoss:
    """Loss whose sums over residuals come nearest to an objective, or are it; squares where none can be compared.

    Parameters
    ----------
    costs : (n,)
        Objective of candidates.
    residuals : (n, m)
        Their residuals.
    """
    usable = np.isfinite(costs) & np.isfinite(residuals).all(axis=1)

    def distance(loss: DescentLoss) -> float:
        return float(np.sum(np.abs(loss.sums(residuals[usable], 0.0) - costs[usable])))

    return min(DescentLoss, key=distance)


class LossSum(NamedTuple):
    """Sum of losses of residuals, a `Criterion` of least squares; the scale is that of `DescentLoss`."""

    loss: DescentLoss = DescentLoss.SQUARES
    scale: float = 1.0

    @classmethod
    def near(cls, loss: DescentLoss, residuals: Floats) -> LossSum:
        """Sum whose absolute values are smoothed over half of the mean magnitude of residuals (m,)."""
        return cls(loss, max(0.5 * float(np.mean(np.abs(residuals))), 1e-300))

    def innovations(self, residuals: Floats, unit: Floats) -> Floats:
        """The residuals."""
        return residuals

    def tangents(self, slopes: Floats, unit: Floats) -> Floats:
        """The derivatives of the residuals."""
        return slopes

    def costs(self, innovations: Floats) -> Floats:
        """Sums of the losses."""
        return self.loss.sums(innovations, self.scale)

    def weights(self, innovations: Floats) -> Floats:
        """Weights of the residuals."""
        return self.loss.weights(innovations, self.scale)

    def curvature(self, innovations: Floats) -> Floats:
        """Curvature of the losses over that of the weighted squares."""
        return self.loss.curvature(innovations, self.scale)
