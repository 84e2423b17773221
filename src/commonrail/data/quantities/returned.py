"""Map of return quantities as a kind of measured data: fuel through the return line per stroke."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from commonrail.base.arguments import Limits, amount, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.units import to_text
from commonrail.data.quantities.data import QuantityData
from commonrail.data.quantities.reading import MapModel
from commonrail.data.simulator import Candidates
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import coefficients_at
from commonrail.engine.solution import Batch
from commonrail.physics.connections import widening_leak
from commonrail.physics.flow import Guide, guide_of
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.physics.meters import QuantityValues
from commonrail.readers.toml import Unit

PERIODS = Limits(1e-6, 100.0, (1e-3, 10.0), ("ms",))  # between the starts of two strokes [s]

# Arguments of `guide_of` for the guides that leak into the return line.
_GUIDES = (
    ("plunger_diameter", "plunger_gap", "plunger_guide_length", "eccentricity", "gap_widening"),
    ("guide_diameter", "needle_gap", "needle_guide_length", "eccentricity", "gap_widening"),
)


class ReturnsModel(MapModel):
    """A map of return quantities."""

    quantity_column: ClassVar[str] = "return_quantity"

    kind: Literal["return quantities"]
    stroke_period: Annotated[float, Unit("s")] | None = None


@dataclass(frozen=True, eq=False)
class ReturnData(QuantityData):
    """Measured quantities through the return line per stroke at several operating points.

    Flow of the valve and leakage of the guides, as a bench collects them. Volumes refer to the pressure at the end of
    the return line and the fuel temperature of the injector, unless the meter states a density or a temperature.

    Attributes
    ----------
    stroke_period : float or None
        Time [s] between the starts of two strokes: beyond the simulated time the guides of the closed injector leak at
        rail pressure. None counts the simulated time alone.

    Raises
    ------
    ConfigurationError
        As for `QuantityData`, or if a row is a dead time, or the period is shorter than the simulated time.
    """

    kind: ClassVar[str] = "return quantities"
    what: ClassVar[str] = "return quantity"
    model: ClassVar[type[MapModel]] = ReturnsModel
    to_horizon: ClassVar[bool] = True
    own_keys: ClassVar[tuple[str, ...]] = ("stroke_period",)

    stroke_period: float | None = None
    has_return = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dead_time.any():
            raise ConfigurationError(f"{self.name} holds return quantities, which have no dead times; remove them.")
        if self.stroke_period is None:
            return
        settle(self, stroke_period=amount(self.stroke_period, "s", "stroke_period", PERIODS))
        longest = max(point.duration for point in self.points)
        if self.stroke_period < longest:
            raise ConfigurationError(
                f"The stroke_period of {self.name}, {to_text(self.stroke_period, 's')}, is shorter than the longest "
                f"simulated time, {to_text(longest, 's')}; give the time between the starts of two strokes."
            )

    def masses(self, batch: Batch, candidates: Candidates, points: Sequence[OperatingPoint]) -> Floats:
        """Mass per stroke through the return line, (candidates, points) [kg]; see `QuantityData.masses`."""
        if self.stroke_period is None:
            return batch.returned_mass
        left = np.array([self.stroke_period - point.duration for point in points])
        return np.asarray(batch.returned_mass + left * leak_at_rest(candidates, points))

    def densities(
        self, batch: Batch, candidates: Candidates, points: Sequence[OperatingPoint], meter_values: QuantityValues
    ) -> Floats:
        """Densities at the end of the return line, (1 or candidates, points) [kg/m³]; see `QuantityData.densities`."""
        return candidates.densities(_at_the_end(tuple(points)), meter_values)


@lru_cache(maxsize=64)  # equal objects: a simulator caches each new sequence of points
def _at_the_end(points: tuple[OperatingPoint, ...]) -> tuple[OperatingPoint, ...]:
    """Points whose cylinder pressure is set to the return pressure, for the density there."""
    return tuple(replace(point, cylinder_pressure=point.return_pressure) for point in points)


def leak_at_rest(candidates: Candidates, points: Sequence[OperatingPoint]) -> Floats:
    """Leakage of the guides while all volumes are at rail pressure, Eq. (5), (candidates, points) [kg/s]."""
    injector = candidates.simulator.injector
    names, values = candidates.simulator.of_injector(candidates.values)
    columns = {name: values[:, i] for i, name in enumerate(names)}

    def of(name: str) -> Floats:
        return np.asarray(columns.get(name, np.full(len(values), injector.values[name])))

    guides = [np.vectorize(guide_of)(*(of(f"plunger_needle.{key}") for key in keys)) for keys in _GUIDES]
    warmth, which = np.unique(of(FUEL_TEMPERATURE), return_inverse=True)
    leaks = np.empty((len(values), len(points)))
    for i, temperature in enumerate(warmth.tolist()):
        warm, rows = injector.with_values({FUEL_TEMPERATURE: temperature}), which.reshape(-1) == i
        for k, point in enumerate(points):
            rail, _, low = point.initial_pressures()
            c = coefficients_at(warm, point, candidates.simulator.time_step)
            # the law is written for single numbers, and holds for arrays
            flows: Any = [widening_leak(c, Guide(*(x[rows] for x in guide)), rail, low).mass_flow for guide in guides]
            leaks[rows, k] = np.sum(flows, axis=0)
    return leaks
