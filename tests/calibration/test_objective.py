"""Misfit of populations: the figures of single batches, however often and in whatever order it is asked for."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.objective import NOT_SIMULATED, Goal, Loss, Objective
from commonrail.calibration.parameter import Condition, Prior, Priors, Wanted
from commonrail.calibration.study import study
from commonrail.data import simulator as module
from commonrail.data.base import Role
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector

NAMES = ("plunger_needle.k1", "valve.mass")
STEP = 1e-6


def a_map(name: str, rail_pressure: float, weight: float = 1.0) -> QuantityData:
    points = tuple(OperatingPoint(rail_pressure, duration) for duration in (300e-6, 700e-6))
    quantity = np.array([5e-9, 40e-9])
    return QuantityData(name, Role.FIT, points, quantity, 1e-9, 0.1, np.zeros(2, bool), weight, "test", "all of it")


def a_curve(rail_pressure: float, weight: float = 1.0) -> RateData:
    bounds = np.linspace(0.0, 900e-6, 31)
    point = OperatingPoint(rail_pressure, 400e-6, horizon=900e-6)
    return RateData("curve", Role.FIT, point, bounds, np.full(30, 1e-5), weight, "test", "all of it")


def candidates(injector: Injector, count: int) -> np.ndarray:
    own = np.array([injector.values[name] for name in NAMES])
    return own * np.random.default_rng(11).uniform(0.8, 1.2, (count, 2))


def test_maps_are_told_apart_at_every_call(regulated: Injector) -> None:
    low, high = a_map("low", 60e6), a_map("high", 160e6, weight=3.0)
    objective = Objective(regulated, NAMES, [low, high], STEP, 1)
    for count in (9, 2, 9):
        values = candidates(regulated, count)
        expected = np.zeros(count)
        for data in (low, high):
            quantity = simulate_batch(regulated, data.points, NAMES, values).injected_volume
            error = (quantity - data.quantity) / (data.absolute + data.relative * data.quantity)
            expected += data.weight * np.sum(2.0 * (np.sqrt(1.0 + error**2) - 1.0), axis=1)
            assert np.array_equal(data.simulated(objective.simulator, values), quantity)
        assert np.array_equal(objective.costs(values).costs, expected)


def test_other_data_than_its_own_are_simulated_at_their_own_points(regulated: Injector) -> None:
    objective = Objective(regulated, (), [a_map("own", 60e6)], STEP, 1)
    itself = np.empty((1, 0))
    found = []
    for pressure in np.linspace(80e6, 140e6, 30):  # objects that come and go take each other's place in memory
        points = (OperatingPoint(float(pressure), 300e-6),)
        data = replace(a_map("other", 80e6), points=points, quantity=np.array([5e-9]), dead_time=[False])
        found.append(float(data.simulated(objective.simulator, itself)[0, 0]))
        del points, data
    assert np.all(np.diff(found) > 0.0)  # more pressure, more fuel


def test_the_cost_of_curves_is_weighted(regulated: Injector) -> None:
    values = candidates(regulated, 5)
    curves = [a_curve(80e6), replace(a_curve(160e6), weight=2.5)]
    objective = Objective(regulated, NAMES, curves, STEP, 1)
    single = [Objective(regulated, NAMES, [curve], STEP, 1).misfits(values)[:, 0] for curve in curves]
    assert objective.costs(values).costs == pytest.approx(single[0] + 2.5 * single[1], rel=1e-14)  # sums of two


@pytest.mark.parametrize("end", [500e-6, 600e-6, 1000e-6])  # the first and last are past the last step by rounding
def test_the_search_counts_every_sample_that_the_score_counts(regulated: Injector, end: float) -> None:
    point = OperatingPoint(160e6, 400e-6, horizon=end)
    curve = replace(a_curve(160e6), point=point, bounds=np.linspace(0.0, end, 21), rate=np.full(20, 1e-5))
    found = Objective(regulated, (), [curve], STEP, 1).costs(np.empty((1, 0))).costs[0]
    assert found == pytest.approx(curve.score(Simulator(regulated, (), STEP, 1)).j, rel=1e-9)  # sums in other orders


def test_a_failure_costs_everything_and_the_first_is_told(regulated: Injector) -> None:
    # Energised from the start for all the simulated time: a curve may end so, a map may not.
    injecting = (OperatingPoint(160e6, 500e-6, horizon=500e-6),)
    short = replace(a_map("short", 160e6), points=injecting, quantity=np.array([5e-9]), dead_time=np.zeros(1, bool))
    values = candidates(regulated, 4)
    values[1, 1] = -1.0
    curve = replace(a_curve(160e6), point=OperatingPoint(160e6, 900e-6, horizon=900e-6))
    scores = Objective(regulated, NAMES, [curve], STEP, 1).costs(values)
    assert scores.statuses.tolist() == [Status.OK, Status.OUTSIDE_DOMAIN, Status.OK, Status.OK]
    assert np.isinf(scores.costs).tolist() == [False, True, False, False]
    assert scores.simulations == 4
    scores = Objective(regulated, NAMES, [curve, short, a_map("high", 160e6)], STEP, 1).costs(values)
    injects = Status.STILL_INJECTING
    assert scores.statuses.tolist() == [injects, Status.OUTSIDE_DOMAIN, injects, injects]
    assert np.isinf(scores.costs).all()
    assert scores.simulations == 4 * (1 + 1 + 2)


def test_the_first_point_that_failed_is_told(regulated: Injector, monkeypatch: pytest.MonkeyPatch) -> None:
    still, ran_away, unstable = Status.STILL_INJECTING, Status.RAN_AWAY, Status.STEP_UNSTABLE
    of_curves = np.array([[still, unstable], [0, 0], [ran_away, unstable], [0, still]])
    of_map = np.array([[0, ran_away], [still, 0], [unstable, 0], [0, 0]])

    def pretend(injector: Injector, points: object, *arguments: object, misfit: object, **named: object) -> Batch:
        status = of_map if misfit is None else of_curves
        figures = np.where((status == 0) | (status == still), 1e-9, np.nan)
        return Batch(*[figures] * 6, status, np.full(2, 800.0), figures, figures)

    monkeypatch.setattr(module, "simulate_batch", pretend)
    data = [a_curve(80e6), a_curve(160e6), a_map("high", 160e6)]
    scores = Objective(regulated, NAMES, data, STEP, 1).costs(candidates(regulated, 4))
    assert scores.statuses.tolist() == [unstable, still, ran_away, Status.OK]
    assert np.isinf(scores.costs).tolist() == [True, True, True, False]


def test_a_cost_beyond_all_numbers_is_a_failure(regulated: Injector) -> None:
    values = candidates(regulated, 2)
    heavy = [a_map("heavy", 160e6, weight=np.finfo(float).max)]
    with np.errstate(over="ignore"):
        scores = Objective(regulated, NAMES, heavy, STEP, 1).costs(values)
    assert scores.statuses.tolist() == [Status.NOT_FINITE] * 2
    assert np.isinf(scores.costs).all()


def test_an_objective_in_use_travels_as_small_as_a_new_one(regulated: Injector) -> None:
    objective = Objective(regulated, NAMES, [a_curve(80e6), a_map("low", 60e6)], STEP, 1)
    new, values = pickle.dumps(objective), candidates(regulated, 3)
    costs = objective.costs(values).costs
    used = pickle.dumps(objective)
    assert used == new
    assert np.array_equal(pickle.loads(used).costs(values).costs, costs)


def test_a_senseless_time_step_is_refused(regulated: Injector) -> None:
    with pytest.raises(ConfigurationError, match="time step"):
        Objective(regulated, (), [a_map("low", 60e6)], 0.0, 1).costs(np.empty((1, 0)))


def test_squares_and_priors_are_those_of_the_residuals(regulated: Injector) -> None:
    own = np.array([regulated.values[name] for name in NAMES])
    priors = Priors([None, Prior(1.1 * own[1], 0.05 * own[1])])
    values = candidates(regulated, 3)
    objective = Objective(regulated, NAMES, [a_map("low", 60e6, 2.5)], STEP, 1, goal=Goal(Loss.SQUARES, priors))
    residuals = objective.residuals(values)
    assert residuals.shape == (3, 3)
    assert residuals[:, 2] == pytest.approx((values[:, 1] / own[1] - 1.1) / 0.05, rel=1e-9)
    # both sum the same squares, the batch in the order of its points
    assert objective.costs(values).costs == pytest.approx(np.sum(residuals**2, axis=1), rel=1e-9)
    plain = Objective(regulated, NAMES, [a_map("low", 60e6, 2.5)], STEP, 1).costs(values).costs
    pulled = Objective(regulated, NAMES, [a_map("low", 60e6, 2.5)], STEP, 1, goal=Goal(priors=priors))
    assert pulled.costs(values).costs == pytest.approx(plain + residuals[:, 2] ** 2, rel=1e-9)


def test_a_candidate_that_breaks_a_condition_loses(regulated: Injector) -> None:
    point = OperatingPoint(60e6, 700e-6)
    values, data = candidates(regulated, 2), [a_map("low", 60e6)]
    found = []
    for wanted in (Wanted.INJECTS, Wanted.SHUT):
        goal = Goal(conditions=(Condition(wanted, point),))
        objective = Objective(regulated, NAMES, data, STEP, 1, goal=goal)
        scores = objective.costs(values)
        assert scores.simulations == 2 * objective.injections == 6
        found.append((np.isfinite(scores.costs).all(), np.isfinite(objective.residuals(values)).all()))
    assert found == [(True, True), (False, False)]
    assert scores.statuses.tolist() == [Status.CONDITION_NOT_MET] * 2


def test_screening_is_coarser_and_near_the_residuals(pwm: Injector) -> None:
    values = candidates(pwm, 3)
    goal = Goal(screening_step=1.5e-6)
    objective = Objective(pwm, NAMES, [a_map("low", 60e6)], STEP, 1, goal=goal)
    fine, coarse = objective.residuals(values), objective.screened(values)
    assert not np.array_equal(fine, coarse)
    # f32 and a step half as long again: less than 1 % of quantities of up to 40 mm³, whose tolerance is 10 % and more
    assert coarse == pytest.approx(fine, abs=0.1)


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_soft_l1_is_that_of_the_plain_residuals_and_its_residuals_square_to_it(pwm: Injector, scale: float) -> None:
    own = np.array([pwm.values[name] for name in NAMES])
    priors = Priors([None, Prior(1.1 * own[1], 0.05 * own[1])])
    values, data = candidates(pwm, 3), [a_curve(80e6, 2.0), a_map("low", 60e6, 2.5)]
    plain = Objective(pwm, NAMES, data, STEP, 1, goal=Goal(Loss.SQUARES)).residuals(values)
    roots = np.sqrt(np.repeat([2.0, 2.5], [30, 2]))
    r = plain / roots
    expected = np.sum(roots**2 * 2.0 * scale**2 * (np.sqrt(1.0 + (r / scale) ** 2) - 1.0), axis=1)
    objective = Objective(pwm, NAMES, data, STEP, 1, goal=Goal(Loss.SOFT_L1, priors, scale=scale))
    pulls = ((values[:, 1] / own[1] - 1.1) / 0.05) ** 2
    residuals = objective.residuals(values)
    # rounding of sums of some thirty squares
    assert objective.costs(values).costs == pytest.approx(expected + pulls, rel=1e-9)
    assert np.sum(residuals**2, axis=1) == pytest.approx(expected + pulls, rel=1e-9)
    assert np.sign(residuals[:, :-1]).tolist() == np.sign(plain).tolist()
    weighted = objective.linearised(values)[:, :-1]
    weights = 1.0 / np.sqrt(1.0 + (r[0] / scale) ** 2)
    assert weighted == pytest.approx(plain * np.sqrt(weights), rel=1e-9)
    assert objective.screened(values).shape == residuals.shape


def test_a_failure_under_soft_l1_has_its_status(regulated: Injector) -> None:
    values = candidates(regulated, 3)
    values[1, 1] = -1.0
    objective = Objective(regulated, NAMES, [a_map("low", 60e6)], STEP, 1, goal=Goal(Loss.SOFT_L1))
    scores = objective.costs(values)
    assert scores.statuses.tolist() == [Status.OK, Status.OUTSIDE_DOMAIN, Status.OK]
    assert np.isposinf(scores.costs).tolist() == [False, True, False]


def test_an_outlier_hardly_counts_in_the_weights_of_soft_l1() -> None:
    goal = Goal(Loss.SOFT_L1, scale=1.0)
    residuals = np.array([0.0, 0.1, 100.0])
    # 1/sqrt(1 + r²), of which the root is taken
    assert goal.roots_of_weights(residuals) ** 2 == pytest.approx([1.0, 0.99503719, 0.0099995], rel=1e-6)
    assert goal.bent(residuals) ** 2 == pytest.approx(
        [0.0, 2.0 * (np.sqrt(1.01) - 1.0), 2.0 * (np.sqrt(10001.0) - 1.0)]
    )


def test_data_of_two_roles_are_not_summed(regulated: Injector) -> None:
    with pytest.raises(ConfigurationError):
        Objective(regulated, NAMES, [a_map("low", 60e6), a_map("high", 160e6).changed(role=Role.VALIDATION)], STEP, 1)


def test_the_objective_of_a_study_is_that_of_its_fitted_data_within_its_space(regulated: Injector) -> None:
    low, seen = a_map("low", 60e6), a_map("high", 160e6).changed(role=Role.VALIDATION)
    free = {name: "30 %" for name in NAMES}
    bound = f"{NAMES[1]} > {regulated.values[NAMES[1]]!r}"
    made = study(regulated, [low, seen], free=free, constraints=[bound])
    values = candidates(regulated, 8)
    scores, inside = made.objective().costs(values), made.space.satisfies(values)
    expected = Objective(regulated, NAMES, [low], made.time_step, 1).costs(values)
    assert 0 < np.sum(inside) < len(inside)
    assert np.array_equal(scores.costs, np.where(inside, expected.costs, np.inf))
    assert np.array_equal(scores.statuses, np.where(inside, expected.statuses, NOT_SIMULATED))
    assert scores.simulations == np.sum(inside) * len(low.points)
    assert made.objective().costs(values[~inside]).costs.min() == np.inf
