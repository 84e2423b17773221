"""Criteria of optimal design, as the logarithm of a typical standard deviation, averaged over draws of the parameters.

A measurement adds rᵀr of its whitened derivatives r to the information H, and V = H⁻¹. With rows e of what is to be
known, C = e V eᵀ. Errors that measurements share are further columns of H, r and e, with unit prior information: the
sum then is that of generalised least squares with the whole covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats

__all__ = ["Criterion", "Problem"]


class Criterion(StrEnum):
    """Figure that a plan is to make small."""

    D = "d"
    """Volume of the region of the named parameters: ½ ln det C over their number."""

    A = "a"
    """Mean squared standard error of the named parameters: ½ ln of the mean of C's diagonal."""

    V = "v"
    """Mean variance of predictions: the same, the rows being those of the predictions."""


class Problem(NamedTuple):
    """Linear models of measurements at several draws of the parameters.

    Attributes
    ----------
    criterion : Criterion
    information : (s, D, D)
        Of what is known before, positive definite.
    rows : (s, c, r, D)
        Whitened derivatives of each of c candidates, which has up to r independent values; zero where it has fewer.
    aims : (s, k, D)
        Rows of what is to be known.
    """

    criterion: Criterion
    information: Floats
    rows: Floats
    aims: Floats

    def covariance(self, chosen: Sequence[int]) -> Floats:
        """Covariance V (s, D, D) after candidates have been measured; one may be chosen several times."""
        rows = self.rows[:, list(chosen)]
        rows = rows.reshape(len(rows), -1, rows.shape[-1])
        return np.asarray(np.linalg.inv(self.information + rows.transpose(0, 2, 1) @ rows))

    def score(self, chosen: Sequence[int]) -> float:
        """Criterion after candidates have been measured."""
        covariance = self.covariance(chosen)
        if self.criterion is Criterion.D:
            aimed = self.aims @ covariance @ self.aims.transpose(0, 2, 1)
            return float(np.mean(0.5 * np.linalg.slogdet(aimed)[1]) / self.aims.shape[1])
        return float(np.mean(0.5 * np.log(self.variances(chosen).mean(axis=1))))

    def variances(self, chosen: Sequence[int]) -> Floats:
        """Variances (s, k) of what is to be known, after candidates have been measured."""
        return np.asarray(np.einsum("skd,sde,ske->sk", self.aims, self.covariance(chosen), self.aims))

    def scores(self, chosen: Sequence[int]) -> Floats:
        """Criterion (c,) after candidates have been measured and, in addition, each of them."""
        covariance = self.covariance(chosen)
        spread = self.rows @ covariance[:, None]  # (s, c, r, D)
        seen = spread @ self.rows.transpose(0, 1, 3, 2)
        gained = np.eye(seen.shape[-1]) + seen  # covariance (s, c, r, r) of a candidate's values before it is measured
        crossed = spread @ self.aims.transpose(0, 2, 1)[:, None]  # (s, c, r, k)
        aimed = self.aims @ covariance @ self.aims.transpose(0, 2, 1)
        if self.criterion is Criterion.D:
            explained = crossed @ np.linalg.solve(aimed[:, None], crossed.transpose(0, 1, 3, 2))
            known, before = np.linalg.slogdet(aimed)[1], np.linalg.slogdet(gained)[1]
            after = np.linalg.slogdet(gained - explained)[1]
            return np.asarray(np.mean(0.5 * (known[:, None] + after - before), axis=0) / self.aims.shape[1])
        fallen = np.einsum("scrk,scrk->sc", crossed, np.linalg.solve(gained, crossed))
        before = np.einsum("skk->s", aimed)
        left = np.maximum(before[:, None] - fallen, 1e-12 * before[:, None])
        return np.asarray(np.mean(0.5 * np.log(left / self.aims.shape[1]), axis=0))
