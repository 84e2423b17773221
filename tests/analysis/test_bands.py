"""Bands of predictions where the linear approximation is exact: a model that is linear in its parameters."""

from __future__ import annotations

from statistics import NormalDist
from typing import Any

import numpy as np
import pytest

from commonrail.analysis.bands import LEVEL, Optimum, bands_of, half_widths
from commonrail.analysis.identifiability import identify_at
from commonrail.analysis.influence import influence_of
from commonrail.analysis.neighbourhood import around
from commonrail.calibration.goal import Goal, Loss
from commonrail.calibration.objective import Objective
from commonrail.calibration.space import Parameter, Space
from commonrail.engine.operating_point import OperatingPoint
from commonrail.injector.definition import Injector
from commonrail.kinds import QuantityData, Role
from commonrail.kinds.simulator import Simulator

# Differences of a linear model of numbers of order 1e-8 about steps of 0.5 % lose three of sixteen digits.
EXACT = 1e-9
MM3 = 1e-9
SPACE = Space([Parameter(name, 0.0, -4.0, 6.0, "1", mark="E", source="made up") for name in ("a", "b", "c")])
PRIOR_SIGMA = np.array([0.5, 1.0, 2.0])


class Linear(QuantityData):
    """A map whose simulated quantities are (20 + A x) mm³ of parameters x, and whose A is noted on it."""

    matrix: np.ndarray

    def simulated(self, simulator: Any, values: Any) -> Any:
        return MM3 * (20.0 + np.asarray(values) @ self.matrix.T)


def linear(matrix: np.ndarray, measured: np.ndarray, role: Role, relative: float = 0.015) -> Linear:
    count = len(matrix)
    points = tuple(OperatingPoint(80e6, 3e-4 + 1e-5 * i, 0.5e6, 0.1e6, horizon=4e-3) for i in range(count))
    none = np.zeros(count, bool)
    data = Linear(role.value, role, points, MM3 * measured, 0.05 * MM3, relative, none, 1.0, "", "all")
    object.__setattr__(data, "matrix", matrix)
    return data


def bands(fitted: Linear, seen: Linear, best: np.ndarray) -> tuple[dict[str, dict[str, Any]], Any]:
    """Bands of both sets at a point, with the priors of standard deviations `PRIOR_SIGMA`."""
    place = around(SPACE, best)
    simulator: Simulator = None  # type: ignore[assignment]  # a linear map asks for none
    residuals = fitted.residuals(fitted.simulated(simulator, place.values))
    priors = place.slopes(place.values / PRIOR_SIGMA)
    influence = influence_of(residuals[0], place.slopes(residuals), priors)
    return bands_of((fitted, seen), simulator, [Optimum(place, influence)]), influence


def problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(12, 3)), rng.normal(size=(5, 3)), rng


@pytest.mark.parametrize("noise", [0.1, 5.0])
def test_the_band_is_that_of_the_posterior(noise: float) -> None:
    a, b, rng = problem(1)
    best = np.array([1.0, -0.5, 2.0])
    fitted = linear(a, 20.0 + a @ best + noise * rng.normal(size=12), Role.FIT, relative=0.0)
    seen = linear(b, 20.0 + b @ best, Role.VALIDATION)
    found, _ = bands(fitted, seen, best)

    # by hand in SI: weights of the tolerance 0.05 mm³, precision of the priors, effective parameters, scatter
    precision = a.T @ a / 0.05**2 + np.diag(PRIOR_SIGMA**-2)
    covariance = np.linalg.inv(precision)
    effective = np.trace(a.T @ a / 0.05**2 @ covariance)
    residuals = (20.0 + a @ best - fitted.quantity / MM3) / 0.05
    s2 = np.sum(residuals**2) / (12 - effective)
    predicted = 20.0 + b @ best
    variance = max(s2, 1.0) * np.einsum("ij,jk,ik->i", b, covariance, b) + (0.05 + 0.015 * predicted) ** 2
    expected = MM3 * NormalDist().inv_cdf(0.95) * np.sqrt(variance)
    np.testing.assert_allclose(found["validation"]["half_widths"], expected, rtol=EXACT)


def standard_errors(data: Linear, injector: Injector, best: np.ndarray, loss: Loss) -> np.ndarray:
    objective = Objective(injector, SPACE.names, [data], 1e-6, 1, goal=Goal(loss, scale=2.0))
    found = identify_at(SPACE, objective, best)
    return np.array([found[name]["standard_error"] for name in SPACE.names])


def test_standard_errors_under_soft_l1_are_those_of_its_weights(regulated: Injector) -> None:
    a, _, rng = problem(3)
    best, noise = np.array([1.0, -0.5, 2.0]), 0.05 * rng.normal(size=12)
    clean = linear(a, 20.0 + a @ best + noise, Role.FIT, relative=0.0)
    noise[4] += 10.0  # two hundred tolerances
    spoilt = linear(a, 20.0 + a @ best + noise, Role.FIT, relative=0.0)
    found = standard_errors(spoilt, regulated, best, Loss.SOFT_L1)

    # by hand: weights of iteratively reweighted least squares, w = 1/sqrt(1 + (r/s)²)
    residuals = -noise / 0.05
    w = 1.0 / np.sqrt(1.0 + (residuals / 2.0) ** 2)
    covariance = np.linalg.inv((a * w[:, None]).T @ a / 0.05**2)
    expected = np.sqrt(np.sum(w * residuals**2) / (12 - 3) * np.diag(covariance))
    np.testing.assert_allclose(found, expected, rtol=EXACT)
    # squares let the outlier widen them forty times, the weights eight times at most
    squares = standard_errors(spoilt, regulated, best, Loss.SQUARES) / standard_errors(
        clean, regulated, best, Loss.SQUARES
    )
    robust = found / standard_errors(clean, regulated, best, Loss.SOFT_L1)
    assert squares.min() > 40.0
    assert robust.max() < 10.0


def test_the_band_holds_its_share_of_new_values() -> None:
    held = total = 0
    for seed in range(400):
        a, b, rng = problem(seed)
        truth = PRIOR_SIGMA * rng.normal(size=3)
        measured = 20.0 + a @ truth + 0.05 * rng.normal(size=12)
        precision = a.T @ a / 0.05**2 + np.diag(PRIOR_SIGMA**-2)
        best = np.linalg.solve(precision, a.T @ (measured - 20.0) / 0.05**2)
        exact = 20.0 + b @ truth
        seen = linear(b, exact + (0.05 + 0.015 * exact) * rng.normal(size=5), Role.VALIDATION)
        found, _ = bands(linear(a, measured, Role.FIT, relative=0.0), seen, np.clip(best, -4.0, 6.0))
        held, total = held + found["validation"]["covered"], total + found["validation"]["values"]
    # 2000 values with five to a fit: three binomial standard errors of 0.67 %
    assert held / total == pytest.approx(LEVEL, abs=0.02)


def test_what_neither_data_nor_priors_hold_has_no_band() -> None:
    influence = influence_of(np.zeros(2), np.array([[1.0, 0.0], [2.0, 0.0]]), np.empty((0, 2)))
    found = influence.predicted(np.array([[1.0, 0.0], [1.0, 1e-3], [np.nan, 0.0]]))
    assert found[0] == pytest.approx(5**-0.5, rel=1e-12)
    assert np.isposinf(found[1])
    assert np.isnan(found[2])


def test_no_bands_where_a_kind_states_no_discrepancy() -> None:
    a, b, _ = problem(1)
    fitted, seen = linear(a, 20.0 + a.sum(axis=1), Role.FIT), linear(b, 20.0 + b.sum(axis=1), Role.VALIDATION)
    place = around(SPACE, np.ones(3))
    simulator: Simulator = None  # type: ignore[assignment]
    influence = bands(fitted, seen, np.ones(3))[1]
    object.__setattr__(fitted, "discrepancy", lambda values: None)
    assert bands_of((fitted, seen), simulator, [Optimum(place, influence)]) == {}


def test_the_count_is_of_measured_values_inside() -> None:
    a, b, _ = problem(1)
    best, off = np.ones(3), np.array([0.0, 0.3, -0.4, 3.0, -5.0])
    fitted = linear(a, 20.0 + a @ best, Role.FIT)
    found, _ = bands(fitted, linear(b, 20.0 + b @ best + off, Role.VALIDATION), best)
    record = found["validation"]
    assert (record["covered"], record["values"], record["covered_by_parameters_alone"]) == (3, 5, 1)


def test_a_half_width_of_one_standard_deviation() -> None:
    level = NormalDist().cdf(1.0) - NormalDist().cdf(-1.0)
    assert half_widths(np.array([3.0]), np.array([4.0]), level)[0] == pytest.approx(5.0, rel=1e-12)


def test_the_band_of_several_optima_is_the_union_of_theirs() -> None:
    a, b, _ = problem(1)
    best, other = np.array([1.0, -0.5, 2.0]), np.array([1.2, -0.6, 1.9])
    fitted = linear(a, 20.0 + a @ best, Role.FIT)
    seen = linear(b, 20.0 + b @ other + np.array([0.0, 0.0, 0.0, 3.0, -3.0]), Role.VALIDATION)
    alone = [bands(fitted, seen, x) for x in (best, other)]
    optima = [Optimum(around(SPACE, x), influence) for x, (_, influence) in zip((best, other), alone, strict=True)]
    simulator: Simulator = None  # type: ignore[assignment]
    found = bands_of((fitted, seen), simulator, optima)["validation"]

    middles = [MM3 * (20.0 + b @ x) for x in (best, other)]
    halves = [np.array(record["validation"]["half_widths"]) for record, _ in alone]
    lower = np.min([m - h for m, h in zip(middles, halves, strict=True)], axis=0)
    upper = np.max([m + h for m, h in zip(middles, halves, strict=True)], axis=0)
    np.testing.assert_allclose(found["lower"], lower, rtol=EXACT)
    np.testing.assert_allclose(found["upper"], upper, rtol=EXACT)
    assert np.any(upper - lower > 2.0 * np.maximum(*halves) * (1.0 + EXACT))  # wider than each of the two
    np.testing.assert_allclose(found["half_widths"], np.maximum(upper - middles[0], middles[0] - lower), rtol=EXACT)
    assert found["optima"] == 2
    inside = (seen.quantity >= lower) & (seen.quantity <= upper)
    assert found["covered"] == int(inside.sum()) < len(b)
    assert found["median_half_width_percent"] == pytest.approx(
        np.median(50.0 * (upper - lower) / middles[0]), rel=EXACT
    )
