"""Iterated extended Kalman filter from shot to shot, and the test of its innovations for a drift."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from commonrail.base.arrays import Floats
from commonrail.plugins.observer.response import Response
from commonrail.plugins.observer.study import DriftState

TIMES = 3e-6  # standard deviation of what the model lacks in openings and closings [s]: an estimate [E]
# Largest consistency of a shot that is learnt from; 1,000 sound ones reached 1.5 (studies/observer_trial.py).
TRUSTED = 3.0
CONVERGED = 0.05  # largest change of an iteration that ends it, in standard deviations before the shot; chosen


class Belief(NamedTuple):
    """States: mean (states,) and covariance (states, states)."""

    mean: Floats
    covariance: Floats

    @classmethod
    def before(cls, states: tuple[DriftState, ...]) -> Belief:
        """Belief before the first shot."""
        return cls(np.zeros(len(states)), np.diag([state.deviation**2 for state in states]))

    def walk(self, states: tuple[DriftState, ...]) -> Belief:
        """Belief about the next shot."""
        return self.spread([state.walk**2 for state in states])

    def spread(self, variances: ArrayLike) -> Belief:
        """Belief with variances (states,) more."""
        return self._replace(covariance=self.covariance + np.diag(variances))


def innovation(
    belief: Belief, states: tuple[DriftState, ...], residual: Floats, slopes: Floats, covariance: Floats
) -> Floats:
    """Whitened innovation (rows,) of a shot, that of each row given the rows before it: 1 on average of its square.

    `residual` (rows,): measured less expected; `slopes` (rows, states); `covariance` (rows, rows) of what is measured.
    """
    prior = belief.covariance + np.diag([state.scatter**2 for state in states])
    factor = np.linalg.cholesky(slopes @ prior @ slopes.T + covariance)
    return np.asarray(solve_triangular(factor, residual, lower=True))


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
    rate, rate_deviation : (times,)
        Of injection, as in `Response`, and its standard deviation [m³/s].
    at, shot_states : (states,)
        States at which the shot was simulated last, and those found; with what the shot has for itself.
    response : Response
        Simulated there.
    information : (states, states)
    score : (states,)
        Of what the shot alone says of states x: its log-likelihood is score·x - x·information·x / 2 but for a constant.
    """

    belief: Belief
    figures: Floats
    deviations: Floats
    consistency: float
    residual: Floats
    rate: Floats
    rate_deviation: Floats
    at: Floats
    shot_states: Floats
    response: Response
    information: Floats
    score: Floats


def update(
    belief: Belief,
    states: tuple[DriftState, ...],
    measured: Floats,
    covariance: Callable[[Response], Floats],
    simulate: Callable[[Floats], Response | None],
    iterations: int,
    *,
    trusted: float = TRUSTED,
) -> Update | None:
    """Belief and figures after a shot; None if it cannot be simulated.

    A shot that is not to be trusted, such as one beside another injector's, changes no state; its figures are those of
    the states before it.

    What a shot has for itself (`DriftState.scatter`) is estimated with the states and then forgotten: it moves the
    figures of this shot alone.

    Parameters
    ----------
    belief : Belief
        About this shot, `Belief.walk`.
    states : tuple of DriftState
    measured : (samples,)
        As `Response.shown`.
    covariance : function of Response
        Covariance (samples, samples) of disturbance and discrepancy [Pa²].
    simulate : function of (states,)
    iterations : int
    trusted : float
        Largest consistency of a shot that is learnt from.

    Notes
    -----
    Update of Bell and Cathey (1993), IEEE Trans. Automatic Control 38, 294: Gauss-Newton on the posterior.
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
    response: Response | None = None
    for k in range(iterations):
        at = _states_of_shot(z, n, extra)
        response = simulate(at)
        if response is None:
            return None
        slopes = _append_scatter_slopes(response.slopes, extra)
        factor = np.linalg.cholesky(covariance(response))
        white = solve_triangular(factor, slopes, lower=True)
        rest = solve_triangular(factor, measured - response.shown + slopes @ (z - start), lower=True)
        posterior = cho_solve(cho_factor(inverse + white.T @ white), np.eye(len(z)))
        step = start + posterior @ (white.T @ rest) - z
        if k == 0:
            gain = white.T @ rest
            consistency = float(rest @ rest - gain @ posterior @ gain) / len(rest)
            if consistency > trusted:
                posterior, step = prior, np.zeros_like(z)
                white, rest = np.zeros_like(white), np.zeros_like(rest)
                break
        step = np.clip(step, -3.0 * spread, 3.0 * spread)
        z = z + step
        if np.max(np.abs(step) / spread) < CONVERGED:
            break
    assert response is not None  # there is one iteration or more
    # what the shot says of the states, about those before it, without what it has for itself
    gram, gain = white.T @ white, white.T @ rest
    shared = np.linalg.solve(gram[n:, n:] + np.diag(scatter**-2.0), np.column_stack([gram[n:, :n], gain[n:]])).T
    information, score = gram[:n, :n] - shared[:n] @ gram[n:, :n], gain[:n] - gram[:n, n:] @ shared[n]
    figure_slopes, rate_slopes = (
        _append_scatter_slopes(response.figure_slopes, extra),
        _append_scatter_slopes(response.rate_slopes, extra),
    )
    variances = np.einsum("abi,ij,abj->ab", figure_slopes, posterior, figure_slopes)
    variances[1:] += TIMES**2
    return Update(
        belief=Belief(z[:n], posterior[:n, :n]),
        figures=response.figures + figure_slopes @ step,
        deviations=np.sqrt(variances),
        consistency=consistency,
        residual=measured - response.shown - slopes @ step,
        rate=response.rate + rate_slopes @ step,
        rate_deviation=np.sqrt(np.einsum("ti,ij,tj->t", rate_slopes, posterior, rate_slopes)),
        at=at,
        shot_states=_states_of_shot(z, n, extra),
        response=response,
        information=information,
        score=score + information @ belief.mean,
    )


def _states_of_shot(z: Floats, n: int, extra: list[int]) -> Floats:
    """States (n,) of a shot with what it has for itself."""
    shot_states = z[:n].copy()
    shot_states[extra] += z[n:]
    return shot_states


def _append_scatter_slopes(slopes: Floats, extra: list[int]) -> Floats:
    """Slopes (..., states) with those of what a shot has for itself."""
    return np.concatenate([slopes, slopes[..., extra]], axis=-1)


class Alarm(NamedTuple):
    """Drift of one state: its name, shots ago when it began (0: this one), size and standard deviation of the step."""

    state: str
    ago: int
    size: float
    deviation: float


class StepTest:
    """Generalised likelihood ratio of a step of one state at one of the last shots.

    Method of Willsky and Jones (1976), IEEE Trans. Automatic Control 21, 108: what a unit step leaves in the
    innovations of the filter is known, since the filter is; their likelihood gives its size. By Woodbury's identity
    innovations and slopes enter through the covariance before and after a shot alone.

    Parameters
    ----------
    states : tuple of DriftState
    window : int
        Shots that are looked back upon.
    significance : float
        Standard deviations of a step that an alarm asks for, besides `DriftState.limit`.
    """

    def __init__(self, states: tuple[DriftState, ...], window: int, significance: float) -> None:
        self.states, self.window, self.significance = states, window, significance
        self._limits = np.array([state.limit or np.inf for state in states])
        self.reset()

    def reset(self) -> None:
        """Forget all shots."""
        self._left: list[Floats] = []  # of a unit step of each state (columns), by onset: error of the mean
        self._sums: list[tuple[Floats, Floats]] = []  # score and information (states,)

    def add(self, before: Belief, after: Belief) -> None:
        """Take a shot's belief before (`Belief.walk`) and after it."""
        n = len(self.states)
        inverse = np.linalg.inv(before.covariance)
        factor = after.covariance @ inverse
        score, information = inverse @ (after.mean - before.mean), inverse - inverse @ factor
        self._left = [*self._left, np.eye(n)][-self.window :]
        self._sums = [*self._sums, (np.zeros(n), np.zeros(n))][-self.window :]
        for i, (left, (s, f)) in enumerate(zip(self._left, self._sums, strict=True)):
            self._sums[i] = (s + left.T @ score, f + np.einsum("ij,ik,kj->j", left, information, left))
            self._left[i] = factor @ left

    def alarm(self) -> Alarm | None:
        """The most significant step; None if there is none beyond significance and limit."""
        best, largest = None, self.significance
        for i, (score, information) in enumerate(self._sums):
            deviation = 1.0 / np.sqrt(np.maximum(information, 1e-300))
            size = score * deviation**2
            ratio = np.where(np.abs(size) > self._limits, np.abs(size) / deviation, 0.0)
            j = int(np.argmax(ratio))
            if ratio[j] > largest:
                largest = float(ratio[j])
                best = Alarm(self.states[j].name, len(self._sums) - 1 - i, float(size[j]), float(deviation[j]))
        return best
