"""Points of a large map at which parameters are screened."""

from __future__ import annotations

import numpy as np

from commonrail.data.base import Role
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.operating_point import OperatingPoint
from commonrail.plugins.new.study import _thin


def test_a_map_of_many_points_is_screened_on_a_part() -> None:
    points = tuple(OperatingPoint(p, t) for p in np.linspace(20e6, 150e6, 13) for t in np.linspace(200e-6, 1400e-6, 13))
    quantity = np.linspace(1e-9, 50e-9, len(points))
    data = QuantityData("map", Role.FIT, points, quantity, 2e-10, 0.05, np.zeros(len(points), bool), 1.0, "bench", "")
    chosen = _thin(data, 60)
    assert 1 < len(chosen.points) <= 60
    rails = {point.rail_pressure for point in chosen.points}
    assert len(rails) > 1
    assert len(chosen.points) % len(rails) == 0  # all times of each pressure
    assert _thin(data, 200) is data
