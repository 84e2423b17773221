"""Return line behind a valve that shuts: the column that runs on, stops and comes back, in closed form."""

from __future__ import annotations

import pytest

from commonrail.physics.components import return_line
from commonrail.physics.flow import impedance, pipe_area

SPEED, LENGTH, DIAMETER = 1300.0, 0.65, 4e-3  # a round trip of 1 ms
LOW, VAPOUR, DT = 0.5e6, 60.0, 1e-6
STEPS = 1000  # of a round trip
Z = impedance(SPEED, pipe_area(DIAMETER))
FULL = (LOW - VAPOUR) / Z  # the flow that the tank's pressure stops within one round trip [kg/s]


def shut(flow: float, trips: int) -> list[return_line.State]:
    """States after every step, the steady flow [kg/s] through the valve being shut off at time zero."""
    c = return_line.coefficients(return_line.Parameters(LENGTH, DIAMETER), SPEED, DT)
    state, leaving = return_line.State(LOW, 0.0), [LOW + Z * flow] * STEPS
    states = []
    for k in range(trips * STEPS):
        back = 2.0 * LOW - leaving[k]
        state = return_line.advance(c, return_line.without_flow(c, state, back), VAPOUR, 0.0)
        leaving.append(2.0 * state.pressure - back)
        states.append(state)
    return states


def test_a_column_leaves_a_cavity_and_fills_it() -> None:
    """Its flow falls by 2 (p_low − p_v)/Z a round trip, 3.5 times half of that at first; the fourth fills it."""
    states = shut(3.5 * FULL, 4)
    mass = FULL * STEPS * DT
    expected = [0.0, 2.5, 3.0, 1.5]
    for trip, missing in enumerate(expected):
        if trip:
            assert states[trip * STEPS - 1].cavity == pytest.approx(missing * mass, rel=1e-9)
    filled = 3 * STEPS + round(STEPS * 1.5 / 3.5)
    assert all(s.cavity > 0.0 and s.pressure == VAPOUR for s in states[: filled - 1])
    # the column meets the shut valve: Joukowsky's pressure of its flow
    assert all(s.cavity == 0.0 for s in states[filled + 1 :])
    assert states[filled + 1].pressure == pytest.approx(VAPOUR + 3.5 * Z * FULL, rel=1e-9)


def test_a_column_that_the_tank_can_hold_leaves_none() -> None:
    states = shut(0.9 * FULL, 3)
    assert all(s.cavity == 0.0 for s in states)
    for trip, share in enumerate((-0.9, 0.9, -0.9)):
        assert states[trip * STEPS].pressure == pytest.approx(LOW + share * Z * FULL, rel=1e-12)


def test_a_line_of_length_zero_is_the_tank() -> None:
    c = return_line.coefficients(return_line.Parameters(0.0, DIAMETER), SPEED, DT)
    state = return_line.State(LOW, 0.0)
    for flow in (0.0, 0.02, -0.02):
        state = return_line.advance(c, return_line.without_flow(c, state, LOW), VAPOUR, flow)
        assert state == (LOW, 0.0)
