"""Memory of the discharge coefficient: how it fades, and that a touch of the seat makes no jump of it."""

from __future__ import annotations

import math
from types import SimpleNamespace as Record

import pytest

from commonrail.physics.components.nozzle import RESIDUAL_LIFT
from commonrail.physics.connections import RELAXED, fading_share, memory_rate, remembered_lift
from commonrail.physics.model import lag_fraction

MEMORY, CYLINDER = 15e-6, 5e6
LIFT = 200e-6


def after(duration: float, step: float, tip: float = -1e-6) -> float:
    """Lift remembered after a time on the seat [m]."""
    c = Record(delays=Record(memory_lag_fraction=lag_fraction(MEMORY, step)))
    lift = LIFT
    for _ in range(round(duration / step)):
        state = Record(nozzle=Record(lift_reached=lift), sac=Record(pressure=CYLINDER))
        lift = remembered_lift(c, state, tip, CYLINDER)
    return lift


@pytest.mark.parametrize("step", [1e-6, 0.25e-6])
def test_the_lift_remembered_fades_on_the_seat_whatever_the_step(step: float) -> None:
    # 1e-12: rounding of 160 products
    assert after(40e-6, step) == pytest.approx(LIFT * math.exp(-40e-6 / MEMORY), rel=1e-12)


def test_the_references_rate_is_that_of_a_short_step() -> None:
    step = 1e-10
    rate = memory_rate(Record(nozzle=Record(memory=MEMORY)), LIFT, -1e-6, 0.0, 0.0)
    assert rate == pytest.approx((after(step, step) - LIFT) / step, rel=1e-5)  # the step is 1e-5 of the memory


def test_a_rising_needle_is_followed_and_a_falling_one_is_not() -> None:
    c = Record(nozzle=Record(memory=MEMORY))
    assert memory_rate(c, LIFT, LIFT, 0.5, 1e8) == 0.5
    assert memory_rate(c, LIFT, LIFT, -0.5, 1e8) == memory_rate(c, LIFT, 0.5 * LIFT, 0.5, 1e8) == 0.0


def test_neither_lift_nor_pressure_has_a_step_where_the_memory_begins_to_fade() -> None:
    for at in (0.0, RESIDUAL_LIFT):
        shares = [fading_share(at + side * 1e-10, 0.0) for side in (-1, 1)]
        assert shares[0] == pytest.approx(shares[1], abs=3e-4)  # 0.2 nm of the 1 um over which it begins
    for at in (0.0, RELAXED):
        shares = [fading_share(0.0, at + side * 10.0) for side in (-1, 1)]
        assert shares[0] == pytest.approx(shares[1], abs=3e-4)  # 20 Pa of 0.1 MPa
    assert fading_share(-1e-6, -1e5) == 1.0
    assert fading_share(RESIDUAL_LIFT, 0.0) == fading_share(-1e-6, RELAXED) == 0.0
