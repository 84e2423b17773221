"""Quantity map of an injector, its inverse, and where the quantity is not monotone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from commonrail.arguments import instance
from commonrail.arrays import Bools, Floats
from commonrail.display.shown import Shown
from commonrail.display.text import counted
from commonrail.injector.definition import Injector
from commonrail.maps.axes import MapAxes
from commonrail.maps.choices import CellState
from commonrail.maps.inverse import Inverse, Rules, invert
from commonrail.maps.response import Conditions, density_at, require_some, respond
from commonrail.maps.samples import Fall, Line, falls_of, knots_of

__all__ = ["BALLISTIC", "Edges", "InjectionMap", "MapBands", "injection_map", "usual_axes"]

Edges = Mapping[float, tuple[Floats, Floats]]

BALLISTIC = 0.98  # share of the largest lift at a rail pressure below which a needle turns round before its end


class MapBands(NamedTuple):
    """Edges between which measured quantities are expected, by the share of them that a band is to hold.

    Attributes
    ----------
    estimator : str
        Estimator of the bands, as `Prediction.estimator`.
    quantity : mapping of float to (lower, upper)
        Of the quantity map, (pressures, energising times) each [m³].
    delivered : mapping of float to (lower, upper)
        Of what the energising times of the inverse deliver, (pressures, quantities) each [m³]; NaN in cells that hold
        no simulated time.
    """

    estimator: str
    quantity: Edges
    delivered: Edges


@dataclass(frozen=True, repr=False)
class InjectionMap(Shown):
    """Simulated map of an injector.

    Attributes
    ----------
    injector : Injector
    axes : MapAxes
    conditions : Conditions
    rules : Rules
    density : float
        Reference density [kg/m³]: mass over volume of every quantity.
    volume : (pressures, energising times)
        Injected volumes [m³], NaN where the simulation failed.
    ballistic : (pressures, energising times) bool
        Needle turns round below `BALLISTIC` of its largest lift at that rail pressure.
    inverse : Inverse
        Over pressures and quantities.
    inverse_ballistic : (pressures, quantities) bool
    falls : tuple of Fall
        Places where the quantity falls with the energising time, found on all simulated points.
    lines : tuple of Line
        All simulated points, one line for each rail pressure.
    bands : MapBands or None
        Of measured quantities, where a fit tells them.
    """

    presenter = "commonrail.report.map:INJECTION_MAP"

    injector: Injector
    axes: MapAxes
    conditions: Conditions
    rules: Rules
    density: float
    volume: Floats
    ballistic: Bools
    inverse: Inverse
    inverse_ballistic: Bools
    falls: tuple[Fall, ...]
    lines: tuple[Line, ...]
    bands: MapBands | None = None

    @property
    def simulations(self) -> int:
        """Number of simulated injections."""
        return sum(len(line.time) for line in self.lines)

    @property
    def falls_with_pressure(self) -> Bools:
        """Cells (pressures, energising times) whose quantity is below that at the rail pressure before."""
        fallen = np.zeros(self.volume.shape, bool)
        fallen[1:] = np.diff(self.volume, axis=0) < -1e-11
        return fallen

    def count(self, state: CellState) -> int:
        """Number of cells of the inverse in a state."""
        return int(np.count_nonzero(self.inverse.state == state))


def usual_axes(injector: Injector) -> MapAxes:
    """Axes of a control unit, up to the highest pressure that the injector's fuel is declared for."""
    return MapAxes.usual(injector.fuel.pressure_range[1])


def injection_map(
    injector: Injector,
    axes: MapAxes | None = None,
    conditions: Conditions = Conditions(),
    rules: Rules = Rules(),
    progress: Callable[[str], None] | None = None,
) -> InjectionMap:
    """Simulate the quantity map of an injector and its inverse.

    Parameters
    ----------
    injector : Injector
    axes : MapAxes, optional
        By default those of a control unit.
    conditions : Conditions
        Pressures behind the nozzle and of the return line, time step, threads.
    rules : Rules
        For cells with several energising times, and with none.
    progress : function, optional
        Called with a line of text before each stage.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or a pressure lies outside what the model covers.
    SimulationError
        If no point could be simulated.
    """
    instance(injector, Injector, "injector")
    axes = usual_axes(injector) if axes is None else instance(axes, MapAxes, "axes")
    tell = progress or (lambda _: None)
    lines = _sampled(injector, axes, conditions, tell)
    forward = [line.at(axes.energising_time) for line in lines]
    volume = np.array([found.volume for found in forward])
    cells = len(axes.rail_pressure) * len(axes.quantity)
    tell(f"inverting {counted(cells, 'cell')} ...")
    inverse, lines = invert(
        lambda rows, times: respond(injector, axes.rail_pressure[rows], times, conditions), lines, axes.quantity, rules
    )
    full = np.array([np.nanmax(line.lift, initial=0.0) for line in lines])[:, None]
    return InjectionMap(
        injector,
        axes,
        conditions,
        rules,
        density_at(injector, conditions),
        volume,
        np.array([found.lift for found in forward]) < BALLISTIC * full,
        inverse,
        np.nan_to_num(inverse.lift, nan=np.inf) < BALLISTIC * full,
        tuple(fall for line in lines for fall in falls_of(line)),
        tuple(lines),
    )


def _sampled(injector: Injector, axes: MapAxes, conditions: Conditions, tell: Callable[[str], None]) -> list[Line]:
    """Samples on a fine grid of energising times at each rail pressure."""
    knots = knots_of(axes.energising_time)
    at = counted(len(axes.rail_pressure), "rail pressure")
    tell(f"simulating {counted(len(knots), 'energising time')} at {at} ...")
    rail, time = np.meshgrid(axes.rail_pressure, knots, indexing="ij")
    found = respond(injector, rail, time, conditions)
    require_some(injector, [conditions.point(float(rail[-1, 0]), float(knots[-1]))], found, conditions)
    rows = zip(axes.rail_pressure.tolist(), found.volume, found.lift, strict=True)
    return [Line(pressure, knots, volume, lift) for pressure, volume, lift in rows]
