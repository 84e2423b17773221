"""Data sets that are seen through a meter: the law of the meter on simulated values, and the bits of those without."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.objective import Objective
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method, Study
from commonrail.data import simulator as module
from commonrail.data.base import DataSet, Role
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.simulator import ITSELF, Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import reference_density
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.physics.meters import Meter

STEP = 1e-6
FREE = ("plunger_needle.k1", "meter.bench.delay", "meter.bench.gain")


def a_curve(meter: Meter | None = None) -> RateData:
    bounds = np.linspace(0.0, 900e-6, 151)
    point = OperatingPoint(160e6, 400e-6, horizon=900e-6)
    return RateData("curve", Role.FIT, point, bounds, np.full(150, 1e-5), 1.0, "test", "all of it", meter=meter)


def a_map(meter: Meter | None = None, mass_density: float = np.nan) -> QuantityData:
    points = tuple(OperatingPoint(100e6, duration) for duration in (300e-6, 700e-6))
    values = np.array([5e-9, 40e-9]), 1e-9, 0.1, np.zeros(2, bool), 1.0
    return QuantityData("map", Role.FIT, points, *values, "test", "all of it", mass_density, meter=meter)


def itself(data: DataSet, injector: Injector) -> np.ndarray:
    """Simulated values of the injector as it is."""
    return data.simulated(Simulator(injector, (), STEP, 1), ITSELF)[0]


def candidates(injector: Injector) -> np.ndarray:
    """Three that differ in a spring, and two that differ from the last in the meter alone."""
    k1 = injector.values["plunger_needle.k1"]
    return np.array(
        [[0.9 * k1, 0.0, 1.0], [k1, 5e-6, 1.1], [1.1 * k1, 0.0, 1.0], [1.1 * k1, 3e-6, 1.0], [1.1 * k1, 0.0, 0.9]]
    )


@pytest.mark.parametrize("make", [a_curve, a_map])
def test_a_neutral_meter_leaves_every_bit(regulated: Injector, make: Any) -> None:
    plain, metered = make(), make(Meter("bench", {"delay": 0.0, "gain": 1.0}))
    assert np.array_equal(itself(plain, regulated), itself(metered, regulated))
    values = candidates(regulated)[:, :1]
    costs = [Objective(regulated, FREE[:1], [data], STEP, 1).costs(values).costs for data in (plain, metered)]
    assert np.array_equal(*costs)


def test_a_delay_of_one_sample_moves_the_curve_by_one(regulated: Injector) -> None:
    """Bounds on whole steps: the cubic goes through the cumulated masses, and only the sums round."""
    plain, delayed = itself(a_curve(), regulated), itself(a_curve(Meter("bench", {"delay": "6 us"})), regulated)
    np.testing.assert_allclose(delayed[1:], plain[:-1], rtol=1e-9, atol=1e-12 * plain.max())
    assert delayed[0] == 0.0


def test_gain_and_offset_of_a_curve(regulated: Injector) -> None:
    meter = Meter("bench", {"gain": 1.03, "offset": "0.5 mm3/ms"})
    expected = 1.03 * itself(a_curve(), regulated) + 0.5e-6
    np.testing.assert_allclose(itself(a_curve(meter), regulated), expected, rtol=1e-9)


def test_gain_and_offset_of_a_map(regulated: Injector) -> None:
    meter = Meter("bench", {"gain": 1.03, "quantity_offset": "0.5 mm3", "delay": "9 us"})
    expected = 1.03 * itself(a_map(), regulated) + 0.5e-9
    np.testing.assert_allclose(itself(a_map(meter), regulated), expected, rtol=1e-14)


@pytest.mark.parametrize("make", [a_curve, a_map])
def test_a_meter_has_a_density_of_its_own(regulated: Injector, make: Any) -> None:
    """By mass nothing changes; a volume at another density is as much smaller as that is greater."""
    plain, density = make(), reference_density(regulated, make().points[0])
    dense = itself(make(Meter("bench", {"density": 1.1 * density})), regulated)
    np.testing.assert_allclose(dense, itself(plain, regulated) / 1.1, rtol=1e-9, atol=1e-20)
    warm = regulated.values["fuel.temperature"] + 20.0
    ratio = density / reference_density(regulated.with_values({"fuel.temperature": warm}), plain.points[0])
    at_warmth = itself(make(Meter("bench", {"temperature": warm})), regulated)
    assert ratio > 1.01
    np.testing.assert_allclose(at_warmth, ratio * itself(plain, regulated), rtol=1e-9, atol=1e-20)


def test_candidates_that_differ_in_the_meter_alone_are_simulated_once(
    regulated: Injector, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated: list[int] = []

    def counted(*arguments: Any, **more: Any) -> Any:
        simulated.append(len(arguments[4]))
        return original(*arguments, **more)

    original = module.sampled_rates
    monkeypatch.setattr(module, "sampled_rates", counted)
    data, values = a_curve(Meter("bench")), candidates(regulated)
    together = data.simulated(Simulator(regulated, FREE, STEP, 1), values)
    assert simulated == [3]
    for row, value in zip(together, values, strict=True):
        assert np.array_equal(data.simulated(Simulator(regulated, FREE, STEP, 1), value[None])[0], row)


def test_costs_are_the_same_bits_on_threads_and_in_pieces(regulated: Injector, monkeypatch: pytest.MonkeyPatch) -> None:
    data = [
        a_curve(Meter("bench", {"cutoff": "60 kHz"}, "cascade")),
        a_map(Meter("bench", {"cutoff": "60 kHz"}, "cascade")),
    ]
    values = candidates(regulated)
    whole = Objective(regulated, FREE, data, STEP, 1).costs(values).costs
    monkeypatch.setattr(module, "SHARE", 1)
    assert np.array_equal(Objective(regulated, FREE, data, STEP, 2).costs(values).costs, whole)
    travelled = pickle.loads(pickle.dumps(Objective(regulated, FREE, data, STEP, 1)))
    assert np.array_equal(travelled.costs(values[3:]).costs, whole[3:])


def test_rates_without_a_meter_are_the_same_bits_on_threads(regulated: Injector) -> None:
    data, values = a_curve(), np.tile(candidates(regulated), (7, 1))  # several blocks of lanes
    one, two = (data.simulated(Simulator(regulated, FREE, STEP, threads), values) for threads in (1, 2))
    assert np.array_equal(one, two)


def test_j_of_each_data_set_keeps_the_order_of_the_data(regulated: Injector) -> None:
    data = [a_curve(Meter("bench", {"gain": 2.0})), a_curve(), a_curve(Meter("bench", {"gain": 2.0}))]
    objective = Objective(regulated, FREE[:1], data, STEP, 1)
    values = candidates(regulated)[:2, :1]
    expected = [d.misfit(d.simulated(objective.simulator, values)) for d in data]
    np.testing.assert_allclose(objective.misfits(values), np.transpose(expected), rtol=1e-9)


# --- Studies with meters --------------------------------------------------------------------------------------------


def study(injector: Injector, data: Sequence[DataSet], *free: Parameter) -> Study:
    k1 = injector.values["plunger_needle.k1"]
    own = Parameter("plunger_needle.k1", k1, 0.5 * k1, 2.0 * k1, "N/m", mark="E", source="test")
    return Study("test", injector, tuple(data), Space([own, *free]), Method(), 1, STEP)


def free(name: str, lower: float, upper: float) -> Parameter:
    return Parameter(name, 0.5 * (lower + upper), lower, upper, "", mark="E", source="test", signed=True)


@pytest.mark.parametrize(
    ("data", "parameter", "word"),
    [
        ([a_curve()], free("meter.bench.delay", 0.0, 1e-5), "no meter"),
        ([a_curve(Meter("bench"))], free("meter.bench.delai", 0.0, 1e-5), "mean .meter.bench.delay"),
        ([a_map(Meter("bench"))], free("meter.bench.delay", 0.0, 1e-5), "its delay"),
        ([a_curve(Meter("bench"))], free("meter.bench.gain", -1.0, 1.0), "gain.*zero"),
        ([a_curve(Meter("bench"))], free("meter.bench.density", 800.0, 900.0), "start value"),
        ([a_curve(Meter("bench", {"temperature": 313.0}))], free("meter.bench.temperature", 300.0, 3000.0), "range"),
        ([a_curve(Meter("bench")), a_map(Meter("bench", {"gain": 2.0}))], None, "different names"),
    ],
)
def test_meters_that_contradict_the_study_are_refused(
    regulated: Injector, data: list[DataSet], parameter: Parameter | None, word: str
) -> None:
    with pytest.raises(ConfigurationError, match=word):
        study(regulated, data, *([parameter] if parameter else []))


def test_a_density_of_the_meter_is_refused_for_masses() -> None:
    with pytest.raises(ConfigurationError, match=r"\bmass\b.*\bdensity of"):
        a_map(Meter("bench", {"density": 830.0}), mass_density=830.0)
    with pytest.raises(ConfigurationError, match=r"\bmass\b.*\btemperature of"):
        replace(a_curve(), mass_density=830.0, meter=Meter("bench", {"temperature": 313.0}))


@pytest.mark.parametrize("meter", [None, Meter("bench", {"cutoff": "60 kHz"}, "cascade")])
def test_a_candidate_whose_step_is_too_long_has_no_samples_and_never_wins(
    regulated: Injector, meter: Meter | None
) -> None:
    stiff = "plunger_needle.k4"
    data, many = a_curve(meter), regulated.values[stiff] * np.geomspace(1.0, 40.0, 64)[:, None]
    statuses = simulate_batch(regulated, data.points, [stiff], many, time_step=STEP).status[:, 0]
    first = statuses.tolist().index(Status.STEP_UNSTABLE)  # just beyond the limit: its samples are plausible
    values = many[[first - 1, first]]
    assert statuses[first - 1] == Status.STILL_INJECTING
    samples = data.simulated(Simulator(regulated, (stiff,), STEP, 1), values)
    assert np.isfinite(samples[0]).all()
    assert np.isnan(samples[1]).all()
    costs = Objective(regulated, (stiff,), [data], STEP, 1).costs(values).costs
    assert np.isfinite(costs[0])
    assert np.isinf(costs[1])
