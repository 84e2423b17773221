"""Energising time of a second injection that holds its quantity whatever the dwell: the pressure wave compensated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.errors import ConfigurationError
from commonrail.engine.status import OK
from commonrail.physics.injector import Injector
from commonrail.plugins.maps.axes import MapAxes
from commonrail.plugins.maps.inverse import Inverse, invert, sampled
from commonrail.plugins.maps.response import Conditions, Response, knots_of, simulate_many
from commonrail.plugins.maps.run import InjectionMap, injection_map
from commonrail.plugins.maps.sweep import Base, fused_of

NARROW = 1e-6  # bracket of the dwell at which two injections fuse [s]


@dataclass(frozen=True)
class Compensation:
    """Energising times of a second injection over dwell, rail pressure and quantity.

    `alone` is the map of a single injection over the same pressures and quantities; `first_energising_time` [s];
    `dwell` (d,) lies from the end of the first energising to the start of the second [s]; `energising_time` (d,
    pressures, quantities) holds the quantity of the second injection [s]; `inverses` has one of each dwell.
    """

    alone: InjectionMap
    first_energising_time: float
    dwell: Floats
    energising_time: Floats
    inverses: tuple[Inverse, ...]


def compensation(
    injector: Injector, axes: MapAxes, first_energising_time: float, dwell: Floats, conditions: Conditions
) -> Compensation:
    """Energising times of a second injection that hold its quantity, at dwells (d,) [s].

    The quantity is the total less that of the first injection alone; where both are fused there is none. `axes` are
    those of the second injection. ConfigurationError if a dwell is negative or the first energising time [s] is not
    greater than zero.
    """
    if not (first_energising_time > 0.0 and np.all(dwell >= 0.0)):
        raise ConfigurationError("The first energising time must be greater than zero, the dwells zero or greater.")
    alone = injection_map(injector, axes, conditions)
    pressures, count = axes.rail_pressure, len(axes.rail_pressure)
    base = Base(float(pressures[0]), 0.0, first_energising_time, 0.0, conditions)
    first = simulate_many(injector, base.points({"rail_pressure": pressures}, alone=True), conditions)
    rows_pressure, rows_dwell = np.tile(pressures, len(dwell)), np.repeat(dwell, count)
    rows_first, delay = np.tile(first.injected_volume[0], len(dwell)), np.tile(first.opening[0], len(dwell))

    def simulate(rows: IndexArray, times: Floats) -> Response:
        changed = {"rail_pressure": rows_pressure[rows], "dwell": rows_dwell[rows], "energising_time": times}
        points = base.points(changed)
        found = simulate_many(injector, points, conditions)
        fused = fused_of(found, points.last_starts, delay[None, rows])[0]
        apart = ~fused & (found.status[0] == OK)
        return Response(np.where(apart, found.injected_volume[0] - rows_first[rows], np.nan), found.greatest_lift[0])

    lines = sampled(simulate, rows_pressure, knots_of(axes.energising_time))
    inverse, _ = invert(simulate, lines, axes.quantity, alone.rules)
    parts = [inverse.rows(slice(i * count, (i + 1) * count)) for i in range(len(dwell))]
    times = np.array([part.energising_time for part in parts])
    return Compensation(alone, first_energising_time, dwell, times, tuple(parts))


def fusion_dwell(injector: Injector, base: Base, rail_pressure: Floats, longest: float) -> Floats:
    """Longest dwell (n,) at which two injections of a base fuse into one [s], at rail pressures (n,) [Pa].

    NaN where they do so at the longest that is tried [s], and where a simulation failed. Halved to 1 us, taking for
    granted that injections which fuse also fuse at any shorter dwell.
    """
    low, high = np.zeros(len(rail_pressure)), np.full(len(rail_pressure), longest)
    first = simulate_many(injector, base.points({"rail_pressure": rail_pressure}, alone=True), base.conditions)
    delay, lost = first.opening, first.status[0] != OK

    def fused(dwell: Floats) -> Bools:
        points = base.points({"rail_pressure": rail_pressure, "dwell": dwell})
        batch = simulate_many(injector, points, base.conditions)
        lost[batch.status[0] != OK] = True
        found: Bools = fused_of(batch, points.last_starts, delay)[0]
        return found

    beyond, never = fused(high), ~fused(low)
    while np.max(high - low) > NARROW:
        middle = 0.5 * (low + high)
        there = fused(middle)
        low, high = np.where(there, middle, low), np.where(there, high, middle)
    return np.where(beyond | lost, np.nan, np.where(never, 0.0, 0.5 * (low + high)))
