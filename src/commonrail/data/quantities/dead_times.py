"""Dead times: energising times at which a small quantity is reached, rows of a quantity map that are judged by time."""

from __future__ import annotations

from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.engine.operating_point import OperatingPoint

AROUND = 50e-6  # distance of the energising times between which a dead time is interpolated [s]
FLATTEST = 200e-6  # time in which the quantity is taken to grow from zero at the slowest [s]

SEARCHED = np.linspace(120e-6, 480e-6, 37)  # energising times [s]

NO_DEAD_TIME = "NO_DEAD_TIME"
NOT_REACHED = (
    "No dead time was found: the quantity is not passed between energising times of 120 and 480 µs, or the "
    "simulation fails there."
)


def neighbours(point: OperatingPoint) -> list[OperatingPoint]:
    """Points energised shorter and longer than a dead time, between which `crossing_times` interpolates."""
    duration = point.pulses[0].duration
    return [with_duration(point, duration - _before(duration)), with_duration(point, duration + AROUND)]


def crossing_times(duration: Floats, quantity: Floats, threshold: Floats) -> Floats:
    """Energising times at which a quantity is reached, by linear interpolation between three of them.

    Beyond the outer ones the nearest segment is extrapolated. Its slope is at least the
    threshold over `FLATTEST`: an injector that injects nothing still has a finite dead time.

    `duration` (rows,): energising times of the middle ones [s]. `quantity` (candidates, rows, 3): quantities at the
    `neighbours` and, between them, at the point itself [m³]; NaN where a simulation failed. `threshold` (rows,):
    quantity to be reached [m³]. Returns (candidates, rows) times [s]; NaN where a simulation failed.
    """
    low, middle, high = np.moveaxis(quantity, -1, 0)
    later = middle < threshold
    width = np.where(later, AROUND, _before(duration))
    slope = np.where(later, high - middle, middle - low) / width
    share = (threshold - middle) / np.maximum(slope, threshold / FLATTEST)
    return np.where(np.isfinite(low + high), duration + share, np.nan)


def _before(duration: Any) -> Any:
    return np.minimum(AROUND, 0.5 * duration)


def with_duration(point: OperatingPoint, duration: float) -> OperatingPoint:
    """Point with another energising time [s]."""
    return OperatingPoint(
        point.rail_pressure, duration, point.cylinder_pressure, point.return_pressure, start=point.start
    )
