"""Moving horizon: least squares on the last shots together; shots whose states have moved are simulated again."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.plugins.observer.kalman import TRUSTED, Belief, Update, update
from commonrail.plugins.observer.response import Response
from commonrail.plugins.observer.study import DriftState

MOVED = 0.5  # change of a state at which its shot is simulated again, in standard deviations before the first shot


class Measured(NamedTuple):
    """Measurements of a shot in the order of `Response.shown`, their covariance, and its simulation."""

    shown: Floats
    covariance: Callable[[Response], Floats]
    simulate: Callable[[Floats], Response | None]


class _Shot:
    """One shot of a horizon: its latest update, and the variances by which states may have changed before it."""

    def __init__(self, number: int, measured: Measured, latest: Update) -> None:
        self.number = number
        self.measured, self.latest = measured, latest
        self.trusted = latest.consistency <= TRUSTED
        self.extra = np.zeros(len(latest.shot_states))

    def update(self, belief: Belief, states: tuple[DriftState, ...]) -> Update:
        """Update a belief with this shot, whose response is linearised."""
        at, response = self.latest.at, self.latest.response
        trusted = np.inf if self.trusted else -1.0
        shown, covariance, _ = self.measured
        done = update(belief, states, shown, covariance, lambda x: response.shift(x - at), 1, trusted=trusted)
        assert done is not None  # no simulation can fail here
        return done._replace(at=at, response=response)


class Horizon:
    """The last shots, estimated together.

    Forward a Kalman filter, backward information of the later shots (Fraser and Potter 1969, IEEE Trans. Automatic
    Control 14, 387); repeated at the new states this is Gauss-Newton on the states of all shots (Bell 1994, SIAM J.
    Optimization 4, 626). Shots before the horizon enter by the belief before its first one.

    Parameters
    ----------
    states : tuple of DriftState
    length : int
        Shots.
    passes : int
        Largest number of passes; between two, shots whose states have moved are simulated again.
    """

    def __init__(self, states: tuple[DriftState, ...], length: int, passes: int) -> None:
        self.states = states
        self.length, self.passes = length, passes
        self._walks = np.array([state.walk**2 for state in states])
        self._spread = np.array([state.deviation for state in states])
        self._shots: list[_Shot] = []
        self._before: list[Belief] = []  # about each shot, from the shots before it

    def add(self, number: int, measured: Measured, latest: Update, before: Belief) -> None:
        """Add the newest shot with its update from a belief `before` it, and drop the oldest."""
        self._shots = [*self._shots, _Shot(number, measured, latest)][-self.length :]
        self._before = [*self._before, before][-self.length :]

    def change(self, ago: int, variances: Floats) -> None:
        """Let states change by variances (states,) before one of the trusted shots, `ago` shots back."""
        trusted = [shot for shot in self._shots if shot.trusted]
        trusted[max(len(trusted) - 1 - ago, 0)].extra += variances

    def solve(self) -> Belief:
        """Estimate all shots; return the belief after the newest."""
        for k in range(self.passes):
            belief = self._pass()
            moved = [
                s for s in self._shots if np.max(np.abs(s.latest.shot_states - s.latest.at) / self._spread) > MOVED
            ]
            if not moved or k + 1 == self.passes:
                break
            for shot in moved:
                response = shot.measured.simulate(shot.latest.shot_states)
                if response is not None:
                    shot.latest = shot.latest._replace(at=shot.latest.shot_states, response=response)
        return belief

    def updates(self) -> list[tuple[int, Update]]:
        """Numbers of the shots and their updates from all of them."""
        return [(shot.number, shot.latest) for shot in self._shots]

    def _pass(self) -> Belief:
        forward, belief = list[Update](), self._before[0]
        for i, shot in enumerate(self._shots):
            self._before[i] = belief
            forward.append(shot.update(belief.spread(shot.extra), self.states))
            belief = forward[-1].belief.spread(self._walks)
        information: Floats = np.zeros((len(self.states),) * 2)  # of the later shots
        score: Floats = np.zeros(len(self.states))
        for shot, before, filtered in zip(
            reversed(self._shots), reversed(self._before), reversed(forward), strict=True
        ):
            combined = _add_information(before.spread(shot.extra), information, score)
            shot.latest = shot.update(combined, self.states) if information.any() else filtered
            information, score = information + filtered.information, score + filtered.score
            through = np.eye(len(score)) + information * (self._walks + shot.extra)
            both = np.asarray(np.linalg.solve(through, np.column_stack([information, score])), float)
            information, score = both[:, :-1], both[:, -1]
        return forward[-1].belief


def _add_information(belief: Belief, information: Floats, score: Floats) -> Belief:
    """Add information (states, states) and score (states,) of other shots to a belief."""
    factor = np.linalg.inv(np.eye(len(score)) + belief.covariance @ information)
    covariance = factor @ belief.covariance
    return Belief(belief.mean + covariance @ (score - information @ belief.mean), 0.5 * (covariance + covariance.T))
