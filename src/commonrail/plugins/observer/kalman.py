"""Iterated extended Kalman filter from shot to shot, with the change since a reference."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from commonrail.base.arrays import Floats
from commonrail.plugins.observer.response import Response
from commonrail.plugins.observer.study import DriftState

CONVERGED = 0.05  # largest change of an iteration that ends it, in standard deviations before the shot; chosen


class Belief(NamedTuple):
    """States with their uncertainty, and the reference of the alarm.

    Attributes
    ----------
    mean : (states,)
    covariance : (states, states)
    reference : (states,) or None
        Mean when the reference was taken.
    reference_covariance, cross : (states, states)
        Covariance of the reference, and of the states with it.
    """

    mean: Floats
    covariance: Floats
    reference: Floats | None
    reference_covariance: Floats
    cross: Floats

    @classmethod
    def before(cls, states: tuple[DriftState, ...]) -> Belief:
        """Belief before the first shot."""
        covariance = np.diag([state.deviation**2 for state in states])
        return cls(np.zeros(len(states)), covariance, None, covariance, covariance)

    def walked(self, states: tuple[DriftState, ...]) -> Belief:
        """Belief about the next shot."""
        return self._replace(covariance=self.covariance + np.diag([state.walk**2 for state in states]))

    def with_reference(self) -> Belief:
        """The present states become the reference."""
        return self._replace(reference=self.mean, reference_covariance=self.covariance, cross=self.covariance)

    def change(self) -> tuple[Floats, Floats]:
        """Change since the reference and its standard deviation, (states,) each; zero and infinite without one."""
        if self.reference is None:
            return np.zeros_like(self.mean), np.full_like(self.mean, np.inf)
        spread = self.covariance + self.reference_covariance - self.cross - self.cross.T
        return self.mean - self.reference, np.sqrt(np.maximum(np.diag(spread), 0.0))


class Update(NamedTuple):
    """Belief after a shot, and its figures.

    Attributes
    ----------
    belief : Belief
    figures, deviations : (3, injections)
        Quantity [m³], opening and closing [s], and their standard deviations.
    consistency : float
        Squared innovation over its expectation, 1 on average of a true model.
    residual : (samples,)
        Measured less simulated pressure at the new states [Pa].
    """

    belief: Belief
    figures: Floats
    deviations: Floats
    consistency: float
    residual: Floats


def update(
    belief: Belief,
    states: tuple[DriftState, ...],
    measured: Floats,
    covariance: Callable[[Response], Floats],
    simulate: Callable[[Floats], Response | None],
    iterations: int,
) -> Update | None:
    """Belief and figures after a shot; None if it cannot be simulated.

    What a shot has for itself (`DriftState.scatter`) is estimated with the states and then forgotten: it moves the
    figures of this shot alone.

    Parameters
    ----------
    belief : Belief
        About this shot, `Belief.walked`.
    states : tuple of DriftState
    measured : (samples,)
        Pressure less that at rest [Pa].
    covariance : function of Response
        Covariance (samples, samples) of disturbance and discrepancy [Pa²].
    simulate : function of (states,)
    iterations : int

    Notes
    -----
    Update of Bell and Cathey (1993), IEEE Trans. Automatic Control 38, 294: Gauss-Newton on the posterior. The
    reference is not updated; the covariance of the change holds for any gain.
    """
    n = len(states)
    extra = [i for i, state in enumerate(states) if state.scatter > 0.0]
    scatter = np.array([states[i].scatter for i in extra])
    prior = np.zeros((n + len(extra), n + len(extra)))
    prior[:n, :n] = belief.covariance
    prior[n:, n:] = np.diag(scatter**2)
    inverse = np.linalg.inv(prior)
    start = np.concatenate([belief.mean, np.zeros(len(extra))])
    spread = np.sqrt(np.diag(prior))
    z = start
    consistency, step = np.nan, np.zeros_like(z)
    found: Response | None = None
    for k in range(iterations):
        both = z[:n].copy()
        both[extra] += z[n:]
        found = simulate(both)
        if found is None:
            return None
        slopes = np.hstack([found.slopes, found.slopes[:, extra]])
        factor = np.linalg.cholesky(covariance(found))
        white = solve_triangular(factor, slopes, lower=True)
        rest = solve_triangular(factor, measured - found.pressure + slopes @ (z - start), lower=True)
        posterior = cho_solve(cho_factor(inverse + white.T @ white), np.eye(len(z)))
        step = start + posterior @ (white.T @ rest) - z
        if k == 0:
            gain = white.T @ rest
            consistency = float(rest @ rest - gain @ posterior @ gain) / len(rest)
        step = np.clip(step, -3.0 * spread, 3.0 * spread)
        z = z + step
        if np.max(np.abs(step) / spread) < CONVERGED:
            break
    assert found is not None  # there is one iteration or more
    figure_slopes = np.concatenate([found.figure_slopes, found.figure_slopes[..., extra]], axis=-1)
    variances = np.einsum("abi,ij,abj->ab", figure_slopes, posterior, figure_slopes)
    keep = (posterior @ inverse)[:n, :n]
    return Update(
        belief._replace(mean=z[:n], covariance=posterior[:n, :n], cross=keep @ belief.cross),
        found.figures + figure_slopes @ step,
        np.sqrt(variances),
        consistency,
        measured - found.pressure - slopes @ step,
    )
