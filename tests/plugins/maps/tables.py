"""A small map as files hold it, without a simulation."""

from __future__ import annotations

import numpy as np

from commonrail.plugins.maps.table import Axis, MapTable


def table(values: list[list[float]] | None = None, label: str = "InjVlv_tiET_MAP", note: str = "a note") -> MapTable:
    """Map over 7 pressures [hPa] and 3 quantities: more pressures than a line of DCM holds."""
    x = Axis("rail_pressure", "hPa", np.array([100000.0, 200000.0, 400000.0, 800000.0, 1e6, 1.2e6, 1.8e6]))
    y = Axis("quantity", "mm^3/inj", np.array([0.0, 0.75, 10.0]))
    numbers = values or [[0.0] * 7, [301.123 - 10.007 * i for i in range(7)], [901.5 - 100.25 * i for i in range(7)]]
    rounded = np.round(np.array(numbers), 3)
    states = tuple(tuple("reached" for _ in row) for row in numbers)
    return MapTable(label, 'Energising time, "tested" over ³', "energising_time", "us", x, y, rounded, states, (note,))
