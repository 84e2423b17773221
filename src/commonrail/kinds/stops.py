"""Distance by which needle and valve pass their stops in a simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.population import candidate_matrix
from commonrail.injector.variants import wiring
from commonrail.kinds.simulator import Simulator

__all__ = ["Past", "past_stops"]


SHARE = 8  # candidates whose states are kept at a time: 15 MB for 3.5 ms in steps of 1 us


class Past(NamedTuple):
    """Largest distance of the plunger's top and of the valve beyond their stops (candidates,) [m].

    Greater than zero where the part touches its stop; NaN for a failed simulation.
    """

    needle: Floats
    valve: Floats


def past_stops(simulator: Simulator, point: OperatingPoint, values: Floats) -> Past:
    """Distances of candidates beyond the stops of needle and valve at an operating point.

    The stops touch at `plunger_needle.stop_lift` and `valve.lift` of each candidate; they give way as springs, so that
    a part that rests on its stop lies beyond it.

    Parameters
    ----------
    simulator : Simulator
    point : OperatingPoint
    values : (candidates, names)
        [SI].
    """
    names, own = simulator.of_injector(values)
    prepared = plan.prepare(simulator.injector, [point], simulator.time_step)
    variant = simulator.injector.wired(names)
    rows = lanes.trace_paths(variant)
    places = [rows.index(f"body.{wiring(variant).body.TOP}"), rows.index("valve.lift")]
    found = np.empty((len(own), 2))
    for first in range(0, len(own), SHARE):
        part = slice(first, first + SHARE)
        theta = candidate_matrix(simulator.injector, names, own[part])
        job = plan.make_job(prepared, theta, False)
        outcome, trace = lanes.run(job, variant, traced=True, same_bits=simulator.same_bits)
        sound = (outcome.sound * outcome.closed_at_start)[:, 0] > 0.0
        found[part] = np.where(sound[:, None], trace[0][:, places, : len(theta)].max(axis=0).T, np.nan)
    of = _values_of(simulator, names, own)
    return Past(found[:, 0] - of("plunger_needle.stop_lift"), found[:, 1] - of("valve.lift"))


def _values_of(simulator: Simulator, names: tuple[str, ...], own: Floats) -> Callable[[str], Floats | float]:
    """Function that returns a parameter of each candidate, or of the injector where it does not vary."""
    columns = {name: own[:, i] for i, name in enumerate(names)}
    return lambda name: columns.get(name, simulator.injector.values[name])
