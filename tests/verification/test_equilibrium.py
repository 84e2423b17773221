"""Before energising nothing moves."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.physics.injector import Injector
from tests.tracing import trace_states

SEALED = {"plunger_needle.plunger_gap": 0.0, "plunger_needle.needle_gap": 0.0}


@pytest.mark.parametrize("wiring", ["pwm", "rigid", "volume"])
def test_a_sealed_injector_stays_as_it_is(request: pytest.FixtureRequest, wiring: str) -> None:
    injector = request.getfixturevalue(wiring).with_values(SEALED)
    rows = trace_states(injector, OperatingPoint(160e6, (), horizon=1e-3), 1e-6)
    for name in ("control_chamber.fuel", "accumulation.fuel", "sac"):
        pressure = rows[f"{name}.pressure"]
        # rounding of a mass, 1e-16, times K = 2.5 GPa, is 3e-7 Pa a step
        assert np.abs(pressure - pressure[0]).max() < 1e-3, name
    tip = rows["body.z" if wiring == "rigid" else "body.z.i9"]
    assert np.abs(tip - tip[0]).max() < 1e-15
    assert np.abs(rows["valve.lift"] - rows["valve.lift"][0]).max() < 1e-15
    assert rows["nozzle.injected"][-1] == rows["cumulative_flows.returned"][-1] == 0.0


def test_leakage_moves_a_little_and_injects_nothing(pwm: Injector) -> None:
    rows = trace_states(pwm, OperatingPoint(160e6, (), horizon=1e-3), 1e-6)
    # 0.12 g/s of leakage against the pipe's impedance of 3.5e8 Pa s/kg is 0.04 MPa
    assert np.ptp(rows["accumulation.fuel.pressure"]) < 0.1e6
    assert np.ptp(rows["body.z.i9"]) < 10e-9
    assert rows["body.z.i9"].max() < 0.0
    assert rows["nozzle.injected"][-1] == 0.0
