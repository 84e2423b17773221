"""Iterated extended Kalman filter from shot to shot, and a test of its innovations for drift."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from commonrail.base.arrays import Floats
from commonrail.plugins.observer.response import Response
from commonrail.plugins.observer.study import DriftState

TIMES = 3e-6  # standard deviation of the model's openings and closings [s]: an estimate [E]
# Largest consistency of a shot that updates the states; 1,000 sound shots reached 1.5 (studies/observer_trial.py).
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
        """Belief with increased variances (states,)."""
        return self._replace(covariance=self.covariance + np.diag(variances))


def innovation(
    belief: Belief, states: tuple[DriftState, ...], residual: Floats, slopes: Floats, covariance: Floats
) -> Floats:
    """Whitened innovation (rows,) of a shot: each row given the rows before it, with mean square 1.

    `residual` (rows,): measured minus expected; `slopes` (rows, states); `covariance` (rows, rows) of the measurements.
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
        Measured minus simulated pressure at the new states [Pa].
    rate, rate_deviation : (times,)
        Injection rate, as in `Response`, and its standard deviation [m³/s].
    at, shot_states : (states,)
        Linearisation point and posterior mean, both with the per-shot offsets.
    response : Response
        Simulated at `at`.
    information : (states, states)
    score : (states,)
        Log-likelihood of this shot alone at states x: score·x - x·information·x / 2, without a constant.
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
    """Update a belief with a shot; None if it cannot be simulated.

    A shot that is not trusted, for example if another injector injects at once, changes no state; its figures follow
    from the states before it.

    Per-shot offsets (`DriftState.scatter`) are estimated with the states and then forgotten: they move the
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
        Largest consistency of a shot that updates the states.

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
    assert response is not None  # there is at least one iteration
    # likelihood of the states before the shot, without its per-shot offsets
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
    """States (n,) of a shot with its per-shot offsets."""
    shot_states = z[:n].copy()
    shot_states[extra] += z[n:]
    return shot_states


def _append_scatter_slopes(slopes: Floats, extra: list[int]) -> Floats:
    """Slopes (..., states) with those of the per-shot offsets appended."""
    return np.concatenate([slopes, slopes[..., extra]], axis=-1)


class Alarm(NamedTuple):
    """Drift of one state: name, shots since it began (0: this one), size and standard deviation of the step."""

    state: str
    ago: int
    size: float
    deviation: float


class StepTest:
    """Generalised likelihood ratio of a step of one state at one of the last shots.

    Method of Willsky and Jones (1976), IEEE Trans. Automatic Control 21, 108: the filter is known, and so is the effect
    of a unit step on its innovations; their likelihood gives the size of a step. By Woodbury's identity
    innovations and slopes enter only through the covariance before and after a shot.

    Parameters
    ----------
    states : tuple of DriftState
    window : int
        Number of past shots to search.
    significance : float
        Standard deviations of a step needed for an alarm, in addition to `DriftState.limit`.
    """

    def __init__(self, states: tuple[DriftState, ...], window: int, significance: float) -> None:
        self.states = states
        self.window, self.significance = window, significance
        self._limits = np.array([state.limit or np.inf for state in states])
        self.reset()

    def reset(self) -> None:
        """Forget all shots."""
        self._left: list[Floats] = []  # error of the mean after a unit step of each state (columns), by onset
        self._sums: list[tuple[Floats, Floats]] = []  # score and information (states,)

    def add(self, before: Belief, after: Belief) -> None:
        """Add the belief before (`Belief.walk`) and after a shot."""
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
        """Most significant step; None if none exceeds significance and limit."""
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
