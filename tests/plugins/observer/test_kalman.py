"""Filter from shot to shot: against Gaussian conditioning in closed form, on linear models."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.plugins.observer.kalman import Belief, Update, update
from commonrail.plugins.observer.response import Response
from commonrail.plugins.observer.study import DriftState

STATES = (
    DriftState("a", "", 0.0, 1.0, 0.1, 0.3, 0.5),
    DriftState("b", "", 0.0, 2.0, 0.0, 0.0, 0.0),
    DriftState("c", "", 0.0, 0.5, 0.2, 0.0, 0.0),
)
RNG = np.random.default_rng(1)
SLOPES = RNG.standard_normal((12, 3))
FIGURES = RNG.standard_normal((3, 1, 3))
NOISE = 0.2 * np.eye(12) + 0.1


def linear(x: Floats) -> Response:
    """Response of a linear model."""
    return Response(SLOPES @ x, SLOPES, FIGURES @ x, FIGURES)


def updated(belief: Belief, measured: Floats) -> Update:
    """Update by the linear model; one iteration is enough."""
    found = update(belief, STATES, measured, lambda _: NOISE, linear, 3)
    assert found is not None
    return found


def test_states_and_figures_are_the_conditional_expectation_of_a_linear_model() -> None:
    measured = RNG.standard_normal(12)
    found = updated(Belief.before(STATES), measured)
    # joint covariance of the states, and of what the shot really has: state plus its own scatter
    own = np.diag([0.3**2, 0.0, 0.0])
    prior = np.diag([1.0, 4.0, 0.25])
    s = np.linalg.inv(SLOPES @ (prior + own) @ SLOPES.T + NOISE)
    gain = prior @ SLOPES.T @ s
    assert found.belief.mean == pytest.approx(gain @ measured, rel=1e-9)
    assert found.belief.covariance == pytest.approx(prior - gain @ SLOPES @ prior, rel=1e-9, abs=1e-12)
    both = (prior + own) @ SLOPES.T @ s
    spread = (prior + own) - both @ SLOPES @ (prior + own)
    assert found.figures[:, 0] == pytest.approx(FIGURES[:, 0] @ both @ measured, rel=1e-9)
    assert found.deviations[:, 0] ** 2 == pytest.approx(np.diag(FIGURES[:, 0] @ spread @ FIGURES[:, 0].T), rel=1e-9)
    assert found.consistency == pytest.approx(measured @ s @ measured / 12, rel=1e-9)


def test_the_change_since_the_reference_has_the_spread_of_the_steps_between() -> None:
    """Without walks an optimal estimate changes by steps that are independent: their variances add up."""
    still = tuple(state._replace(walk=0.0) for state in STATES)
    belief = updated(Belief.before(still), RNG.standard_normal(12)).belief.with_reference()
    before = belief.covariance
    for _ in range(3):
        belief = updated(belief.walked(still), RNG.standard_normal(12)).belief
    change, spread = belief.change()
    assert belief.reference is not None
    assert change == pytest.approx(belief.mean - belief.reference)
    assert spread**2 == pytest.approx(np.diag(before - belief.covariance), rel=1e-8)


def test_a_walk_widens_the_change() -> None:
    belief = updated(Belief.before(STATES), RNG.standard_normal(12)).belief.with_reference().walked(STATES)
    assert belief.change()[1] == pytest.approx([0.1, 0.0, 0.2], abs=1e-9)


def test_a_bent_model_is_linearised_until_it_agrees() -> None:
    states = STATES[1:2]

    def cubic(x: Floats) -> Response:
        return Response(
            np.repeat(x + x**3, 2), np.full((2, 1), 1.0 + 3.0 * x[0] ** 2), np.zeros((3, 1)), np.ones((3, 1, 1))
        )

    found = update(Belief.before(states), states, np.full(2, 10.0), lambda _: 1e-6 * np.eye(2), cubic, 20)
    assert found is not None
    assert found.belief.mean == pytest.approx([2.0], abs=1e-3)  # 2 + 2³ = 10
