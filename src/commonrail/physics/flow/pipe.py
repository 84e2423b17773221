"""Pressure waves in a pipe, Eq. (6), by characteristics.

With a and ρ constant along the pipe, p ± (a/A) q is carried unchanged along dx = ±a dt but for
friction. A pipe is then two delay lines of L/a: what leaves one end arrives at the other. Friction,
∫ ρ f u|u|/(2D) dx, is integrated by Simpson's rule in `feed_pipe`: 1/6 where a wave leaves, 4/6 in mid-pipe, 1/6
where it arrives.
"""

from __future__ import annotations

from math import pi

from commonrail.physics.law import physics


@physics
def pipe_area(diameter: float) -> float:
    """Cross-section A of a round bore [m²]; `diameter`: D [m]."""
    return 0.25 * pi * diameter * diameter


@physics
def impedance(sound_speed: float, area: float) -> float:
    """Z = a/A, pressure per mass flow of a travelling wave [Pa s/kg] (Joukowsky: Δp = ρ a Δu).

    `sound_speed`: a [m/s]; `area`: A [m²], > 0.
    """
    return sound_speed / area


@physics
def friction_resistance(friction_factor: float, length: float, diameter: float, density: float) -> float:
    """f L/(2 D ρ A²), pressure loss of the whole pipe per q|q| in Eq. (6) [Pa s²/kg²].

    `friction_factor`: Darcy's f [1], ≥ 0, constant; `length`, `diameter`: L and D of the pipe [m]; `density`: ρ
    [kg/m³], constant along the pipe.
    """
    area = pipe_area(diameter)
    return friction_factor * length / (2.0 * diameter * density * area * area)
