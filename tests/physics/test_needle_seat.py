"""Needle seat: its gap is the surface of a frustum."""

from __future__ import annotations

import math

import numpy as np
import pytest

from commonrail.physics.components import needle_seat

SEAT = needle_seat.Parameters(2e-3, math.radians(60), 0.8, 2e8, 0.2, 10.0)
C = needle_seat.coefficients(SEAT, 2e-3)


def frustum(lift: float) -> float:
    """Smallest surface of revolution between the seat edge and the cone lifted off it: by search, no formula."""
    half = SEAT.cone_angle / 2
    edge = np.array([SEAT.diameter / 2, 0.0])
    along = np.linspace(-4e-4, 4e-4, 800_001)  # down the needle's flank, which starts `lift` above the edge
    flank = edge + np.array([0.0, lift]) + np.outer(along, [-math.sin(half), -math.cos(half)])
    way = np.hypot(*(flank - edge).T)
    nearest = int(np.argmin(way))
    return float(math.pi * (edge[0] + flank[nearest, 0]) * way[nearest])


@pytest.mark.parametrize("lift", [5e-6, 50e-6, 300e-6])
def test_gap_is_the_frustum_between_cone_and_edge(lift: float) -> None:
    area = math.sqrt(needle_seat.gap_cda2(C, lift)) / SEAT.discharge
    # the search is 1 nm fine along a flank whose radius it moves by half that
    assert area == pytest.approx(frustum(lift), rel=1e-6)


def test_a_pressed_seat_is_shut() -> None:
    assert needle_seat.gap_cda2(C, -4e-6) == 0.0


def test_area_inside_the_seat_line() -> None:
    assert C.area == pytest.approx(math.pi * 1e-6, rel=1e-14)
