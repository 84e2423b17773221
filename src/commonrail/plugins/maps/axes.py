"""Axes of a map: rail pressures, quantities and energising times, each strictly increasing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import amount, array, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.units import to_text
from commonrail.engine.operating_point import ENERGISING_TIMES as LIMITS

MOST_POINTS = 200  # of an axis; maps of control units have about twenty

# Typical of a control unit: 16 pressures, and 18 quantities that are dense from 0.5 to 10 mm³.
RAIL_PRESSURES = tuple(mpa * 1e6 for mpa in (20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130, 140, 150, 160, 180))
QUANTITIES = tuple(mm3 * 1e-9 for mm3 in (0, 0.5, 0.75, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 40, 60, 80))
ENERGISING_TIMES = tuple(
    us * 1e-6
    for us in (100, 125, 150, 175, 200, 225, 250, 300, 350, 400, 450, 500, 600, 700, 800, 1000, 1200, 1400, 1700, 2000)
)


@dataclass(frozen=True, eq=False)
class MapAxes:
    """Axes of a map and of its inverse.

    Attributes
    ----------
    rail_pressure : (n,)
        [Pa].
    quantity : (k,)
        Injected volumes [m³], zero or greater, at the reference density.
    energising_time : (m,)
        [s], greater than zero. The last one is the longest simulated.

    Raises
    ------
    ConfigurationError
        If an axis is empty, too long, does not increase strictly, or holds a value that is too small.
    """

    rail_pressure: Floats
    quantity: Floats
    energising_time: Floats

    def __post_init__(self) -> None:
        settle(
            self,
            rail_pressure=increasing(self.rail_pressure, "Pa", "rail pressures of the map"),
            quantity=increasing(self.quantity, "m3", "quantities of the map"),
            energising_time=increasing(self.energising_time, "s", "energising times of the map"),
        )
        if self.quantity[0] < 0.0:
            raise ConfigurationError("The quantities of the map must be zero or greater.")
        amount(self.energising_time[-1], "s", "energising times of the map", LIMITS)
        if self.energising_time[0] <= 0.0:
            raise ConfigurationError("The energising times of the map must be greater than zero.")

    @classmethod
    def usual(cls, highest: float) -> MapAxes:
        """Typical axes of a control unit, with the rail pressures up to `highest` [Pa]."""
        pressures = [p for p in RAIL_PRESSURES if p <= highest * (1.0 + 1e-9)]
        return cls(np.array(pressures), np.array(QUANTITIES), np.array(ENERGISING_TIMES))


def increasing(values: ArrayLike, unit: str, what: str) -> Floats:
    """Return a checked axis (n,) of SI values, from numbers or texts with units; `what` names it in messages.

    `ConfigurationError` if it is empty, longer than `MOST_POINTS`, or does not increase strictly.
    """
    axis = array(values, unit, what, 1)
    if not 1 <= len(axis) <= MOST_POINTS:
        raise ConfigurationError(f"The {what} must be 1 to {MOST_POINTS} values, not {len(axis)}.")
    steps = np.diff(axis)
    if np.any(steps <= 0.0):
        at = int(np.argmax(steps <= 0.0))
        before, after = (to_text(value, unit) for value in axis[at : at + 2].tolist())
        raise ConfigurationError(
            f"The {what} must increase strictly, but {after} follows {before}; sort them and remove repeated ones."
        )
    return axis
