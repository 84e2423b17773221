"""Feed pipe: the loss of a steady flow, and long pipes against the reference's cells."""

from __future__ import annotations

import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate
from commonrail.physics.components import feed_pipe
from commonrail.physics.injector import Injector

PIPE = feed_pipe.coefficients(feed_pipe.Parameters(3.0, 2e-3, 0.03), 860.0, 1400.0)


@pytest.mark.parametrize("flow", [0.03, -0.02])
def test_a_steady_flow_loses_the_whole_friction_and_nothing_else(flow: float) -> None:
    """Waves that leave and arrive unchanged for ever: p_in − p_end = R q|q|, Eq. (6)."""
    loss = PIPE.resistance * flow * abs(flow)
    inlet, end, ends = 160e6, 160e6 - loss, feed_pipe.State(flow, flow)
    assert abs(loss) > 1e6
    down = inlet + PIPE.impedance * flow - feed_pipe.end_loss(PIPE, flow)
    up = end - PIPE.impedance * flow + feed_pipe.end_loss(PIPE, flow)
    middle = feed_pipe.middle_loss(PIPE, ends, down, up)
    # rounding
    assert down - middle - feed_pipe.end_loss(PIPE, flow) == pytest.approx(end + PIPE.impedance * flow, rel=1e-12)
    assert up + middle + feed_pipe.end_loss(PIPE, flow) == pytest.approx(inlet - PIPE.impedance * flow, rel=1e-12)


@pytest.mark.parametrize(("length", "limit"), [(0.12, 1e-4), (1.0, 2e-4), (3.0, 1e-3)])
def test_a_long_pipe_agrees_with_cells(pwm: Injector, length: float, limit: float) -> None:
    """Friction converges with the step as long as the wave comes back during the injection, and nearly so beyond."""
    injector = pwm.with_values({"feed_pipe.length": length})
    point = OperatingPoint(160e6, 700e-6, horizon=2.4e-3)
    cells = simulate_reference(injector, point, resolution=Resolution((240, 60), method="explicit"))
    lanes = simulate(injector, point, time_step=0.25e-6)
    # 2e-5, 6e-5 and 5e-4 were seen; with friction at the ends alone 4e-5, 6e-4 and 4e-3
    assert lanes.injected_mass == pytest.approx(cells.injected_mass, rel=limit)
