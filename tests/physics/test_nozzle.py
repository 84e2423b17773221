"""Discharge coefficient of the nozzle, Eq. (9), branch by branch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from commonrail.physics.components import nozzle

RAIL = 160e6
KNOTS = (40e-6, 90e-6, 150e-6, 230e-6, 340e-6, 0.0, 0.0, 0.0)
LIFTS = (0.0, 20e-6, 40e-6, 66e-6, 90e-6, 121e-6, 200e-6, 231e-6, 340e-6, 1e-3)  # below, on, between, above knots
P = nozzle.Parameters(
    7.0, 0.13e-3, 0.55, 0.82, 0.85, 0.25e-12, 180e-6, 0.05e-12, 52e-6, 10.0, 0.0, 15e-6, *KNOTS, *[0.0] * 8
)
C = nozzle.coefficients(P, RAIL, 2e-3)
KNEE = 0.05e-12 * RAIL + 52e-6  # z0 = K3 p + K4 = 60 um
TOP = 0.25e-12 * RAIL + 180e-6  # zM = K1 p + K2 = 220 um


def equation_9(z: float) -> float:
    if z <= KNEE:
        return P.discharge_transition * math.sin(math.pi * z / (2 * KNEE))
    return P.discharge_transition + (P.discharge_maximum - P.discharge_transition) * (z - KNEE) / (TOP - KNEE)


@pytest.mark.parametrize("lift", [2e-6, 30e-6, 59.9e-6, 60.1e-6, 140e-6, 219e-6])
def test_opening_follows_equation_9(lift: float) -> None:
    # the sine's polynomial: 4e-6
    assert nozzle.discharge(C, lift) == pytest.approx(equation_9(lift), abs=4e-6)


def test_both_branches_meet_at_the_transition() -> None:
    below, above = (nozzle.discharge(C, KNEE + d) for d in (-1e-12, 1e-12))
    assert below == pytest.approx(P.discharge_transition, abs=4e-6)
    assert above == pytest.approx(below, abs=1e-8)


def test_beyond_the_maximum_it_stays() -> None:
    assert nozzle.discharge(C, 2 * TOP) == nozzle.discharge(C, TOP)
    assert nozzle.discharge(C, TOP) == pytest.approx(P.discharge_maximum, abs=4e-6)  # the sine's polynomial


def test_a_shut_needle_leaves_the_holes_open_a_little() -> None:
    assert nozzle.discharge(C, 0.0) == nozzle.discharge(C, nozzle.RESIDUAL_LIFT) > 0.0


def test_quarter_sine_is_within_its_stated_error() -> None:
    s = np.linspace(0.0, 1.0, 2001)
    error = np.abs([nozzle.quarter_sine(x) for x in s] - np.sin(np.pi * s / 2))
    assert 3e-6 < error.max() < 4e-6


def test_area_is_that_of_all_holes() -> None:
    assert C.area_squared == pytest.approx((7 * math.pi * 0.13e-3**2 / 4) ** 2, rel=1e-14)


def shaped(*values: float, **others: float) -> nozzle.Coefficients:
    changes = {f"shape_{i}": value for i, value in enumerate(values, start=1)}
    return nozzle.coefficients(P._replace(**changes, **others), RAIL, 2e-3)


@pytest.mark.parametrize("lift", LIFTS)
def test_shape_is_linear_between_its_knots_and_constant_outside(lift: float) -> None:
    values = (-0.28, 0.07, -0.14, -0.2, -0.08)
    factor = 1.0 + np.interp(lift, KNOTS[:5], values)
    # 1e-12: slopes of 1e4/m summed over 1 mm, in rounding
    found = nozzle.shaped_discharge(shaped(*values), lift)
    assert found == pytest.approx(nozzle.discharge(C, lift) * factor, rel=1e-12)


@pytest.mark.parametrize("lift", LIFTS)
def test_all_eight_knots_act(lift: float) -> None:
    knots = [25e-6 * i for i in range(1, 9)]
    values = (0.1, -0.1, 0.2, -0.2, 0.3, -0.3, 0.4, -0.4)
    c = shaped(*values, **{f"knot_{i}": knot for i, knot in enumerate(knots, start=1)})
    factor = 1.0 + np.interp(lift, knots, values)
    assert nozzle.shaped_discharge(c, lift) == pytest.approx(nozzle.discharge(C, lift) * factor, rel=1e-12)


def test_the_value_of_a_knot_that_is_not_used_is_ignored() -> None:
    values = (0.1, 0.1, 0.1, 0.1, 0.2)
    for lift in LIFTS:
        expected = nozzle.shaped_discharge(shaped(*values), lift)
        assert nozzle.shaped_discharge(shaped(*values, 0.9, -0.9, 0.5), lift) == expected


@pytest.mark.parametrize("lift", LIFTS)
def test_without_a_shape_it_is_equation_9_to_the_bit(lift: float) -> None:
    assert nozzle.shaped_discharge(C, lift) == nozzle.discharge(C, lift)


def test_knots_in_the_wrong_order_are_moved_apart() -> None:
    c = shaped(0.1, -0.1, 0.2, knot_2=10e-6, knot_3=10e-6)
    knots = np.array(c.shape.knots)
    assert np.all(np.diff(knots) >= 0.99e-6)
    assert np.isfinite([nozzle.shaped_discharge(c, lift) for lift in LIFTS]).all()


def test_growth_changes_the_greatest_discharge_with_rail_pressure_above_10_mpa() -> None:
    growth = 2e-10
    for rail in (10e6, RAIL):
        plain, grown = (nozzle.coefficients(P._replace(discharge_growth=g), rail, 2e-3) for g in (0.0, growth))
        full, knee = 1e-3, plain.lift_transition
        rise = nozzle.discharge(grown, full) - nozzle.discharge(plain, full)
        assert rise == pytest.approx(growth * (rail - 10e6), abs=1e-15)
        assert nozzle.discharge(grown, 0.5 * knee) == nozzle.discharge(plain, 0.5 * knee)


def test_a_growth_that_leaves_nothing_of_the_discharge_shuts_the_holes() -> None:
    c = nozzle.coefficients(P._replace(discharge_growth=-1e-7), RAIL, 2e-3)
    assert nozzle.discharge(c, 1e-3) == pytest.approx(0.0, abs=4e-6)  # the sine's polynomial


@pytest.mark.parametrize("growth", [4.9e-9, 1e-7])
def test_no_growth_lifts_the_discharge_above_one(growth: float) -> None:
    c = nozzle.coefficients(P._replace(discharge_growth=growth), RAIL, 2e-3)
    assert nozzle.discharge(c, 1e-3) == pytest.approx(1.0, abs=4e-6)  # the sine's polynomial


def test_no_shape_lifts_the_discharge_above_one() -> None:
    found = [nozzle.shaped_discharge(shaped(0.9, 0.9, 0.9, 0.9, 0.9), lift) for lift in LIFTS]
    assert max(found) == 1.0
