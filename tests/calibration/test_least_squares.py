"""Local polish: known problems, one batch for a Jacobian, failures, constraints."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from commonrail.calibration import Parameter, Space
from commonrail.calibration.optimisers import LeastSquares, LeastSquaresSettings, diverse_members
from commonrail.calibration.optimisers.least_squares import _Batch
from commonrail.errors import ConfigurationError

TIME = np.linspace(0.0, 2.0, 15)
TRUE = np.array([3.0, 1.5])


def decay(x: np.ndarray) -> np.ndarray:
    """Residuals (n, 15) of a exp(-b t) against a = 3, b = 1.5."""
    model = x[:, :1] * np.exp(-x[:, 1:2] * TIME)
    return model - TRUE[0] * np.exp(-TRUE[1] * TIME)


def space(
    upper: tuple[float, float] = (10.0, 10.0),
    constraints: tuple[str, ...] = (),
    scale: str = "linear",
) -> Space:
    return Space(
        [
            Parameter(name, 1.0, 0.1, top, "1", mark="E", source="test", scale=scale)  # type: ignore[arg-type]
            for name, top in zip("ab", upper, strict=True)
        ],
        constraints,
    )


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_recovers_a_known_decay_from_each_start(scale: str) -> None:
    for start in ([8.0, 0.5], [1.0, 6.0]):
        end = LeastSquares(space(scale=scale), decay).run(np.array(start))
        # Zero residual: Gauss-Newton converges to the tolerance of 1e-6 on cost and point.
        np.testing.assert_allclose(end.x, TRUE, rtol=1e-4)
        assert end.cost < 1e-8
        assert not end.pulled_back
        assert end.reason


def test_bounds_hold_and_the_bounded_optimum_is_found() -> None:
    bounded = space(upper=(2.5, 10.0))
    end = LeastSquares(bounded, decay).run(np.array([1.0, 5.0]))

    def cost(b: np.ndarray) -> float:
        residual = decay(np.array([[2.5, b[0]]]))[0]
        return float((np.sqrt(1.0 + residual**2) - 1.0).sum())

    expected = minimize(cost, [1.0], method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-14})
    assert end.x[0] == pytest.approx(2.5, rel=1e-6)
    # The polish stops at a relative change of 1e-6 of a flat cost: 1e-3 of the point.
    assert end.x[1] == pytest.approx(expected.x[0], rel=2e-3)
    assert end.cost == pytest.approx(expected.fun, rel=1e-5)


@pytest.mark.parametrize("same_bits", [False, True])
def test_an_infinite_scale_makes_squares_small_outliers_and_all(same_bits: bool) -> None:
    data = np.array([1.0, 1.2, 1.4, 6.0])
    settings = LeastSquaresSettings(residual_scale=np.inf)
    end = LeastSquares(space(), lambda x: x[:, :1] - data, settings, same_bits).run(np.array([5.0, 1.0]))
    assert end.x[0] == pytest.approx(data.mean(), rel=1e-6)  # soft L1 would end near 1.4
    assert end.cost == pytest.approx(0.5 * np.sum((data - data.mean()) ** 2), rel=1e-9)


def test_a_jacobian_is_one_batch_of_as_many_candidates_as_parameters() -> None:
    sizes: list[int] = []

    def residuals(x: np.ndarray) -> np.ndarray:
        sizes.append(len(x))
        return decay(x)

    LeastSquares(space(), residuals).run(np.array([8.0, 0.5]))
    assert set(sizes[:-1]) == {1, 2}
    assert sizes[:3] == [1, 2, 1]  # value, Jacobian, value: no point is simulated twice


def test_jacobian_matches_the_analytic_one_and_turns_back_at_the_upper_bound() -> None:
    problem = space()
    seen: list[np.ndarray] = []

    def residuals(x: np.ndarray) -> np.ndarray:
        seen.append(x)
        return decay(x)

    batch = _Batch(problem, residuals, LeastSquaresSettings())
    point = np.array([10.0, 2.0])
    jacobian = batch.jacobian(problem.to_unit(point))
    curve = np.exp(-point[1] * TIME)
    analytic = np.stack([curve, -point[0] * TIME * curve], axis=1) * (problem.upper - problem.lower)
    # A one-sided difference over 1e-4 of the range errs by half the step times the curvature.
    np.testing.assert_allclose(jacobian, analytic, atol=2e-2)
    assert all(problem.satisfies(x).all() for x in seen)


def test_outliers_weigh_linearly() -> None:
    def spoiled(x: np.ndarray) -> np.ndarray:
        residual = decay(x) / 0.01
        residual[:, 4] += 300.0
        return residual

    end = LeastSquares(space(), spoiled).run(np.array([4.0, 1.0]))
    # One point 300 standard deviations off among 15: plain least squares would move a by 20 %.
    np.testing.assert_allclose(end.x, TRUE, rtol=0.02)


def failing_above_5(failures: list[np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """The decay, which cannot be computed where a is above 5; the candidates that failed are added to a list."""

    def failing(x: np.ndarray) -> np.ndarray:
        values = decay(x)
        values[x[:, 0] > 5.0] = np.nan
        failures.extend(x[x[:, 0] > 5.0])
        return values

    return failing


def test_failed_candidates_are_avoided() -> None:
    failures: list[np.ndarray] = []
    # From here forward differences in a fail, backward ones do not.
    end = LeastSquares(space(), failing_above_5(failures)).run(np.array([4.9995, 4.0]))
    np.testing.assert_allclose(end.x, TRUE, rtol=1e-3)
    assert failures


def test_a_difference_never_leaves_the_bounds_even_to_avoid_a_failure() -> None:
    problem = space()
    seen: list[np.ndarray] = []

    def failing(x: np.ndarray) -> np.ndarray:
        seen.append(x)
        return np.where(x[:, :1] < 10.0, np.nan, decay(x))

    jacobian = _Batch(problem, failing, LeastSquaresSettings()).jacobian(np.array([1.0, 0.5]))
    assert all(problem.satisfies(x).all() for x in seen)
    assert (jacobian[:, 0] == 0.0).all()
    assert (jacobian[1:, 1] != 0.0).all()


def test_steps_into_failures_are_taken_back() -> None:
    failures: list[np.ndarray] = []
    # The first full step from here leads to a = 7.
    end = LeastSquares(space(), failing_above_5(failures)).run(np.array([0.5, 6.0]))
    assert failures
    np.testing.assert_allclose(end.x, TRUE, rtol=1e-3)


def test_if_everything_fails_the_start_comes_back_at_infinite_cost() -> None:
    end = LeastSquares(space(), lambda x: np.full((len(x), 3), np.nan)).run(np.array([4.0, 4.0]))
    assert end.cost == np.inf
    np.testing.assert_array_equal(end.x, [4.0, 4.0])


def test_the_end_satisfies_constraints_and_comes_near_the_constrained_optimum() -> None:
    ordered = space(constraints=("a < b",))
    ends = [LeastSquares(ordered, decay).run(np.array(start)) for start in ([1.0, 3.0], [0.5, 8.0])]

    def cost(a: np.ndarray) -> float:
        residual = decay(np.array([[a[0], a[0]]]))[0]
        return float((np.sqrt(1.0 + residual**2) - 1.0).sum())

    on_the_edge = minimize(cost, [2.0], method="Nelder-Mead").fun
    for end in ends:
        assert end.x[0] < end.x[1]
        # The unconstrained optimum (3, 1.5) is forbidden; the edge a = b is reached by pulling a
        # slightly forbidden end back along the way from its start, not square to the edge: 0.2 %.
        assert end.cost == pytest.approx(on_the_edge, rel=5e-3)


def test_a_start_better_than_the_pulled_back_end_comes_back() -> None:
    """Simulations fail along the edge a = b, where the forbidden optimum is pulled back to."""

    def failing(x: np.ndarray) -> np.ndarray:
        values = decay(x)
        values[np.abs(x[:, 0] - x[:, 1]) < 0.2] = np.nan
        return values

    settings = LeastSquaresSettings(constraint_weight=1e-9)  # let it end beyond the edge
    start = np.array([2.0, 3.0])
    end = LeastSquares(space(constraints=("a < b",)), failing, settings).run(start)
    assert end.pulled_back
    np.testing.assert_array_equal(end.x, start)
    assert end.cost == pytest.approx((np.sqrt(1.0 + decay(start[None, :]) ** 2) - 1.0).sum())


def test_infeasible_starts_and_malformed_residuals_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="start: it breaks"):
        LeastSquares(space(), decay).run(np.array([1.0, 11.0]))
    with pytest.raises(ConfigurationError, match="one row for each"):
        LeastSquares(space(), lambda x: decay(x)[0]).run(np.array([1.0, 1.0]))


@pytest.mark.parametrize("changes", [{"step": 0.0}, {"step": 0.6}, {"iterations": 0}, {"residual_scale": float("nan")}])
def test_settings_out_of_range_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match=rf"^{next(iter(changes))} = "):
        LeastSquaresSettings(**changes)


def test_diverse_members_are_cheap_and_far_apart() -> None:
    unit = np.array([[0.5, 0.5], [0.51, 0.5], [0.9, 0.9], [0.1, 0.5], [0.0, 0.0], [1.0, 0.0]])
    costs = np.array([1.0, 1.1, 3.0, 2.0, 90.0, np.nan])
    # Cheaper half of the five that succeeded: rows 0, 1, 3. Farthest from row 0 is row 3.
    assert diverse_members(unit, costs, 2).tolist() == [0, 3]
    assert diverse_members(unit, costs, 4).tolist() == [0, 2, 3, 1]
    assert diverse_members(unit, costs, 9).tolist()[0] == 0
    assert sorted(diverse_members(unit, costs, 9).tolist()) == [0, 1, 2, 3, 4]


def test_diverse_members_leave_out_repeats_and_failures() -> None:
    unit = np.array([[0.2], [0.2], [0.2], [0.8]])
    assert diverse_members(unit, [1.0, 1.0, 1.0, np.inf], 3).tolist() == [0]
    assert diverse_members(unit, np.full(4, np.nan), 2).tolist() == []
