"""Discharge coefficient of the nozzle, Eq. (9), branch by branch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from commonrail.parts import nozzle

RAIL = 160e6
P = nozzle.Parameters(7.0, 0.13e-3, 0.55, 0.82, 0.85, 0.25e-12, 180e-6, 0.05e-12, 52e-6, 10.0)
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
