"""Orifice: Eq. (4) far above the transition, the stated loss law everywhere, and its exact slope."""

from __future__ import annotations

import math

import pytest

from commonrail.physics.flow import Restriction, jet, laminar_offset, limit_by_cavitation, orifice, series

DENSITY = 850.0
VISCOSITY = 2e-3  # dynamic [Pa s]
DIAMETER = 0.13e-3
AREA = math.pi * DIAMETER**2 / 4
DISCHARGE = 0.8
CDA2 = (DISCHARGE * AREA) ** 2
OFFSET = laminar_offset(VISCOSITY, 10.0, AREA / DIAMETER)


def turbulent(pressure_drop: float) -> float:
    """Eq. (4) times the density."""
    return math.copysign(DISCHARGE * AREA * math.sqrt(2 * DENSITY * abs(pressure_drop)), pressure_drop)


def test_far_above_the_transition_it_is_equation_4() -> None:
    drop = 100e6
    flow = jet(CDA2 * drop, DENSITY, OFFSET).mass_flow
    # what is left is q_h, here 0.02 % of the flow, and half its square, 2e-8
    assert flow == pytest.approx(turbulent(drop) - OFFSET, rel=1e-7)
    assert flow == pytest.approx(turbulent(drop), rel=5e-4)


@pytest.mark.parametrize("drop", [1.0, 1e3, 1e5, 1e8])
def test_flow_obeys_the_stated_loss_law(drop: float) -> None:
    flow = jet(CDA2 * drop, DENSITY, OFFSET).mass_flow / DENSITY
    transition = 2 * OFFSET / DENSITY
    loss = DENSITY * flow**2 / (2 * CDA2) * (1 + transition / flow)
    # rounding: at 1 Pa the root less the offset cancels 5 of 16 digits
    assert loss == pytest.approx(drop, rel=1e-9)


def test_both_losses_are_equal_at_the_transition_reynolds_number() -> None:
    speed = 2 * OFFSET / (DENSITY * AREA)
    assert DENSITY * speed * DIAMETER / VISCOSITY == pytest.approx(10.0, rel=1e-12)


@pytest.mark.parametrize("drop", [3.0, 2e4, 7e7])
def test_it_is_odd(drop: float) -> None:
    forth, back = (orifice(Restriction(sign * CDA2 * drop, CDA2), DENSITY, OFFSET) for sign in (1.0, -1.0))
    assert forth.mass_flow == -back.mass_flow > 0.0
    assert forth.slope == back.slope


@pytest.mark.parametrize("drop", [-5e7, -2e3, 0.0, 1e2, 3e5, 1e8])
def test_slope_is_the_derivative(drop: float) -> None:
    step = 1e-4 * abs(drop) or 1e-5  # at zero the curvature jumps: a small step
    ahead, behind = (jet(CDA2 * (drop + s), DENSITY, OFFSET).mass_flow for s in (step, -step))
    # central difference: truncation (h/p)²/8 of 1e-9 (at zero 5e-7), rounding 1e-8
    slope = orifice(Restriction(CDA2 * drop, CDA2), DENSITY, OFFSET).slope
    assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


def test_a_cavitating_orifice_does_not_feel_the_pressure_behind_it() -> None:
    before, vapour, contraction = 100e6, 2e3, 0.82
    limit = (contraction * AREA) ** 2
    cda2 = (1.0 * AREA) ** 2  # a rounded hole would pass more than the contraction lets through
    cavitating = Restriction(limit * (before - vapour), limit)
    low, high = (limit_by_cavitation(Restriction(cda2 * (before - p), cda2), cavitating) for p in (1e5, 20e6))
    assert low == high == cavitating
    free = Restriction(cda2 * 1e6, cda2)
    assert limit_by_cavitation(free, cavitating) == free


def test_series_shares_the_pressure_drop_so_that_both_pass_the_same() -> None:
    first, second, drop = 3e-16, 5e-16, 40e6
    total = jet(series(first, second) * drop, DENSITY, 1e-12).mass_flow
    between = drop * second / (first + second)  # what the first leaves in front of the second, reversed
    assert total == pytest.approx(jet(first * between, DENSITY, 1e-12).mass_flow, rel=1e-9)
    assert total == pytest.approx(jet(second * (drop - between), DENSITY, 1e-12).mass_flow, rel=1e-9)
    assert series(first, 0.0) == 0.0
