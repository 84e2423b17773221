"""The least-squares method of studies with `same_bits`, on problems with known minima and against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from commonrail.calibration.optimisers.bounded_least_squares import Limits, soft_l1, within_unit_box

Floats = NDArray[np.float64]
LIMITS = Limits(1.0, 1e-10, 200)
T = np.linspace(0.0, 1.0, 40)
NOISE = 0.01 * np.random.default_rng(5).standard_normal(40)
NOISE[7] = 4.0  # an outlier: the loss is linear there


def curve(x: Floats) -> Floats:
    """A decay and a slope, both non-linear in the parameters' product."""
    return 3.0 * np.exp(-4.0 * x[0] * T) + x[1] * x[0] * T


def residuals(x: Floats) -> Floats:
    return curve(x) - curve(np.array([0.6, 0.3])) - NOISE


def slopes(x: Floats) -> Floats:
    steps = 1e-7 * np.eye(2)
    return np.stack([(residuals(x + step) - residuals(x - step)) / 2e-7 for step in steps], axis=1)


@pytest.mark.parametrize(("scale", "loss"), [(1.0, "soft_l1"), (np.inf, "linear")])
@pytest.mark.parametrize("start", [(0.5, 0.5), (0.05, 0.95), (1.0, 0.0)])
def test_it_ends_where_scipy_does(start: tuple[float, float], scale: float, loss: str) -> None:
    other = least_squares(residuals, (0.5, 0.5), slopes, (0.0, 1.0), loss=loss, xtol=1e-12, ftol=1e-14)
    ended = within_unit_box(residuals, slopes, np.array(start), LIMITS._replace(scale=scale))
    np.testing.assert_allclose(ended.x, other.x, atol=1e-5)  # the cost is flat to 1e-10 around its minimum
    assert soft_l1(residuals(ended.x), scale) == pytest.approx(other.cost, rel=1e-9)


def test_a_minimum_outside_is_met_at_the_bound() -> None:
    """The nearest point of a slanted valley lies on the bound, not where the free minimum is cut off."""
    slanted = np.array([[1.0, 0.9], [0.0, 0.5]])
    wanted = slanted @ [1.5, 0.2]
    quadratic = LIMITS._replace(scale=1e3)  # to 1e-7
    ended = within_unit_box(lambda x: slanted @ x - wanted, lambda _: slanted, np.full(2, 0.5), quadratic)
    # with x0 = 1 the residuals are 0.9 (x1 − 0.2) − 0.5 and 0.5 (x1 − 0.2)
    np.testing.assert_allclose(ended.x, [1.0, 0.2 + 0.45 / (0.81 + 0.25)], atol=1e-5)


def test_it_keeps_to_its_evaluations_and_never_gets_worse() -> None:
    start, costs = np.array([0.05, 0.95]), []
    for most in (1, 2, 3, 5):
        seen: list[Floats] = []

        def counted(x: Floats, seen: list[Floats] = seen) -> Floats:
            seen.append(x)
            return residuals(x)

        ended = within_unit_box(counted, slopes, start, LIMITS._replace(evaluations=most))
        assert len(seen) <= most
        assert all(((x >= 0.0) & (x <= 1.0)).all() for x in seen)
        costs.append(soft_l1(residuals(ended.x), 1.0))
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0]


def test_a_flat_problem_ends_at_once() -> None:
    ended = within_unit_box(lambda _: np.ones(3), lambda _: np.zeros((3, 2)), np.array([0.2, 0.8]), LIMITS)
    np.testing.assert_array_equal(ended.x, [0.2, 0.8])
