"""Lumped volume: its step against the exact exponential, for slow and for stiff volumes."""

from __future__ import annotations

import math

import pytest

from commonrail.physics.flow import mean_departure

STIFFNESS, VOLUME, DT, NET = 2.5e6, 18e-9, 1e-6, 0.02


def exact_mean(y: float) -> float:
    """Mean of p − p_n over a step of dp/dt = (K/ρV)(net − S (p − p_n)); y = dt S K/(ρ V)."""
    rate = DT * STIFFNESS / VOLUME * NET
    return rate * 0.5 if y == 0.0 else rate * (y - 1.0 + math.exp(-y)) / y**2


def departure(y: float) -> float:
    return mean_departure(NET, y * VOLUME / (DT * STIFFNESS), STIFFNESS, VOLUME, 0.0, DT)


@pytest.mark.parametrize("y", [0.0, 0.01, 0.03, 0.1])
def test_small_steps_are_second_order(y: float) -> None:
    # the rational form departs from φ2 by y²/72 of 1/2
    assert departure(y) == pytest.approx(exact_mean(y), rel=y**2 / 30 + 1e-12)


@pytest.mark.parametrize("y", [1e3, 1e5, 1e8])
def test_stiff_volumes_come_to_their_balance(y: float) -> None:
    balance = NET / (y * VOLUME / (DT * STIFFNESS))
    # exact: balance (1 − 1/y); the rational form agrees to the next order
    assert departure(y) == pytest.approx(balance * (1 - 1 / y), rel=10 / y**2 + 1e-14)


@pytest.mark.parametrize("y", [0.3, 1.0, 3.0, 10.0])
def test_in_between_it_stays_near_the_exponential(y: float) -> None:
    # the greatest departure over all y is 3.5 %, near y = 5: it limits accuracy, not stability
    assert departure(y) == pytest.approx(exact_mean(y), rel=0.04)


def test_a_growing_volume_swallows_flow() -> None:
    grown = mean_departure(NET, 1e-9, STIFFNESS, VOLUME, NET * DT, DT)
    assert grown == 0.0
