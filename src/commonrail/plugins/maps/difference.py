"""Compare a simulated map with a second model or with measured quantities."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.data.quantities.data import rms
from commonrail.plugins.maps.response import respond
from commonrail.plugins.maps.run import InjectionMap
from commonrail.readers.quantity_matrix import COLUMNS, FoundMap
from commonrail.readers.tables import read_found_map, take_columns

SMALL = 3e-9  # limit between errors in mm³ (below) and in percent (above) [m³]


class MeasuredMap(NamedTuple):
    """Measured quantities: rail pressures [Pa], energising times [s] and volumes [m³], all (n,)."""

    rail_pressure: Floats
    energising_time: Floats
    volume: Floats


class Comparison(NamedTuple):
    """Measured map, its source, and the volumes (n,) that the model injects at its points [m³]."""

    measured: MeasuredMap
    source: str
    simulated: Floats

    @property
    def rms_large(self) -> float:
        """Root mean square of the relative errors above `SMALL`; NaN if there are no such points."""
        large = (self.measured.volume > SMALL) & np.isfinite(self.simulated)
        return rms((self.simulated[large] - self.measured.volume[large]) / self.measured.volume[large])

    @property
    def rms_small(self) -> float:
        """Root mean square of the other errors [m³]; NaN if there are no such points."""
        small = (self.measured.volume <= SMALL) & np.isfinite(self.simulated)
        return rms(self.simulated[small] - self.measured.volume[small])


def compare_with(simulated: InjectionMap, measured: MeasuredMap, source: str) -> Comparison:
    """Simulate the injector of a map at the points of a measured map; `source` is its file name."""
    response = respond(simulated.injector, measured.rail_pressure, measured.energising_time, simulated.conditions)
    return Comparison(measured, source, response.volume)


def difference(first: InjectionMap, second: InjectionMap) -> tuple[Floats, Floats]:
    """Subtract the first map from the second, over the same axes.

    Energising times (pressures, quantities) [s] and volumes (pressures, times) [m³].
    """
    for name in ("rail_pressure", "quantity", "energising_time"):
        if not np.array_equal(getattr(first.axes, name), getattr(second.axes, name)):
            raise ConfigurationError(f"Two maps are compared over the same axes; their axes of {name} differ.")
    return second.inverse.energising_time - first.inverse.energising_time, second.volume - first.volume


# Measured quantity maps in SI units.


def read_measured_map(path: Path, density: float) -> MeasuredMap:
    """Read measured quantities; the density [kg/m³] converts masses to volumes.

    `InputError` if the file has no map.
    """
    return in_si(read_found_map(path), density)


def in_si(measured: FoundMap, density: float) -> MeasuredMap:
    """Convert a map to SI units; masses are divided by a density [kg/m³]."""
    table = take_columns(measured, COLUMNS, 1)
    rail, time, quantity = table.columns.values()
    return MeasuredMap(rail, time, quantity / density if table.units["quantity"] == "kg" else quantity)
