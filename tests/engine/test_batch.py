"""Many at once: same bits for any threads and neighbours, failures that stay alone, misfit in the loop."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from tests.tracing import trace_states

K = tuple(f"plunger_needle.k{i}" for i in range(1, 8))
POINTS = [OperatingPoint(160e6, 700e-6), OperatingPoint(80e6, 400e-6)]
FIGURES = ("injected_mass", "returned_mass", "opening", "closing", "greatest_lift", "absolute_error", "squared_error")


def stiffnesses(injector: Injector, count: int) -> np.ndarray:
    own = np.array([injector.values[name] for name in K])
    return own * np.random.default_rng(7).uniform(0.6, 1.5, (count, 7))


def same_bits(one: Batch, other: Batch, rows: slice, others: slice) -> None:
    for name in FIGURES:
        a, b = getattr(one, name)[rows], getattr(other, name)[others]
        assert np.array_equal(a, b, equal_nan=True), name
    assert np.array_equal(one.status[rows], other.status[others])


def test_threads_do_not_change_a_bit(regulated: Injector) -> None:
    values = stiffnesses(regulated, 21)
    one, two, five = (simulate_batch(regulated, POINTS, K, values, threads=n) for n in (1, 2, 5))
    same_bits(one, two, slice(None), slice(None))
    same_bits(one, five, slice(None), slice(None))


def test_a_candidate_does_not_see_its_neighbours(regulated: Injector) -> None:
    values = stiffnesses(regulated, 21)
    whole = simulate_batch(regulated, POINTS, K, values)
    for i in (0, 5, 8, 20):
        alone = simulate_batch(regulated, POINTS, K, values[i : i + 1])
        same_bits(whole, alone, slice(i, i + 1), slice(0, 1))
    backwards = simulate_batch(regulated, POINTS, K, values[::-1])
    same_bits(whole, backwards, slice(None), slice(None, None, -1))


def failing(injector: Injector, values: np.ndarray) -> np.ndarray:
    own = np.array([injector.values[name] for name in K])
    spoilt = values.copy()
    spoilt[1] = 10 * own  # unstable at 1 us
    spoilt[2, 3] = np.nan
    spoilt[3, 0] = np.inf
    spoilt[4, 6] = 1e300
    spoilt[5, 2] = -1e8
    return spoilt


def test_failures_have_names_and_stay_alone(regulated: Injector) -> None:
    values = stiffnesses(regulated, 16)
    sound = simulate_batch(regulated, POINTS, K, values)
    batch = simulate_batch(regulated, POINTS, K, failing(regulated, values))
    assert batch.status[1].tolist() == [Status.STEP_UNSTABLE] * 2
    assert batch.status[2].tolist() == [Status.OUTSIDE_DOMAIN] * 2
    assert batch.status[3].tolist() == [Status.OUTSIDE_DOMAIN] * 2
    assert np.all(np.isin(batch.status[4], (Status.STEP_UNSTABLE, Status.NOT_FINITE)))
    assert batch.status[5].tolist() == [Status.OUTSIDE_DOMAIN] * 2
    assert batch.failed[1:6].all()
    assert np.isnan(batch.injected_mass[1:6]).all()
    same_bits(sound, batch, slice(0, 1), slice(0, 1))
    same_bits(sound, batch, slice(6, None), slice(6, None))


def test_a_needle_that_does_not_close_is_told_before_anything(regulated: Injector) -> None:
    # a plunger of the needle's own size leaves nothing but the spring to hold it down
    name = ("plunger_needle.plunger_diameter",)
    batch = simulate_batch(regulated, POINTS, name, np.array([[2.0e-3], [4.3e-3]]))
    assert batch.status[0].tolist() == [Status.NOT_CLOSED_AT_START] * 2
    assert np.isnan(batch.injected_mass[0]).all()
    assert batch.status[1].tolist() == [Status.OK] * 2
    assert "seat" in Status.NOT_CLOSED_AT_START.sentence


def test_misfit_in_the_loop_is_the_sum_over_a_trace(regulated: Injector) -> None:
    point = OperatingPoint(160e6, 700e-6, horizon=1.6e-3)
    bounds = np.linspace(0.0, 1560.0, 521) + 0.3  # [steps], none on a step's end
    rng = np.random.default_rng(3)
    target, weight = rng.uniform(0.0, 0.04, 521), rng.uniform(0.0, 2.0, 521)
    misfit = Misfit(np.array([521]), bounds[None], target[None], weight[None], np.ones((1, 1)))
    values = stiffnesses(regulated, 3)
    batch = simulate_batch(regulated, [point], K, values, misfit=misfit)
    for i in range(3):
        mass = trace_states(regulated.with_values(dict(zip(K, values[i].tolist(), strict=True))), point, 1e-6)[
            "nozzle.injected"
        ]
        at_bounds = np.interp(bounds, np.arange(len(mass)), mass)
        error = np.diff(at_bounds) / np.diff(bounds) / 1e-6 - target[1:]
        # rounding of masses of 4e-5 kg, differenced over 3e-6 s: 1e-14 of the sum
        assert batch.absolute_error[i, 0] == pytest.approx(np.sum(weight[1:] * np.abs(error)), rel=1e-12)
        assert batch.squared_error[i, 0] == pytest.approx(np.sum(weight[1:] * error**2), rel=1e-12)


def test_several_points_have_their_own_samples(regulated: Injector) -> None:
    points = [OperatingPoint(160e6, 700e-6, horizon=1.6e-3), OperatingPoint(80e6, 700e-6, horizon=1.2e-3)]
    none = np.zeros((2, 4))
    bounds = np.array([[0.0, 500.0, 1000.0, 1600.0], [0.0, 600.0, 1200.0, 0.0]])
    misfit = Misfit(np.array([4, 3]), bounds, none, none + 1.0, np.ones((1, 2)))
    batch = simulate_batch(regulated, points, misfit=misfit)
    for i, (point, widths) in enumerate(zip(points, ([500, 500, 600], [600, 600]), strict=True)):
        mass = trace_states(regulated, point, 1e-6)["nozzle.injected"]
        ends = np.cumsum([0, *widths])
        rates = np.diff(mass[ends]) / (np.array(widths) * 1e-6)
        assert batch.absolute_error[0, i] == pytest.approx(rates.sum(), rel=1e-12)  # rounding


def test_names_and_values_must_match(regulated: Injector) -> None:
    with pytest.raises(ConfigurationError, match=r"^7 .*\b6 values"):
        simulate_batch(regulated, POINTS, K, np.ones((2, 6)))
