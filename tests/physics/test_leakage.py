"""Leakage through a guide, Eq. (5)."""

from __future__ import annotations

import pytest

from commonrail.physics.flow import gap_conductance, leakage_slope


def test_a_number_worked_out_by_hand() -> None:
    # d = 4 mm, g = 2.5 um, l = 20 mm:  π · 4e-3 · 15.625e-18 / 0.24 = 8.18123e-19 m³
    conductance = gap_conductance(4e-3, 2.5e-6, 20e-3)
    assert conductance == pytest.approx(8.18123e-19, rel=1e-6)  # six digits were worked out
    # ν = 2 mm²/s, Δp = 160 MPa:  8.18123e-19 / 2e-6 · 160e6 = 6.54498e-5 kg/s
    assert leakage_slope(conductance, 1.0 / 2e-6) * 160e6 == pytest.approx(6.54498e-5, rel=1e-6)


def test_it_grows_with_the_cube_of_the_gap() -> None:
    assert gap_conductance(4e-3, 5e-6, 20e-3) == pytest.approx(8 * gap_conductance(4e-3, 2.5e-6, 20e-3), rel=1e-14)
