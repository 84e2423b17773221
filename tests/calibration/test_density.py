"""Volumes of candidates that differ in fuel temperature: the search and the report use one density."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.arguments import COUNTS
from commonrail.base.choices import Actuation
from commonrail.calibration.objective import Objective
from commonrail.data.base import Role
from commonrail.data.curves.data import RateData, RateScore
from commonrail.data.quantities.data import QuantityData
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import reference_density
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.status import Status
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_quantities
from commonrail.physics.variants import Variant, unread_parameters

STEP = 1e-6
WARM, COLD = 363.15, 313.15
POINTS = (OperatingPoint(160e6, 200e-6, horizon=900e-6), OperatingPoint(80e6, 250e-6, 10e6, horizon=900e-6))
BOUNDS = np.linspace(0.0, 600e-6, 41)
# The loop and the traced run add up the same steps; the sums of 40 samples round differently.
ROUNDING = 1e-9


def curve(rate: np.ndarray, weight: float, mass_density: float = math.nan) -> RateData:
    return RateData("curve", Role.FIT, POINTS[0], BOUNDS, rate, weight, "test", "all of it", mass_density)


def quantities(volume: np.ndarray, weight: float, mass_density: np.ndarray | float = math.nan) -> QuantityData:
    none = np.zeros(len(volume), bool)
    return QuantityData("map", Role.FIT, POINTS, volume, 1e-9, 0.1, none, weight, "test", "all of it", mass_density)


def j_of_scores(injector: Injector, data: list[RateData | QuantityData]) -> float:
    """Σ weight · J, from what the report states."""
    total = 0.0
    for one in data:
        score = one.score(Simulator(injector, (), STEP, 1))
        if isinstance(score, RateScore):
            total += one.weight * score.j
        elif isinstance(one, QuantityData):
            error = (score.values - one.quantity) / (one.absolute + one.relative * one.quantity)
            total += one.weight * float(np.sum(2.0 * (np.sqrt(1.0 + error**2) - 1.0)))
    return total


def neighbour(name: str, own: float) -> float:
    """A value of a parameter that is near its own and admissible."""
    if name == FUEL_TEMPERATURE:
        return COLD
    quantity = parameter_quantities(Actuation.SERVO)[name]
    if name in COUNTS:
        return own - 1.0
    return 0.99 * own if own else min(0.01, *(quantity.usual or (0.01,)))


# Each parameter is read by one of them, but for the diode's voltage: with a free-wheeling coil the needle outlasts
# these horizons.
VARIANTS = (Variant(), Variant(boundary="volume"), Variant(drive="pwm"))  # those that other tests compile too
READ = [name for name in parameter_quantities(Actuation.SERVO) if name != "drive.diode_voltage"]


@pytest.mark.parametrize("name", READ)
def test_the_objective_is_the_sum_of_the_reported_scores(regulated: Injector, name: str) -> None:
    """At a candidate whose parameter differs from the injector's, by volume and by mass."""
    variant = next(variant for variant in VARIANTS if name not in unread_parameters(variant))
    injector = replace(regulated, variant=variant)
    value = neighbour(name, injector.values[name])
    data = [
        curve(np.linspace(0.0, 1e-5, 40), 1.5),
        curve(np.linspace(1e-5, 0.0, 40), 0.5, mass_density=830.0),
        quantities(np.array([2e-9, 3e-9]), 0.7),
        quantities(np.array([2e-9, 3e-9]), 0.3, np.array([830.0, math.nan])),
    ]
    found = Objective(injector, (name,), data, STEP, 1).costs(np.array([[value]]))
    assert found.statuses[0] == Status.OK
    assert found.costs[0] == pytest.approx(j_of_scores(injector.with_values({name: value}), data), rel=ROUNDING)


@pytest.mark.parametrize("by_mass", [False, True])
def test_the_truth_costs_nothing_whatever_temperature_the_search_starts_from(
    regulated: Injector, by_mass: bool
) -> None:
    truth = regulated.with_values({FUEL_TEMPERATURE: COLD})
    start = regulated.with_values({FUEL_TEMPERATURE: WARM})
    mass = curve(np.zeros(40), 1.0, 1.0).simulated(Simulator(truth, (), STEP, 1), np.empty((1, 0)))[0]
    masses = np.array([simulate(truth, point).injected_mass for point in POINTS])
    # a mass is turned into a volume when it is read, at the density of the injector that the search starts from
    made = [reference_density(start if by_mass else truth, point) for point in POINTS]
    kept = np.array(made) if by_mass else math.nan
    data = [curve(mass / made[0], 1.0, made[0] if by_mass else math.nan), quantities(masses / made, 1.0, kept)]
    objective = Objective(start, (FUEL_TEMPERATURE,), data, STEP, 1)
    costs = objective.costs(np.array([[COLD], [WARM]])).costs
    assert costs[0] == pytest.approx(0.0, abs=ROUNDING)
    assert costs[1] > 1.0
    # a batch ends a simulation at its closing, before the last of the SAC's fuel: 7e-6 of the map's tolerance was seen
    assert np.abs(objective.residuals(np.array([[COLD]]))).max() < 1e-4


def test_a_batch_states_the_volumes_of_single_simulations(regulated: Injector) -> None:
    temperatures = np.array([[COLD], [WARM], [COLD + 5.0]])
    batch = simulate_batch(regulated, POINTS, (FUEL_TEMPERATURE,), temperatures, stop_when_closed=False)
    for i, (temperature,) in enumerate(temperatures):
        for j, point in enumerate(POINTS):
            alone = simulate(regulated.with_values({FUEL_TEMPERATURE: temperature}), point)
            assert batch.reference_density[i, j] == alone.reference_density
            assert batch.injected_volume[i, j] == pytest.approx(alone.injected_volume, rel=1e-12)  # rounding
            assert batch.returned_volume[i, j] == pytest.approx(alone.returned_volume, rel=1e-12)


def test_a_temperature_that_the_fuel_does_not_know_fails_alone(regulated: Injector) -> None:
    batch = simulate_batch(regulated, POINTS[:1], (FUEL_TEMPERATURE,), np.array([[COLD], [150.0], [np.nan]]))
    assert batch.status[:, 0].tolist() == [Status.OK, Status.OUTSIDE_DOMAIN, Status.OUTSIDE_DOMAIN]
