"""A misfit at the default step is smooth in a stiffness: a fit by gradients sees no edges where a needle lands."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.physics.injector import Injector
from commonrail.readers.injector import load_injector

INTERVAL = 3e-6


@pytest.mark.parametrize("stiffness", ["k1", "k6", "k7"])
def test_the_misfit_is_smooth_along_a_stiffness(regulated: Injector, stiffness: str) -> None:
    point, name = OperatingPoint(160e6, 700e-6, 5e6, 0.5e6, horizon=1.56e-3), f"plunger_needle.{stiffness}"
    truth = simulate_reference(regulated, point, INTERVAL).mass_rate
    misfits = []
    for factor in np.linspace(0.97, 1.03, 121):
        changed = regulated.with_values({name: factor * regulated.values[name]})
        rate = simulate(changed, point, time_step=1e-6, sample_interval=INTERVAL).mass_rate
        misfits.append(np.sum((rate - truth) ** 2))
    curvature = np.abs(np.diff(misfits, 2))
    # smooth: 1.5 to 2.0; with edges where a needle lands or the SAC empties within a step: 10 to 13
    assert curvature.max() < 4.0 * np.median(curvature)


def test_the_quantity_is_smooth_along_the_spring_of_a_valve_that_bounces() -> None:
    """Plunger and valve meet stop and seat several times in an injection of 2 ms."""
    injector, name = load_injector("crin1"), "valve.spring_preload"
    change = np.linspace(-0.01, 0.01, 401)
    values = injector.values[name] * (1.0 + change[:, None])
    batch = simulate_batch(injector, [OperatingPoint(160e6, 2e-3, horizon=3.5e-3)], [name], values, time_step=1e-6)
    quantity = 1e9 * batch.injected_volume[:, 0]  # [mm³], over a range of 0.5 mm³
    rest = quantity - np.polynomial.Polynomial.fit(change, quantity, 6)(change)
    # smooth: 4e-4; where touching changed the law of a step: 1e-2
    assert np.abs(rest).max() < 1.5e-3
