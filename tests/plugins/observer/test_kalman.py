"""Filter from shot to shot: against Gaussian conditioning in closed form, on linear models."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.plugins.observer.kalman import TIMES, TRUSTED, Belief, StepTest, Update, update
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
RATES = RNG.standard_normal((5, 3))
NOISE = 0.2 * np.eye(12) + 0.1


def linear(x: Floats) -> Response:
    """Response of a linear model."""
    return Response(SLOPES @ x, SLOPES, FIGURES @ x, FIGURES, RATES @ x, RATES)


def updated(belief: Belief, measured: Floats, trusted: float = np.inf) -> Update:
    """Update by the linear model; one iteration is enough."""
    found = update(belief, STATES, measured, lambda _: NOISE, linear, 3, trusted=trusted)
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
    lacking = np.array([0.0, TIMES**2, TIMES**2])
    expected = np.diag(FIGURES[:, 0] @ spread @ FIGURES[:, 0].T) + lacking
    assert found.deviations[:, 0] ** 2 == pytest.approx(expected, rel=1e-9)
    assert found.rate == pytest.approx(RATES @ both @ measured, rel=1e-9)
    assert found.rate_deviation**2 == pytest.approx(np.diag(RATES @ spread @ RATES.T), rel=1e-9)
    assert found.consistency == pytest.approx(measured @ s @ measured / 12, rel=1e-9)


def test_a_shot_that_no_state_explains_changes_none() -> None:
    strange = np.array([50.0, -50.0] * 6)
    before = Belief.before(STATES)
    found = updated(before, strange, TRUSTED)
    assert found.consistency > TRUSTED
    assert found.belief.mean == pytest.approx(before.mean)
    assert found.belief.covariance == pytest.approx(before.covariance)
    own = np.diag([0.3**2, 0.0, 0.0])
    variance = FIGURES[0, 0] @ (before.covariance + own) @ FIGURES[0, 0]
    assert found.deviations[0, 0] ** 2 == pytest.approx(variance)


def followed(shots: int, step: float, onset: int, rng: np.random.Generator) -> tuple[StepTest, Belief]:
    """Test and belief after shots whose state "a" steps; the first shot is learnt before the test."""
    test, belief = StepTest(STATES, 20, 4.0), Belief.before(STATES)
    truth, root = rng.standard_normal(3) * [1.0, 2.0, 0.5], np.linalg.cholesky(NOISE)
    for k in range(shots):
        own = np.array([0.3, 0.0, 0.0]) * rng.standard_normal(3)
        moved = truth + own + np.array([step if k >= onset else 0.0, 0.0, 0.0])
        before = belief.walk(STATES)
        belief = updated(before, SLOPES @ moved + root @ rng.standard_normal(12)).belief
        if k:
            test.add(before, belief)
    return test, belief


def test_a_step_is_found_with_its_size_and_onset() -> None:
    """200 parts: size unbiased to four standard errors, and as scattered as stated."""
    rng = np.random.default_rng(5)
    found = [followed(9, 3.0, 5, rng)[0].alarm() for _ in range(200)]
    alarms = [alarm for alarm in found if alarm is not None]
    assert len(alarms) > 195
    assert {alarm.state for alarm in alarms} == {"a"}
    sizes = np.array([alarm.size for alarm in alarms if alarm.ago == 3])
    assert len(sizes) > 150
    assert np.mean(sizes) == pytest.approx(3.0, abs=0.15)
    assert np.std(sizes) < 1.3 * alarms[0].deviation  # which leaves out that the filter lets the states walk


def test_parts_that_do_not_change_raise_no_alarm() -> None:
    rng = np.random.default_rng(6)
    assert sum(followed(12, 0.0, 0, rng)[0].alarm() is not None for _ in range(100)) <= 1


def test_a_bent_model_is_linearised_until_it_agrees() -> None:
    states = STATES[1:2]

    def cubic(x: Floats) -> Response:
        slopes = np.full((2, 1), 1.0 + 3.0 * x[0] ** 2)
        return Response(
            np.repeat(x + x**3, 2), slopes, np.zeros((3, 1)), np.ones((3, 1, 1)), np.zeros(1), np.ones((1, 1))
        )

    found = update(
        Belief.before(states), states, np.full(2, 10.0), lambda _: 1e-6 * np.eye(2), cubic, 20, trusted=np.inf
    )
    assert found is not None
    assert found.belief.mean == pytest.approx([2.0], abs=1e-3)  # 2 + 2³ = 10
