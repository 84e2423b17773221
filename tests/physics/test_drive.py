"""Drive: share of the schedule in a step, regulator's limits, switching inside the step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from commonrail.physics.components import drive, solenoid

P = drive.Parameters(65.0, 14.0, 19.0, 350e-6, 12.0, 14.0, 2.0, 2.0, 100.0, 0.7)
COIL = solenoid.coefficients(solenoid.Parameters(30.0, 0.2, 70e-6, 50e-6, 2.0, 0.0, 2000.0, 1.4, 0.0))
PER_AMPERE = 30.0 * 4e-7 * math.pi * 70e-6 / (2 * 105e-6)  # flux per ampere, no iron, armature down
GAP = 55e-6
DT = 1e-6
ON = drive.Supply(drive.Schedule(1.0, 1.0), 0.0)


def circuit(current: float) -> solenoid.Circuit:
    return solenoid.circuit(COIL, PER_AMPERE * current, GAP)


def test_schedule_is_the_share_of_the_step() -> None:
    assert drive.schedule(P, -2e-6, -700e-6, DT) == (0.0, 0.0)
    assert drive.schedule(P, -0.25e-6, -700e-6, DT) == pytest.approx((0.75, 0.75))
    assert drive.schedule(P, 100e-6, -600e-6, DT) == (1.0, 1.0)
    assert drive.schedule(P, 349.6e-6, -350e-6, DT) == pytest.approx((1.0, 0.4))
    assert drive.schedule(P, 699.7e-6, -0.3e-6, DT) == pytest.approx((0.3, 0.0))
    assert drive.schedule(P, 800e-6, 100e-6, DT) == (0.0, 0.0)


def test_an_energising_shorter_than_the_peak_ends_it() -> None:
    assert drive.schedule(P, 199.8e-6, -0.2e-6, DT) == pytest.approx((0.2, 0.2))


def test_regulator_boosts_holds_and_quenches() -> None:
    def voltage(current: float, on: float, peak: float) -> float:
        supply = drive.Supply(drive.Schedule(on, peak), 0.0)
        now = circuit(current)
        rate = drive.current_regulator(
            P, COIL, drive.State(1.0), supply, now, 0.0
        ).flux_rate  # a step without length: at once
        return 30.0 * rate + 0.2 * now.current

    assert voltage(2.0, 1.0, 1.0) == pytest.approx(65.0)  # far below: boost
    assert voltage(19.0, 1.0, 1.0) == pytest.approx(0.2 * 19.0)  # there: R i
    assert voltage(19.0, 1.0, 0.0) == pytest.approx(-14.0)  # must fall to hold: quench
    assert voltage(12.0, 0.0, 0.0) == pytest.approx(-65.0)  # after the end: −boost
    assert voltage(0.0, 0.0, 0.0) == pytest.approx(0.0)  # and no further than zero current


def test_pwm_switches_off_where_the_current_meets_its_limit() -> None:
    # 30 V/wb...: current rises by (65 − 0.2 i) dt/L in a step; start half that below the limit of 20 A
    inductance = 30.0 * PER_AMPERE
    rise = (65.0 - 0.2 * 20.0) / inductance * DT
    rate = drive.pwm(P, COIL, drive.State(2.0), ON, circuit(20.0 - 0.5 * rise), DT)
    assert rate.conducting == 0.0
    # half a step of +65 V, half of −14 V; relaxation moves the instant by dt R/L, 1 %
    mean = 30.0 * rate.flux_rate + 0.2 * (20.0 - 0.5 * rise)
    assert mean == pytest.approx(0.5 * 65.0 - 0.5 * 14.0, rel=0.02)


def test_pwm_keeps_its_transistor_within_the_band() -> None:
    for conducting, volts in ((2.0, 65.0), (1.0, 14.0), (0.0, -14.0)):
        rate = drive.pwm(P, COIL, drive.State(conducting), ON, circuit(19.0), 0.0)
        assert rate.conducting == conducting
        assert 30.0 * rate.flux_rate + 0.2 * 19.0 == pytest.approx(volts, rel=1e-12)


def test_pwm_off_forgets_its_transistor() -> None:
    off = drive.Supply(drive.Schedule(0.0, 0.0), 0.0)
    assert drive.pwm(P, COIL, drive.State(0.0), off, circuit(5.0), DT).conducting == 2.0


@pytest.mark.parametrize("current", [18.95, 12.0])
def test_decay_is_minus_the_slope_of_the_flux_rate(current: float) -> None:
    h = 1e-4
    laws = (
        lambda now: drive.apply_voltage(COIL, 14.0, now),
        lambda now: drive.quench(P, COIL, now),
        lambda now: drive._towards(COIL, 19.0, 100.0, -1e9, 1e9, now),
    )
    for law in laws:
        ahead, behind = (law(circuit(current + s)).flux_rate for s in (h, -h))
        assert law(circuit(current)).decay == pytest.approx((behind - ahead) / (2 * h * PER_AMPERE), rel=1e-6)


def test_regulator_starts_inside_a_step() -> None:
    """A start 0.4 us before a step's end boosts for 0.4 us: not for none, not for a whole step."""

    def rate(schedule: drive.Schedule) -> float:
        return drive.current_regulator(
            P, COIL, drive.State(1.0), drive.Supply(schedule, 0.0), circuit(0.0), 0.0
        ).flux_rate

    assert rate(drive.Schedule(0.4, 0.4)) == pytest.approx(0.4 * rate(drive.Schedule(1.0, 1.0)), rel=1e-12)


def exact_step(flux: float, end: float, closing: float) -> float:
    """Flux after a step of the ideal regulator that holds until `end`, by 20,000 steps; the gap closes steadily."""

    def rate(flux: float, part: float) -> float:
        now = solenoid.circuit(COIL, flux, GAP + closing * (1.0 - 2.0 * part))
        holding = drive._towards(COIL, 12.0, 100.0, -14.0, 65.0, now)
        return (holding if part * DT < end else drive.quench(P, COIL, now)).flux_rate

    parts = 20_000
    for k in range(parts):
        middle = flux + 0.5 * DT / parts * rate(flux, (k + 0.5) / parts)
        flux += DT / parts * rate(middle, (k + 0.5) / parts)
    return flux


@pytest.mark.parametrize("law", [drive.current_regulator, drive.pwm])
def test_what_ends_inside_a_step_does_not_damp_what_begins_there(law: Any) -> None:
    """Holding, the flux relaxes to its balance at 0.5 per step; off, −65 V takes it down and hardly relaxes.

    With one relaxation for both, the flux fell by 20 per cent less in the step in which energising ends.
    """
    end = 0.3e-6
    start = PER_AMPERE * 12.0
    schedule = drive.Schedule(end / DT, 0.0)
    rate = law(P, COIL, drive.State(0.0), drive.Supply(schedule, 0.0), circuit(12.0), DT).flux_rate
    expected = exact_step(start, end, 0.0) - start
    if law is drive.pwm:  # its transistor is off meanwhile: −14 V
        expected = (end * (-14.0 - 0.2 * 12.0) + (DT - end) * (-65.0 - 0.2 * 12.0)) / 30.0
    # second order: the current that the second part starts from moved by 4 %, times R = 0.2 ohm of 65 V
    assert DT * rate == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("closing", [0.0, 0.4e-6, -0.4e-6])
def test_a_closing_gap_takes_its_share_from_the_current(closing: float) -> None:
    """Balance of the regulator with an armature at 0.8 m/s: the flux follows to 2 % of what the gap moved it."""
    start = PER_AMPERE * 12.0
    now = solenoid.circuit(COIL, start, GAP, closing)
    supply = drive.Supply(drive.Schedule(1.0, 0.0), 0.0)
    change = DT * drive.current_regulator(P, COIL, drive.State(1.0), supply, now, DT).flux_rate
    expected = exact_step(start, 2 * DT, closing) - start
    moved = abs(start * COIL.gap_reluctance * 0.8e-6 * COIL.per_turn / now.slope)
    # without the drift of the current the error is y/6 of a half of it, 4 %
    assert change == pytest.approx(expected, abs=0.006 * moved)


def test_pwm_compares_the_current_where_the_step_begins_and_ends() -> None:
    """At a constant flux, a gap that opens raises the current over its limit within the step, one at rest does not."""
    below = 19.99  # the limit is 20 A; 0.4 um more gap raise 19.99 A by some 0.08 A
    level = (0.2 * below) / 14.0
    still = P._replace(supply_voltage=14.0 * level)  # holds the flux
    at_rest = drive.pwm(still, COIL, drive.State(1.0), ON, solenoid.circuit(COIL, PER_AMPERE * below, GAP), DT)
    opening = drive.pwm(still, COIL, drive.State(1.0), ON, solenoid.circuit(COIL, PER_AMPERE * below, GAP, -0.4e-6), DT)
    assert (at_rest.conducting, opening.conducting) == (1.0, 0.0)


@pytest.mark.parametrize(("conducting", "band", "closing"), [(1.0, 5.0, 0.4e-6), (0.0, 30.0, -0.4e-6)])
def test_pwm_that_begins_beyond_its_limit_switches_at_once(conducting: float, band: float, closing: float) -> None:
    """10 A, the band far below or above, and a moving gap that takes the current towards it."""
    moved = P._replace(peak_current=band, supply_voltage=1.0, quench_voltage=1.0)
    now = solenoid.circuit(COIL, PER_AMPERE * 10.0, GAP, closing)
    found = drive.pwm(moved, COIL, drive.State(conducting), ON, now, DT)
    other = drive.pwm(moved, COIL, drive.State(1.0 - conducting), ON, now, DT)
    assert found.conducting == other.conducting == 1.0 - conducting
    assert found.flux_rate == pytest.approx(other.flux_rate, rel=1e-12)


def test_free_wheeling_current_decays_through_resistance_and_diode() -> None:
    """L di/dt = −R i − V_d from 12 A to zero, where it stays, against the closed form."""
    inductance, current, course = 30.0 * PER_AMPERE, 12.0, []
    off = drive.Supply(drive.Schedule(0.0, 0.0), 0.0)
    for _ in range(4000):
        course.append(current)
        change = drive.free_wheel(P, COIL, drive.State(1.0), off, circuit(current), DT)
        current += DT * change.flux_rate / PER_AMPERE
    time = DT * np.arange(4000)
    exact = (12.0 + 0.7 / 0.2) * np.exp(-0.2 / inductance * time) - 0.7 / 0.2
    flowing = exact > 0.5  # [A]; below it the regulator rounds the end off
    assert 2000 < flowing.sum() < 3500
    # 2e-4: one step's decay y = dt R/L is 0.01, and its mean is of second order in y
    assert np.array(course)[flowing] == pytest.approx(exact[flowing], rel=2e-4, abs=2e-3)
    assert 0.0 <= current < 1e-6


def test_a_free_wheel_applies_no_voltage_backwards() -> None:
    def voltage(current: float, on: float, peak: float) -> float:
        now = circuit(current)
        supply = drive.Supply(drive.Schedule(on, peak), 0.0)
        return 30.0 * drive.free_wheel(P, COIL, drive.State(1.0), supply, now, 0.0).flux_rate + 0.2 * now.current

    assert voltage(2.0, 1.0, 1.0) == pytest.approx(65.0)  # it rises as any regulator's
    assert voltage(19.0, 1.0, 0.0) == pytest.approx(-0.7)  # peak to hold
    assert voltage(12.0, 0.0, 0.0) == pytest.approx(-0.7)  # after the end
