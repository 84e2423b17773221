"""From drawing to state at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from commonrail.physics import model
from commonrail.physics.components import plunger_needle, valve
from commonrail.physics.components.plunger_needle import Motion
from commonrail.physics.connections import a_hole, land_gap_cda2, plain_gap_cda2, seat_pressure, volumes_of
from commonrail.physics.flow import contents
from commonrail.physics.fuel_kernel import density, kinematic_viscosity
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.model import Coefficients, Setting
from commonrail.physics.variants import Variant, connections_of

AT = Setting(160e6, 5e6, 0.5e6, 1e-6)
SINE = math.sin(math.pi / 4)  # of the seat's angle in the fixture


@pytest.fixture(scope="module")
def c(regulated: Injector) -> Coefficients:
    fuel = fuel_coefficients(regulated.fuel, regulated.values[FUEL_TEMPERATURE])
    return model.coefficients(regulated.parameters, fuel, AT)


def test_delays_are_travel_times_in_steps(c: Coefficients, regulated: Injector) -> None:
    fuel, temperature = regulated.fuel, regulated.values[FUEL_TEMPERATURE]
    # the hot loop's polynomials: 1e-4
    assert c.delays.feed == pytest.approx(0.12 / float(fuel.sound_speed(160e6, temperature)) / 1e-6, rel=3e-4)
    assert c.delays.back == pytest.approx(1.0 / float(fuel.sound_speed(0.5e6, temperature)) / 1e-6, rel=3e-4)


def test_eddy_share_is_that_of_an_exponential(regulated: Injector, c: Coefficients) -> None:
    assert c.delays.rising_lag_fraction == 1.0
    slow = regulated.with_values({"solenoid.eddy_lag": 20e-6}).parameters
    lagging = model.coefficients(slow, c.fuel, AT)
    assert lagging.delays.rising_lag_fraction == pytest.approx(1.0 - math.exp(-1 / 20), rel=1e-12)


def test_tight_guides_leave_the_pressures_at_rest(c: Coefficients, regulated: Injector) -> None:
    tight = regulated.with_values({"plunger_needle.plunger_gap": 0.0, "plunger_needle.needle_gap": 0.0})
    s = connections_of(Variant()).rest(model.coefficients(tight.parameters, c.fuel, AT), AT)
    lifts = plunger_needle.lifts(s.body.z)
    assert lifts.tip < 0.0
    for held in (s.control_chamber.fuel, s.accumulation.fuel, s.rail):
        assert held.pressure == pytest.approx(160e6, rel=1e-11)  # rounding of a density
    assert s.sac.pressure == pytest.approx(5e6, rel=1e-10)
    # masses are those of the deformed chain's volumes
    assert s.control_chamber.fuel.mass / s.control_chamber.fuel.density == pytest.approx(
        18e-9 - math.pi / 4 * 4.3e-3**2 * lifts.top, rel=1e-12
    )


def test_valve_at_rest_balances_spring_pressure_and_seat(c: Coefficients, regulated: Injector) -> None:
    lift = valve.at_rest(c.valve, AT.rail - AT.low).lift
    area = math.pi / 4 * 0.5e-3**2
    stiffness = regulated.values["valve.contact_stiffness"]
    assert -stiffness * lift == pytest.approx(72.0 + 2e4 * lift - area * 159.5e6, rel=1e-9)


def test_a_rising_needle_moves_fuel_from_volume_to_volume(c: Coefficients) -> None:
    """Displaced volume of a rigid rise: plunger area from the control chamber, guide area to the needle's end."""
    rise = 50e-6
    before, after = volumes_of(c, Motion(0.0, 0.0, 0.0)), volumes_of(c, Motion(rise, rise, rise))
    quarter = math.pi / 4
    assert after.control - before.control == pytest.approx(-quarter * 4.3e-3**2 * rise, rel=1e-9)
    gained = after.accumulation - before.accumulation + after.sac - before.sac
    assert gained == pytest.approx(quarter * 4.0e-3**2 * rise, rel=1e-9)


def test_pressure_in_front_of_the_valve_seat(c: Coefficients) -> None:
    hole = a_hole(c.control_chamber, 160e6, 0.5e6)
    # shut: all of it; a gap as good as the hole: half; far open and cavitating: what the contraction leaves
    assert seat_pressure(c, hole, 0.0, 160e6, 0.5e6) == pytest.approx(159.5e6, rel=1e-12)
    assert seat_pressure(c, hole, hole.cda2, 2e6, 1e6) == pytest.approx(0.5e6, rel=1e-9)
    open_ = seat_pressure(c, hole, 50 * hole.cda2, 160e6, 0.5e6)
    cavitating = hole.choked * (160e6 - c.fuel.vapour_pressure) / (50 * hole.cda2)
    assert open_ == pytest.approx(min(159.5e6 / 51, cavitating), rel=1e-9)


def test_forces_of_the_closed_needle_follow_from_its_areas(c: Coefficients) -> None:
    load = plunger_needle.loads(c.plunger_needle.guides, c.needle_seat.area, AT.rail, AT.rail, AT.cylinder, AT.low)
    quarter = math.pi / 4 * 1e-6
    total = (
        -160e6 * quarter * 4.3**2
        + 0.5e6 * quarter * (4.3**2 - 16.0)
        - 30.0
        + 160e6 * quarter * (16.0 - 4.0)
        + 5e6 * quarter * 4.0
    )
    assert np.sum(load) == pytest.approx(total, rel=1e-9)


def with_land(injector: Injector, land: float) -> Coefficients:
    changed = injector.with_values({"valve.seat_land": land})
    fuel = fuel_coefficients(changed.fuel, changed.values[FUEL_TEMPERATURE])
    return model.coefficients(changed.parameters, fuel, AT)


def gap_at(c: Coefficients, gap: float, pressure: float, land: bool = True) -> float:
    """(c_d A)² at a gap normal to the cone."""
    here, hole = contents(c.fuel, density(c.fuel, pressure), 1.0), a_hole(c.control_chamber, pressure, 0.5e6)
    return (land_gap_cda2 if land else plain_gap_cda2)(c, hole, here, 0.5e6, gap / SINE)


@pytest.mark.parametrize("pressure", [40e6, 160e6])
@pytest.mark.parametrize("gap", [0.1e-6, 1e-6, 3e-6, 10e-6, 30e-6])
def test_land_of_the_valve_is_a_film_in_series_with_its_orifice(
    regulated: Injector, gap: float, pressure: float
) -> None:
    """Flow through A-hole, film and gap against the root of Δp(q), solved without the closed form."""
    c, p = with_land(regulated, 100e-6), regulated.parameters.valve
    rho, hole = density(c.fuel, pressure), c.control_chamber
    film = 12.0 * kinematic_viscosity(c.fuel, 0.5 * (pressure + 0.5e6)) * 100e-6 / (math.pi * p.seat_diameter * gap**3)
    section = (p.seat_discharge * math.pi * p.seat_diameter * gap) ** 2

    def missing(q: float) -> float:
        return q * q / (2.0 * rho) * (1.0 / section + 1.0 / hole.a_cda2) + film * q - (pressure - 0.5e6)

    flow = min(
        brentq(missing, 0.0, 1.0, xtol=1e-18, rtol=1e-14),
        math.sqrt(2.0 * rho * hole.a_cda2_choked * (pressure - c.fuel.vapour_pressure)),
    )
    effective = 1.0 / (1.0 / section + 2.0 * rho * film / flow)
    assert gap_at(c, gap, pressure) == pytest.approx(effective, rel=1e-9)


def test_without_a_land_the_gap_is_that_of_eq_4(regulated: Injector) -> None:
    c = with_land(regulated, 0.0)
    for gap in (-1e-6, 0.0, 1e-9, 3e-6):
        assert gap_at(c, gap, 160e6) == gap_at(c, gap, 160e6, land=False)


def test_a_tiny_gap_over_a_land_passes_as_its_cube_and_shuts(regulated: Injector) -> None:
    c = with_land(regulated, 100e-6)
    # c_d A ∝ h³; of the orifice's loss 1e-4 remain at 10 nm
    assert math.sqrt(gap_at(c, 20e-9, 160e6) / gap_at(c, 10e-9, 160e6)) == pytest.approx(8.0, rel=1e-3)
    assert gap_at(c, 0.0, 160e6) == gap_at(c, -1e-6, 160e6) == 0.0


def test_land_throttles_more_at_a_lower_pressure_and_with_a_longer_land(regulated: Injector) -> None:
    def factor(land: float, pressure: float) -> float:
        c = with_land(regulated, land)
        return math.sqrt(gap_at(c, 3e-6, pressure) / gap_at(c, 3e-6, pressure, land=False))

    assert factor(200e-6, 160e6) < 0.7 * factor(100e-6, 160e6)
    assert factor(100e-6, 40e6) < factor(100e-6, 160e6)
