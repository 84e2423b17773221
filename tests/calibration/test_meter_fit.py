"""A fit that knows of the meter finds delay and stiffness; one that does not takes the delay for softness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.calibration.optimisers.evolution import EvolutionSettings
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method, Study
from commonrail.data.base import Role
from commonrail.data.curves.data import RateData
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from commonrail.physics.meters import Meter

K7, TRUE_K7, DELAY = "plunger_needle.k7", 64.4e6, 5e-6
NOISE = 0.05e-6  # [m³/s], a sixth of the virtual bench's


@pytest.fixture(scope="module")
def delayed(regulated: Injector) -> RateData:
    """Curve of a stiffer injector, 5 us late: the mean between two bounds is that of 5 us before.

    Simulated with half the time step of the fit, and delayed without the meter's law.
    """
    point = OperatingPoint(160e6, 700e-6, horizon=1400e-6)
    truth = simulate(regulated.with_values({K7: TRUE_K7}), point, time_step=0.5e-6)
    bounds = np.linspace(0.0, 1398e-6, 467)
    rate = np.diff(np.interp(bounds - DELAY, truth.time, truth.injected / truth.reference_density)) / np.diff(bounds)
    noisy = rate + NOISE * np.random.default_rng(5).standard_normal(len(rate))
    return RateData("delayed", Role.FIT, point, bounds, noisy, 1.0, "test", "all of it")


def fit(injector: Injector, data: RateData, *free: Parameter) -> Calibration:
    """Search for k7, and for what else is free."""
    own = injector.values[K7]
    k7 = Parameter(K7, own, 0.5 * own, 1.5 * own, "N/m", mark="E", source="test")
    method = Method(EvolutionSettings(members=12, generations=12), polish=2, polish_iterations=8)
    return calibrate(Study("test", injector, (data,), Space([k7, *free]), method, 1, 1e-6), threads=1)


def test_a_known_delay_gives_the_true_stiffness(regulated: Injector, delayed: RateData) -> None:
    """Half a percent, ten times what the noise moves k7 by, against 20 % if the delay is not known."""
    known = fit(regulated, delayed.changed(meter=Meter("bench", {"delay": DELAY})))
    ignored = fit(regulated, delayed)
    assert known.best[K7] == pytest.approx(TRUE_K7, rel=5e-3)
    assert ignored.best[K7] < 0.9 * TRUE_K7
    assert known.cost < ignored.cost


def test_a_fitted_delay_is_found_beside_the_stiffness(regulated: Injector, delayed: RateData) -> None:
    delay = Parameter("meter.bench.delay", 0.0, -5e-6, 20e-6, "s", mark="E", source="test", signed=True)
    found = fit(regulated, delayed.changed(meter=Meter("bench")), delay)
    assert found.best["meter.bench.delay"] == pytest.approx(DELAY, abs=0.2e-6)
    assert found.best[K7] == pytest.approx(TRUE_K7, rel=0.02)  # 0.2 us of delay and 2 % of k7 do the same
    assert found.injector.values[K7] == found.best[K7]
    (meter,) = found.meters
    assert meter.values["delay"] == found.best["meter.bench.delay"]
    assert meter.sources["delay"].mark == "F"
    # the reported score is that of the calibrated meter
    assert found.scores["best"][0].error == pytest.approx(found.cost, rel=1e-9)
    assert found.scores["start"][0].error > 2.0 * found.cost
    assert replace(found.data[0], meter=None) == replace(delayed, meter=None) or found.data[0].meter == meter
