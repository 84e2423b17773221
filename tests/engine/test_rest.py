"""A simulation begins with the guides leaking steadily: nothing moves before the command, however long it waits."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Model, Resolution
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector

WORN = {"plunger_needle.plunger_gap": 4e-6, "plunger_needle.needle_gap": 4e-6}  # leaks 0.2 g/s, about 1 % of a jet


def injector(request: pytest.FixtureRequest, wiring: str) -> Injector:
    plain: Injector = request.getfixturevalue(wiring)
    return plain.with_values(WORN | {"feed_pipe.friction_factor": 0.05, "control_chamber.z_hole_from_inlet": 0.5})


@pytest.mark.parametrize("wiring", ["regulated", "rigid"])
def test_nothing_moves_before_the_command(request: pytest.FixtureRequest, wiring: str) -> None:
    waiting = OperatingPoint(160e6, [(20e-3, 300e-6)], start=0.0, horizon=19.9e-3)
    solution = simulate(injector(request, wiring), waiting)
    assert solution.returned_mass > 1e-6  # it leaks
    for name, values in solution.channels.items():
        # what is left of the iteration, and rounding; without leakage in the rest state pressures fall by 1e-3
        np.testing.assert_allclose(values, values[0], rtol=1e-8, err_msg=name)


def test_a_pilot_does_not_depend_on_the_time_before_it(regulated: Injector) -> None:
    worn = regulated.with_values(WORN)
    starts = (0.0, -1e-3, -5e-3)
    points = [OperatingPoint(100e6, 250e-6, start=start, horizon=2e-3 - start) for start in starts]
    quantities = [simulate(worn, point).injected_volume for point in points]
    # rounding of the clocks; without leakage in the rest state 2e-3
    assert quantities[1:] == pytest.approx([quantities[0]] * 2, rel=1e-7)


@pytest.mark.parametrize("wiring", ["regulated", "volume"])
def test_the_reference_begins_in_the_same_balance(request: pytest.FixtureRequest, wiring: str) -> None:
    model = Model(injector(request, wiring), OperatingPoint(160e6, 300e-6), Resolution(cells=(20, 0)), None)
    core = model.core.load(model.slopes(0.0, model.start), model.at.core, 1)
    leak = core.cumulative_flows.returned
    assert core.cumulative_flows.supplied == pytest.approx(leak, rel=1e-6)  # what is left of the iteration
    assert core.fuel == pytest.approx((0.0, 0.0, 0.0), abs=1e-6 * leak)
    pipe = model.slopes(0.0, model.start)[: model.at.core]
    assert np.abs(pipe[::2]).max() < 1e-6 * leak / 1e-6  # changes of flow, over a microsecond
