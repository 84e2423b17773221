"""Usual ranges of parameters: what is plausible for a built injector."""

from __future__ import annotations

import pytest

from commonrail.physics.law import Domain, Q

LIFT = Q("m", "lift", usual=(20e-6, 5e-3))
SLOPE = Q("m/Pa", "slope", Domain.ANY, usual=(-1e-10, 2e-10))
LAG = Q("s", "lag", Domain.NON_NEGATIVE, usual=(1e-6, 1e-3))


@pytest.mark.parametrize(
    ("quantity", "value", "slack", "usual"),
    [
        (LIFT, 20e-6, 1.0, True),
        (LIFT, 19e-6, 1.0, False),
        (LIFT, 19e-6, 2.0, True),
        (LIFT, 9e-6, 2.0, False),
        (LIFT, 9e-3, 2.0, True),
        (SLOPE, -1.5e-10, 1.0, False),
        (SLOPE, -1.5e-10, 2.0, True),  # a negative limit widens downwards
        (LAG, 0.0, 1.0, True),  # zero switches the effect off
        (LAG, 1e-9, 1.0, False),
        (Q("1", "share"), 1e9, 1.0, True),
    ],
)
def test_usual_range_with_slack(quantity: Q, value: float, slack: float, usual: bool) -> None:
    assert quantity.is_usual(value, slack) is usual
