"""Drive: share of the schedule in a step, regulator's limits, switching inside the step."""

from __future__ import annotations

import math

import pytest

from commonrail.parts import drive, solenoid

P = drive.Parameters(65.0, 14.0, 19.0, 350e-6, 12.0, 14.0, 2.0, 2.0, 100.0)
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
        rate = drive.regulated(P, COIL, drive.State(1.0), supply, now, DT).flux_rate
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
        rate = drive.pwm(P, COIL, drive.State(conducting), ON, circuit(19.0), 1e-8)
        assert rate.conducting == conducting
        assert 30.0 * rate.flux_rate + 0.2 * 19.0 == pytest.approx(volts, rel=1e-12)


def test_pwm_off_forgets_its_transistor() -> None:
    off = drive.Supply(drive.Schedule(0.0, 0.0), 0.0)
    assert drive.pwm(P, COIL, drive.State(0.0), off, circuit(5.0), DT).conducting == 2.0


def test_decay_is_minus_the_slope_of_the_flux_rate() -> None:
    h = 1e-4
    for law in (drive.regulated, drive.current_trace, drive.voltage_trace):
        supply = drive.Supply(drive.Schedule(1.0, 1.0), 19.0)
        ahead, behind = (law(P, COIL, drive.State(1.0), supply, circuit(18.95 + s), DT).flux_rate for s in (h, -h))
        decay = law(P, COIL, drive.State(1.0), supply, circuit(18.95), DT).decay
        assert decay == pytest.approx((behind - ahead) / (2 * h * PER_AMPERE), rel=1e-6), law


def test_regulator_starts_and_switches_inside_a_step() -> None:
    """A start 0.4 us before a step's end boosts for 0.4 us: not for none, not for a whole step."""

    def rate(schedule: drive.Schedule, current: float) -> float:
        now = circuit(current)
        return drive.regulated(P, COIL, drive.State(1.0), drive.Supply(schedule, 0.0), now, DT).flux_rate

    assert rate(drive.Schedule(0.4, 0.4), 0.0) == pytest.approx(0.4 * rate(drive.Schedule(1.0, 1.0), 0.0), rel=1e-12)
    peak, hold, off = ((1.0, 1.0), (1.0, 0.0), (0.0, 0.0))
    shares = 0.3 * rate(drive.Schedule(*peak), 16.0) + 0.7 * rate(drive.Schedule(*hold), 16.0)
    assert rate(drive.Schedule(1.0, 0.3), 16.0) == pytest.approx(shares, rel=1e-12)
    shares = 0.2 * rate(drive.Schedule(*hold), 12.0) + 0.8 * rate(drive.Schedule(*off), 12.0)
    assert rate(drive.Schedule(0.2, 0.0), 12.0) == pytest.approx(shares, rel=1e-12)
