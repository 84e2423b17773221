"""One simulation as a meter shows it: delay, gain, density and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.data.base import Role
from commonrail.data.curves.data import RateData
from commonrail.data.simulator import ITSELF, Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import Solution, metered
from commonrail.physics.injector import Injector
from commonrail.physics.meters import Meter

POINT = OperatingPoint(160e6, 400e-6, horizon=2e-3)


@pytest.fixture(scope="module")
def solution(regulated: Injector) -> Solution:
    return simulate(regulated, POINT)


def test_a_neutral_meter_shows_the_rate_itself(regulated: Injector, solution: Solution) -> None:
    found = metered(solution, Meter("bench"), regulated, POINT)
    # differences of sums: rounding of the cumulated flow, relative to the peak
    np.testing.assert_allclose(found.rate, solution.rate, atol=1e-9 * solution.rate.max())
    assert found.quantity == pytest.approx(solution.injected_volume, rel=1e-12)


def test_delay_gain_and_density_are_those_of_the_meter(regulated: Injector, solution: Solution) -> None:
    meter = Meter("bench", {"delay": "20 us", "gain": 1.1, "density": "700 kg/m3", "quantity_offset": "1 mm3"})
    found = metered(solution, meter, regulated, POINT)
    expected = 1.1 * solution.mass_rate[:-20] / 700.0
    np.testing.assert_allclose(found.rate[20:], expected, atol=1e-9 * expected.max())
    assert found.quantity == pytest.approx(1.1 * solution.injected_mass / 700.0 + 1e-9, rel=1e-12)
    warm = metered(solution, Meter("bench", {"temperature": "20 degC"}), regulated, POINT)
    (density,) = regulated.fuel.density(np.array([5e6]), 293.15)
    assert warm.quantity == pytest.approx(solution.injected_mass / density, rel=1e-12)


def test_it_is_what_a_study_compares_with_its_data(regulated: Injector, solution: Solution) -> None:
    meter = Meter(
        "bench", {"cutoff": "20 kHz", "delay": "7.3 us", "echo_share": 0.05, "echo_delay": "0.2 ms"}, "cascade"
    )
    bounds = solution.time[::10]
    curve = RateData(
        "curve", Role.FIT, POINT, bounds, np.full(len(bounds) - 1, 1e-6), 1.0, "test", "all of it", meter=meter
    )
    compared = curve.simulated(Simulator(regulated, (), 1e-6, 1), ITSELF)[0]
    shown = metered(solution, meter, regulated, POINT).rate.reshape(-1, 10).mean(axis=1)
    np.testing.assert_allclose(shown, compared, atol=1e-9 * compared.max())


def test_uneven_samples_are_refused(regulated: Injector, solution: Solution) -> None:
    uneven = replace(solution, time=solution.time**1.01)
    with pytest.raises(ConfigurationError, match="equal intervals"):
        metered(uneven, Meter("bench"), regulated, POINT)
