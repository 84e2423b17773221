"""Standard errors of least squares where they are known: a model that is linear in its parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from commonrail.calibration.identifiability import identify_at
from commonrail.calibration.objective import Goal, Loss, Objective
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.data.base import Role
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.operating_point import OperatingPoint
from commonrail.physics.injector import Injector

# Differences of a linear model of numbers of order 1e-8 about steps of 0.5 % lose three of sixteen digits.
EXACT = 1e-9
MM3 = 1e-9
NAMES = (
    "nozzle.discharge_maximum",
    "valve.seat_discharge",
    "rail.throttle_discharge",
)  # read by nothing
SPACE = Space([Parameter(name, 0.0, -4.0, 6.0, "1", mark="E", source="made up") for name in NAMES])


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


def standard_errors(data: Linear, injector: Injector, best: np.ndarray, loss: Loss) -> np.ndarray:
    objective = Objective(injector, SPACE.names, [data], 1e-6, 1, goal=Goal(loss, scale=2.0))
    found = identify_at(SPACE, objective, best)
    return np.array([found[name]["standard_error"] for name in SPACE.names])


def test_standard_errors_under_soft_l1_are_those_of_its_weights(regulated: Injector) -> None:
    rng = np.random.default_rng(3)
    a = rng.normal(size=(12, 3))
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
