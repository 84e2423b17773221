"""What every data set of a study shares: the injector, the time step and where its files may lie."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import reference_density
from commonrail.files.place import Place
from commonrail.files.reach import Reach
from commonrail.injector.definition import Injector
from commonrail.injector.variants import Drive

__all__ = ["Context"]


class Context(NamedTuple):
    """Surroundings in which a data set is read; time step in s."""

    injector: Injector
    time_step: float
    reach: Reach

    def path(self, file: str, at: Place) -> Path:
        """Path of a file that the study names; InputError if it lies where the study may not look."""
        return self.reach.path(self.reach.file.parent, file, at)

    def mass_density(self, unit: str, point: OperatingPoint) -> float:
        """Density at cylinder pressure [kg/m³] where `unit` is one of mass, else NaN: see `RateData.mass_density`."""
        return reference_density(self.injector, point) if unit.startswith("kg") else math.nan

    @property
    def drive_unit(self) -> str:
        """Unit of a measured drive: current or voltage as the injector is driven, empty if by neither."""
        return {Drive.CURRENT: "A", Drive.VOLTAGE: "V"}.get(self.injector.variant.drive, "")
