"""Damped least squares: known minima, batches, failures, bounds, constraints, fixed parameters, losses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear, minimize

from commonrail.calibration.optimisers.base import diverse_members
from commonrail.calibration.optimisers.least_squares import (
    DescentLoss,
    Descents,
    FeasibleSet,
    LossSum,
    Rules,
    advance,
    answered,
    constrained_step,
    differences,
)
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space

Floats = np.ndarray
TIME = np.linspace(0.0, 2.0, 15)
TRUE = np.array([3.0, 1.5])
RULES, SQUARES = Rules(1e-6, 1e-14), LossSum()


def decay(x: Floats) -> Floats:
    """Residuals (n, 15) of a exp(-b t) against a = 3, b = 1.5."""
    model = x[:, :1] * np.exp(-x[:, 1:2] * TIME)
    return model - TRUE[0] * np.exp(-TRUE[1] * TIME)


def space(upper: tuple[float, float] = (10.0, 10.0), constraints: tuple[str, ...] = (), scale: str = "linear") -> Space:
    return Space(
        [
            Parameter(name, 1.0, 0.1, top, "1", mark="E", source="test", scale=scale)  # type: ignore[arg-type]
            for name, top in zip("ab", upper, strict=True)
        ],
        constraints,
    )


def descend(
    problem: Space,
    residuals: Callable[[Floats], Floats],
    starts: list[list[float]],
    losses: LossSum = SQUARES,
    rules: Rules = RULES,
    most: int = 100,
) -> tuple[Floats, Floats]:
    """Ends (k, d) of descents from starts, SI, and their costs (k,)."""
    x = np.array(starts)
    descents = Descents.begin(problem.to_unit(x), residuals(x))
    for _ in range(most):
        descents = answered(advance(problem, descents, losses, rules), residuals)
    return problem.from_unit(descents.unit), losses.costs(descents.residuals)


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("bent", [False, True])
def test_recovers_a_known_decay_from_each_start(scale: str, bent: bool) -> None:
    ends, costs = descend(space(scale=scale), decay, [[8.0, 0.5], [1.0, 6.0]], rules=RULES._replace(bent=bent))
    np.testing.assert_allclose(ends, [TRUE, TRUE], rtol=1e-5)  # the cost is flat around its minimum
    assert (costs < 1e-11).all()


def outlying(x: Floats) -> Floats:
    """The decay with noise and one outlier, where losses other than squares are linear."""
    noise = 0.05 * np.random.default_rng(5).standard_normal(len(TIME))
    noise[4] = 4.0
    return decay(x) - noise


@pytest.mark.parametrize(("loss", "name"), [(DescentLoss.SQUARES, "linear"), (DescentLoss.SOFT, "soft_l1")])
def test_it_ends_where_scipy_does(loss: DescentLoss, name: str) -> None:
    other = least_squares(lambda x: outlying(x[None, :])[0], TRUE, loss=name, xtol=1e-14, ftol=1e-14, gtol=1e-12)
    ends, costs = descend(space(), outlying, [[8.0, 0.5], [1.0, 6.0]], LossSum(loss))
    assert costs == pytest.approx(2.0 * other.cost, rel=1e-9)
    np.testing.assert_allclose(ends, [other.x] * 2, rtol=1e-4)


def test_bounds_hold_and_the_bounded_minimum_is_found() -> None:
    ends, costs = descend(space(upper=(2.5, 10.0)), decay, [[1.0, 5.0]])
    best = minimize(lambda b: np.sum(decay(np.array([[2.5, b[0]]])) ** 2), [1.0], method="Nelder-Mead", tol=1e-12)
    assert ends[0] == pytest.approx([2.5, best.x[0]], rel=1e-4)
    assert costs[0] == pytest.approx(best.fun, rel=1e-9)


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_a_minimum_on_an_ordering_is_found_there(scale: str) -> None:
    ordered = space(constraints=("a < b",), scale=scale)
    ends, costs = descend(ordered, decay, [[1.0, 3.0], [0.5, 8.0]])
    edge = minimize(lambda a: np.sum(decay(np.array([[a[0], a[0]]])) ** 2), [2.0], method="Nelder-Mead", tol=1e-12)
    assert ordered.satisfies(ends).all()
    assert costs == pytest.approx(edge.fun, rel=1e-6)  # a strict constraint keeps a margin


def test_a_fixed_parameter_stays_and_the_others_take_their_minimum() -> None:
    free = np.array([[False, True], [True, True]])
    ends, costs = descend(space(), decay, [[4.0, 4.0], [4.0, 4.0]], rules=RULES._replace(free=free))
    best = minimize(lambda b: np.sum(decay(np.array([[4.0, b[0]]])) ** 2), [1.0], method="Nelder-Mead", tol=1e-12)
    assert ends[0, 0] == 4.0
    assert costs[0] == pytest.approx(best.fun, rel=1e-9)
    np.testing.assert_allclose(ends[1], TRUE, rtol=1e-5)


def test_descents_side_by_side_go_the_way_that_each_goes_alone() -> None:
    starts = [[8.0, 0.5], [1.0, 6.0], [9.0, 9.0]]
    ends, _ = descend(space(), outlying, starts, most=4)
    alone = [descend(space(), outlying, [start], most=4)[0][0] for start in starts]
    np.testing.assert_array_equal(ends, alone)


def test_all_candidates_of_a_question_are_one_batch() -> None:
    sizes: list[int] = []

    def counted(x: Floats) -> Floats:
        sizes.append(len(x))
        return decay(x)

    descend(space(), counted, [[8.0, 0.5], [1.0, 6.0]], rules=RULES._replace(factors=(0.1, 1.0, 10.0)), most=1)
    assert sizes == [2, 2 * 2, 2 * 3, 2 * 3]  # starts, differences, probes of the bend, steps


def test_slopes_of_a_point_that_stays_are_not_asked_for_again() -> None:
    problem, sizes = space(), []

    def cliff(x: Floats) -> Floats:
        sizes.append(len(x))
        return np.where((np.abs(x - 5.0) < 1e-3).all(axis=1, keepdims=True), x - 4.0, np.inf)

    descend(problem, cliff, [[5.0, 5.0]], rules=Rules(1e-5, 0.0, bent=False), most=2)
    assert sizes == [1, 2, 2, 2]  # start, differences, steps off the cliff, shorter steps


def failing_above_5(x: Floats) -> Floats:
    """The decay, which cannot be computed where a is above 5."""
    return np.where(x[:, :1] > 5.0, np.nan, decay(x))


def test_steps_and_differences_into_failures_are_taken_back() -> None:
    # from the first start forward differences in a fail, from the second the first full step leads to a = 7
    ends, _ = descend(space(), failing_above_5, [[4.9995, 4.0], [0.5, 6.0]], rules=Rules(1e-3, 1e-14))
    np.testing.assert_allclose(ends, [TRUE, TRUE], rtol=1e-3)


def test_a_start_that_fails_stays_where_it_is() -> None:
    ends, costs = descend(space(), failing_above_5, [[6.0, 4.0], [4.0, 4.0]])
    assert costs[0] == np.inf
    np.testing.assert_allclose(ends, [[6.0, 4.0], TRUE], rtol=1e-4)


def test_differences_match_the_analytic_slopes_and_keep_to_the_bounds() -> None:
    problem, seen = space(), []
    points = np.array([[10.0, 2.0], [0.1, 10.0], [4.0, 0.1]])

    def residuals(x: Floats) -> Floats:
        seen.append(x)
        return decay(x)

    unit, width = problem.to_unit(points), np.full(3, 1e-4)
    slopes = answered(differences(problem, unit, decay(points), width), residuals)
    curve = np.exp(-points[:, 1:] * TIME)
    analytic = np.stack([curve, -points[:, :1] * TIME * curve], axis=1) * (problem.upper - problem.lower)[:, None]
    np.testing.assert_allclose(slopes, analytic, rtol=2e-3, atol=2e-2)  # half the step times the curvature
    assert problem.satisfies(np.vstack(seen)).all()


def test_a_difference_never_leaves_the_bounds_even_to_avoid_a_failure() -> None:
    problem, seen = space(), []

    def failing(x: Floats) -> Floats:
        seen.append(x)
        return np.where(x[:, :1] < 10.0, np.nan, decay(x))

    unit = np.array([[1.0, 0.5]])
    slopes = answered(differences(problem, unit, decay(problem.from_unit(unit)), np.array([1e-4])), failing)
    assert problem.satisfies(np.vstack(seen)).all()
    assert (slopes[0, 0] == 0.0).all()
    assert (slopes[0, 1, 1:] != 0.0).all()


def test_a_flat_problem_ends_at_once() -> None:
    descents = Descents.begin(np.array([[0.2, 0.8]]), np.ones((1, 3)))
    after = answered(advance(space(), descents, SQUARES, RULES), lambda x: np.ones((len(x), 3)))
    assert not after.running.any()
    np.testing.assert_array_equal(after.unit, descents.unit)


def test_limited_steps_are_the_minima_that_a_bounded_solver_finds() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        jacobian, residuals, start = rng.normal(size=(12, 4)), 3.0 * rng.normal(size=12), rng.random(4)
        best = lsq_linear(jacobian, jacobian @ start - residuals, (0.0, 1.0), tol=1e-13).x
        free = -np.linalg.lstsq(jacobian, residuals, rcond=None)[0]
        rows, least = np.vstack([np.eye(4), -np.eye(4)]), np.concatenate([-start, start - 1.0])
        assert start + constrained_step(jacobian.T @ jacobian, free, rows, least) == pytest.approx(best, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_a_limited_step_keeps_an_ordering_as_a_general_solver_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    jacobian, residuals = rng.normal(size=(12, 4)), 3.0 * rng.normal(size=12)
    rows, least = np.diff(np.eye(4), axis=0), -0.1 * rng.random(3)

    def cost(z: Floats) -> float:
        return float(np.sum((residuals + jacobian @ z) ** 2))

    free = -np.linalg.lstsq(jacobian, residuals, rcond=None)[0]
    step = constrained_step(jacobian.T @ jacobian, free, rows, least)
    limits = {"type": "ineq", "fun": lambda z: rows @ z - least, "jac": lambda z: rows}
    other = minimize(cost, np.zeros(4), method="SLSQP", constraints=limits, options={"ftol": 1e-14, "maxiter": 500})
    assert (rows @ step >= least - 1e-9).all()
    assert cost(step) <= cost(other.x) + 1e-6  # SLSQP's own tolerance


def test_limits_of_a_curved_constraint_are_those_along_it() -> None:
    ordered = space(constraints=("a < b",), scale="log")
    feasible = FeasibleSet.of(ordered)
    assert feasible.constraints == 0  # a - b is not linear in logarithms
    x = np.array([2.0, 2.5])
    rows, least = feasible.limits(ordered.to_unit(x))
    shares = x * np.log(ordered.upper / ordered.lower)  # of a and b per unit
    np.testing.assert_allclose(rows[0], [-shares[0], shares[1]] / np.hypot(*shares))
    assert least[0] == pytest.approx(-0.5 / np.hypot(*shares), rel=1e-6)


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
