"""Pipe: impedance and friction against the textbook forms."""

from __future__ import annotations

import math

import pytest

from commonrail.physics.flow import friction_resistance, impedance, pipe_area


def test_a_travelling_wave_obeys_joukowsky() -> None:
    density, speed, diameter, velocity = 860.0, 1700.0, 2.5e-3, 3.0
    area = math.pi * diameter**2 / 4
    pressure = impedance(speed, pipe_area(diameter)) * density * area * velocity
    assert pressure == pytest.approx(density * speed * velocity, rel=1e-14)


def test_friction_is_darcy_weisbach() -> None:
    density, diameter, length, factor, velocity = 860.0, 2.5e-3, 1.2, 0.03, 5.0
    flow = density * math.pi * diameter**2 / 4 * velocity
    loss = friction_resistance(factor, length, diameter, density) * flow**2
    assert loss == pytest.approx(factor * length / diameter * density * velocity**2 / 2, rel=1e-13)
