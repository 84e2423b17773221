"""Pressure waves in a pipe, Eq. (6), by characteristics.

With a and ρ constant along the pipe, p ± (a/A) q is carried unchanged along dx = ±a dt but for
friction. A pipe is then two delay lines of L/a: what leaves one end arrives at the other. Friction,
∫ ρ f u|u|/(2D) dx, is split by the trapezoidal rule: half when a wave leaves, half when it arrives.
"""

from __future__ import annotations

from math import pi

from commonrail.compile import physics

__all__ = ["friction_resistance", "impedance", "pipe_area"]


@physics
def pipe_area(diameter: float) -> float:
    """Cross-section of a round bore [m²]."""
    return 0.25 * pi * diameter * diameter


@physics
def impedance(sound_speed: float, area: float) -> float:
    """a/A, pressure per mass flow of a travelling wave [Pa s/kg] (Joukowsky: Δp = ρ a Δu)."""
    return sound_speed / area


@physics
def friction_resistance(friction_factor: float, length: float, diameter: float, density: float) -> float:
    """f L/(2 D ρ A²) [Pa s²/kg²]: pressure loss of the whole pipe per q|q|, Darcy's f as in Eq. (6)."""
    area = pipe_area(diameter)
    return friction_factor * length / (2.0 * diameter * density * area * area)
