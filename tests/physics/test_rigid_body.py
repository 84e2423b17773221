"""Plunger and needle as one mass: the chain's loads, no deformation."""

from __future__ import annotations

import pytest

from commonrail.physics.components import plunger_needle, rigid_body
from commonrail.physics.components.plunger_needle import Loads, SeatContact
from commonrail.physics.injector import Injector

SEAT = SeatContact(2e8, 0.2)
LOAD = Loads(-2300.0, 7.0, -36.0, 1100.0, 420.0)


@pytest.fixture(scope="module")
def body(regulated: Injector) -> plunger_needle.Coefficients:
    return plunger_needle.coefficients(regulated.parameters.plunger_needle, 1e-6)


def test_it_falls_freely_by_force_over_mass(body: plunger_needle.Coefficients) -> None:
    masses = 0.894 + 0.592 + 0.602 + 0.692 + 0.690 + 1.564 + 0.870  # [g], as drawn
    force = sum(LOAD) - 35e3 * 50e-6
    a = rigid_body.accelerations(body, SEAT, 50e-6, 0.0, LOAD)
    assert a == pytest.approx(force / (masses * 1e-3), rel=1e-12)


def test_it_rests_where_seat_and_spring_balance_the_load(body: plunger_needle.Coefficients) -> None:
    start = s = rigid_body.at_rest(body, SEAT, LOAD)
    assert (SEAT.stiffness + 35e3) * start.z == pytest.approx(sum(LOAD), rel=1e-12)
    for _ in range(200):
        s = rigid_body.advance(body, SEAT, s, LOAD, 1e-6)
    assert s.z == pytest.approx(start.z, abs=1e-16)  # rounding


def test_stop_and_seat_turn_it_back(body: plunger_needle.Coefficients) -> None:
    free = Loads(0.0, 0.0, 0.0, 0.0, 0.0)
    assert rigid_body.accelerations(body, SEAT, 101e-6, 0.0, free) < -1e3 < 1e3
    assert rigid_body.accelerations(body, SEAT, -1e-6, 0.0, free) > 1e3


def test_all_lifts_are_one(body: plunger_needle.Coefficients) -> None:
    assert rigid_body.lifts(3e-5) == (3e-5, 3e-5, 3e-5)
