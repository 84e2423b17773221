"""Valve: forces by hand, gap of its seat."""

from __future__ import annotations

import math

import pytest

from commonrail.parts import valve

P = valve.Parameters(5e-3, 55e-6, 72.0, 2e4, 0.5, 0.5e-3, math.pi / 4, 0.8, 1e8, 1.0)
C = valve.coefficients(P)


def test_between_seat_and_stop_only_springs_pull_and_pressure_act() -> None:
    force, damping = valve.forces(C, 20e-6, 100.0, 50e6)
    # 100 − 72 − 2e4 · 20e-6 + 50e6 · π/4 · (0.5e-3)²
    assert force == pytest.approx(100.0 - 72.0 - 0.4 + 9.817477, rel=1e-7)
    assert damping == 0.5


def test_seat_and_stop_push_back() -> None:
    seat, seat_damping = valve.forces(C, -1e-6, 0.0, 0.0)
    assert seat == pytest.approx(100.0 - 72.0 + 0.02, rel=1e-12)
    assert seat_damping == pytest.approx(100.5)
    stop, _ = valve.forces(C, 56e-6, 0.0, 0.0)
    assert stop == pytest.approx(-100.0 - 72.0 - 1.12, rel=1e-9)


def test_gap_is_a_thin_cone_and_shut_below_the_seat() -> None:
    area = 0.8 * math.pi * 0.5e-3 * 30e-6 * math.sin(math.pi / 4)
    assert valve.gap_drive(C, 30e-6) == pytest.approx(area**2, rel=1e-12)
    assert valve.gap_drive(C, -1e-6) == 0.0
