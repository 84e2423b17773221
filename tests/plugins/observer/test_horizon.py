"""Moving horizon: against Gaussian conditioning on all shots at once, and against SciPy's least squares."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.optimize import least_squares

from commonrail.base.arrays import Floats
from commonrail.plugins.observer.horizon import Horizon, Measured
from commonrail.plugins.observer.kalman import TIMES, Belief, update
from commonrail.plugins.observer.response import Response
from commonrail.plugins.observer.study import DriftState

STATES = (DriftState("a", "", 0.0, 1.0, 0.1, 0.3, 0.5), DriftState("b", "", 0.0, 2.0, 0.0, 0.0, 0.0))
WALK, SCATTER = np.array([0.1, 0.0]), np.array([0.3, 0.0])
SHOTS, SAMPLES = 4, 5
RNG = np.random.default_rng(3)
SLOPES = 0.4 * RNG.standard_normal((SHOTS, SAMPLES, 2))
FIGURES = RNG.standard_normal((3, 1, 2))
LACKING = np.array([0.0, TIMES**2, TIMES**2])
NOISE = 0.2**2 * np.eye(SAMPLES) + 0.02
MEASURED = SLOPES @ [0.8, -1.5] + RNG.multivariate_normal(np.zeros(SAMPLES), NOISE, SHOTS)


def response(k: int, curved: float, x: Floats) -> Response:
    """Shot `k` of a model whose pressure is linear in the states but for `curved` of it."""
    linear = SLOPES[k] @ x
    slopes = (1.0 + 2.0 * curved * linear)[:, None] * SLOPES[k]
    return Response(linear + curved * linear**2, slopes, FIGURES @ x, FIGURES, np.zeros(1), np.zeros((1, 2)))


def solved(length: int, curved: float, change: Floats | None = None, measured: Floats = MEASURED) -> Horizon:
    """Horizon after all shots; `change`: variances before the last but one."""
    horizon, belief = Horizon(STATES, length, 40), Belief.before(STATES)
    for k in range(SHOTS):
        before = belief.walk(STATES)
        made = Measured(measured[k], lambda _: NOISE, partial(response, k, curved))
        done = update(before, STATES, *made, 40)
        assert done is not None
        horizon.add(k, made, done, before)
        belief = horizon.solve()
    if change is not None:
        horizon.change(1, change)
        belief = horizon.solve()
    assert belief.mean == pytest.approx(horizon.updates()[-1][1].belief.mean)
    return horizon


def prior(change: Floats) -> tuple[Floats, Floats]:
    """Covariance of the states of all shots, stacked, and of what each has for itself besides."""
    steps = [np.diag(np.array([1.0, 4.0]) + WALK**2)] + [np.diag(WALK**2)] * (SHOTS - 1)
    steps[SHOTS - 2] = steps[SHOTS - 2] + np.diag(change)
    total = np.cumsum(steps, axis=0)
    states: Floats = np.block([[total[min(i, j)] for j in range(SHOTS)] for i in range(SHOTS)])
    return states, np.diag(np.tile(SCATTER**2, SHOTS))


@pytest.mark.parametrize("change", [np.zeros(2), np.array([0.5, 0.0])], ids=["walk", "with a change"])
def test_all_shots_are_the_conditional_expectation_of_a_linear_model(change: Floats) -> None:
    states, own = prior(change)
    slopes = np.zeros((SHOTS * SAMPLES, 2 * SHOTS))
    for k in range(SHOTS):
        slopes[SAMPLES * k : SAMPLES * (k + 1), 2 * k : 2 * k + 2] = SLOPES[k]
    inverse = np.linalg.inv(slopes @ (states + own) @ slopes.T + np.kron(np.eye(SHOTS), NOISE))
    means = (states @ slopes.T @ inverse @ MEASURED.ravel()).reshape(SHOTS, 2)
    spread = states - states @ slopes.T @ inverse @ slopes @ states
    both = states + own
    owns = (both @ slopes.T @ inverse @ MEASURED.ravel()).reshape(SHOTS, 2)
    spreads = both - both @ slopes.T @ inverse @ slopes @ both
    for k, found in solved(SHOTS, 0.0, change).updates():
        here = slice(2 * k, 2 * k + 2)
        assert found.belief.mean == pytest.approx(means[k], rel=1e-9)
        assert found.belief.covariance == pytest.approx(spread[here, here], rel=1e-9)
        assert found.figures[:, 0] == pytest.approx(FIGURES[:, 0] @ owns[k], rel=1e-9)
        expected = np.diag(FIGURES[:, 0] @ spreads[here, here] @ FIGURES[:, 0].T) + LACKING
        assert found.deviations[:, 0] ** 2 == pytest.approx(expected, rel=1e-9)


def test_a_shot_that_no_state_explains_tells_nothing_to_the_others() -> None:
    strange = MEASURED.copy()
    strange[1] += [5.0, -5.0, 5.0, -5.0, 5.0]
    found = dict(solved(SHOTS, 0.0, measured=strange).updates())
    states, own = prior(np.zeros(2))
    kept = [0, 2, 3]
    slopes = np.zeros((3 * SAMPLES, 2 * SHOTS))
    for i, k in enumerate(kept):
        slopes[SAMPLES * i : SAMPLES * (i + 1), 2 * k : 2 * k + 2] = SLOPES[k]
    inverse = np.linalg.inv(slopes @ (states + own) @ slopes.T + np.kron(np.eye(3), NOISE))
    means = (states @ slopes.T @ inverse @ MEASURED[kept].ravel()).reshape(SHOTS, 2)
    spread = states - states @ slopes.T @ inverse @ slopes @ states
    for k in range(SHOTS):
        assert found[k].belief.mean == pytest.approx(means[k], rel=1e-9)
    variances = np.diag(FIGURES[:, 0] @ (spread[2:4, 2:4] + np.diag(SCATTER**2)) @ FIGURES[:, 0].T) + LACKING
    assert found[1].deviations[:, 0] ** 2 == pytest.approx(variances, rel=1e-9)


def test_shots_that_have_left_enter_by_the_belief_before_the_rest() -> None:
    alone = dict(solved(2, 0.0).updates())
    assert sorted(alone) == [SHOTS - 2, SHOTS - 1]
    for k, found in solved(SHOTS, 0.0).updates()[-2:]:  # the model is linear: nothing is lost
        assert alone[k].figures == pytest.approx(found.figures, rel=1e-9)
        assert alone[k].deviations == pytest.approx(found.deviations, rel=1e-9)


def test_a_curved_model_is_solved_by_least_squares_on_all_shots() -> None:
    curved = 0.3
    factor = np.linalg.inv(np.linalg.cholesky(NOISE))

    def residuals(z: Floats) -> Floats:
        x, own = z[: 2 * SHOTS].reshape(SHOTS, 2), z[2 * SHOTS :]  # `b` does not walk, and has no scatter
        first = x[0] / np.sqrt(np.array([1.0, 4.0]) + WALK**2)
        steps = np.concatenate([np.diff(x[:, 0]) / WALK[0], np.diff(x[:, 1]) / 1e-6])
        full = x + np.column_stack([own, np.zeros(SHOTS)])
        left = [factor @ (MEASURED[k] - response(k, curved, full[k]).shown) for k in range(SHOTS)]
        return np.concatenate([first, steps, own / SCATTER[0], *left])

    best = least_squares(residuals, np.zeros(3 * SHOTS), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    states = best.x[: 2 * SHOTS].reshape(SHOTS, 2)
    for k, found in solved(SHOTS, curved).updates():  # shots within half a deviation of their states are not done again
        assert found.belief.mean == pytest.approx(states[k], abs=0.05)
    linear = np.array([found.belief.mean for _, found in solved(SHOTS, 0.0).updates()])
    assert np.max(np.abs(linear - states)) > 0.15  # the curvature matters
