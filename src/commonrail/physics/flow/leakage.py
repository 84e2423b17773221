"""Leakage through the ring gap of a guide, Eq. (5)."""

from __future__ import annotations

from math import pi

from commonrail.physics.law import physics


@physics
def gap_conductance(diameter: float, gap: float, length: float) -> float:
    """π d g³/(12 l), the geometry of Eq. (5) [m³]: concentric gap, laminar, fully developed flow.

    `diameter`: diameter d of the guide [m]; `gap`: radial gap g [m], ≥ 0, small against d; `length`: length l of the
    guide [m], > 0.
    """
    return pi * diameter * gap * gap * gap / (12.0 * length)


@physics
def leakage_slope(conductance: float, fluidity: float) -> float:
    """Mass flow per pressure difference [kg/(s Pa)].

    Eq. (5) times the density: ρ π d g³/(12 η l) = conductance/ν, since η = ρ ν.

    `conductance`: `gap_conductance` [m³]; `fluidity`: 1/ν at the gap's mean pressure [s/m²].
    """
    return conductance * fluidity
