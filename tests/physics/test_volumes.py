"""Contents of the volumes, and their sizes with a moving needle."""

from __future__ import annotations

import math

import pytest

from commonrail.physics.components import control_chamber, needle_seat
from commonrail.physics.flow import contents, contents_at
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.readers.fuel import load_fuel

FUEL = fuel_coefficients(load_fuel("iso4113"), 353.15)


@pytest.mark.parametrize("pressure", [0.1e6, 5e6, 80e6, 180e6])
def test_a_filled_volume_has_the_pressure_it_was_filled_to(pressure: float) -> None:
    held = contents_at(FUEL, pressure, 18e-9)
    # density is found to rounding: 1e-16 of it is 3e-7 Pa of 1 GPa
    assert held.pressure == pytest.approx(pressure, rel=1e-11, abs=1e-5)
    assert held.mass == pytest.approx(held.density * 18e-9, rel=1e-14)


def test_a_volume_drawn_empty_holds_vapour_and_remembers_what_is_missing() -> None:
    full = contents_at(FUEL, 0.1e6, 18e-9)
    cavity = contents(FUEL, 0.9 * full.mass, 18e-9)
    assert cavity.pressure == FUEL.vapour_pressure
    assert cavity.stiffness == 0.0
    assert contents(FUEL, cavity.mass + 0.1 * full.mass, 18e-9).pressure == pytest.approx(0.1e6, rel=1e-6)


def test_a_flattened_seat_makes_no_room_in_the_sac() -> None:
    p = needle_seat.SacParameters(0.8e-9)
    assert needle_seat.sac_volume(p, math.pi * 1e-6, -4e-6) == 0.8e-9
    assert needle_seat.sac_volume(p, math.pi * 1e-6, 100e-6) == pytest.approx(0.8e-9 + 0.1e-9 * math.pi, rel=1e-12)


def test_holes_of_the_control_chamber() -> None:
    p = control_chamber.Parameters(18e-9, 0.215e-3, 0.78, 0.85, 1.0, 0.26e-3, 0.82, 0.81, 10.0)
    c = control_chamber.coefficients(p, 2e-3)
    z, a = math.pi / 4 * 0.215e-3**2, math.pi / 4 * 0.26e-3**2
    assert (c.z_cda2, c.z_cda2_choked) == pytest.approx(((0.78 * z) ** 2, (0.85 * z) ** 2), rel=1e-12)
    assert (c.a_cda2, c.a_cda2_choked) == pytest.approx(((0.82 * a) ** 2, (0.81 * a) ** 2), rel=1e-12)
