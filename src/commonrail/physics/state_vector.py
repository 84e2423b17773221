"""Vector that the reference integrates: feed pipe, injector, moving masses, return line.

Its order gives a banded Jacobian. Flows at the faces and pressures in the cells of a pipe, and position and velocity
of a mass, stand side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, Ints
from commonrail.base.choices import Actuation
from commonrail.physics.components import feed_pipe, nozzle, solenoid, valve
from commonrail.physics.law import Layout, layout_of, physics
from commonrail.physics.model import CumulativeFlows, Setting, SharedCoefficients
from commonrail.physics.variants import Variant, wiring

LINE = 1e6  # typical pressure in the return line, for absolute tolerances [Pa]
INJECTED = nozzle.State(1e-4, 1e-5), CumulativeFlows(1e-5, 1e-5)  # typical sizes of nozzle and flows


class Masses(NamedTuple):
    """Fuel in control chamber, accumulation and SAC [kg]."""

    control: float
    accumulation: float
    sac: float


class NeedleMasses(NamedTuple):
    """Fuel in accumulation and SAC [kg]."""

    accumulation: float
    sac: float


class Core(NamedTuple):
    """State of the servo injector between the pipes, all at one time, without plunger and needle; or its rates.

    `outlet` is the pressure downstream of the valve [Pa] as if the liquid there could be stretched: what it lacks to
    the vapour pressure represents the liquid missing in a cavity.
    """

    solenoid: solenoid.State
    valve: valve.State
    fuel: Masses
    nozzle: nozzle.State
    cumulative_flows: CumulativeFlows
    rail_mass: float
    outlet: float


class DirectCore(NamedTuple):
    """State of the direct-acting injector downstream of the pipe, without armature and needle; or its rates."""

    solenoid: solenoid.State
    fuel: NeedleMasses
    nozzle: nozzle.State
    cumulative_flows: CumulativeFlows


_CORES: dict[Actuation, Any] = {Actuation.SERVO: Core, Actuation.DIRECT: DirectCore}


def core_of(variant: Variant) -> Layout:
    """Layout of the `Core` or `DirectCore` of a variant."""
    return layout_of(_CORES[variant.actuation])


class Frame(NamedTuple):
    """First places in the vector of the injector, of the moving masses, and of the return line."""

    core: int
    body: int
    line: int

    @property
    def tip(self) -> int:
        """Place of the needle's tip, the last of the masses."""
        return self.line - 2


def make_frame(variant: Variant) -> Callable[[Any], Frame]:
    """Function (cells of feed pipe and return line) → `Frame`."""
    core, body = len(core_of(variant).paths), 2 * len(wiring(variant).positions.paths)

    @physics
    def frame(cells: Any) -> Frame:
        first = 2 * cells[0] + 1
        return Frame(first, first + core, first + core + body)

    return frame


def start_vector(variant: Variant, c: SharedCoefficients, s: Any, cells: Ints, at: Setting) -> Floats:
    """The vector at rest.

    `c`: coefficients; `s`: at rest; `cells` (2,) int: of feed pipe and return line; `at`: boundary pressures.
    """
    fuel = NeedleMasses(s.accumulation.fuel.mass, s.sac.mass)
    if variant.actuation is Actuation.DIRECT:
        core: Any = DirectCore(s.solenoid, fuel, s.nozzle, s.cumulative_flows)
    else:
        core = Core(
            solenoid=s.solenoid,
            valve=s.valve,
            fuel=Masses(s.control_chamber.fuel.mass, *fuel),
            nozzle=s.nozzle,
            cumulative_flows=s.cumulative_flows,
            rail_mass=s.rail.mass,
            outlet=at.low,
        )
    flow, behind = s.feed_pipe.end_flow, 1.0 - (np.arange(cells[0]) + 0.5) / cells[0]  # share of the pipe
    along = s.accumulation.fuel.pressure + behind * feed_pipe.loss(c.feed_pipe, flow)
    return _join_vector(variant, core, (s.body.z, 0.0), cells, ((flow, along), (at.low, 0.0)))


def typical_sizes(variant: Variant, start: Floats, cells: Ints, rail: float) -> Floats:
    """Typical size of each entry, for a solver's absolute tolerances.

    `start`: the vector at rest, which sets the sizes of the masses; `cells`: (2,) int; `rail`: rail pressure [Pa].
    """
    core: Any = core_of(variant).load(np.abs(start), make_frame(variant)(cells).core, 1)
    typical, flows = INJECTED
    core = core._replace(solenoid=solenoid.TYPICAL, nozzle=typical, cumulative_flows=flows)
    if variant.actuation is Actuation.SERVO:
        core = core._replace(valve=valve.TYPICAL, outlet=LINE)
    return _join_vector(variant, core, (1e-4, 1.0), cells, ((1e-1, rail), (LINE, 1e-1)))


def _join_vector(variant: Variant, core: Any, body: Any, cells: Any, pipes: Any) -> Floats:
    """Vector of a core, of positions and velocities, and of pairs that repeat along the pipes."""
    at = make_frame(variant)(cells)
    y = np.empty(at.line + 2 * cells[1])
    for first, last, pair in ((0, at.core, pipes[0]), (at.body, at.line, body), (at.line, len(y), pipes[1])):
        y[first:last:2], y[first + 1 : last : 2] = pair
    core_of(variant).store(y, at.core, 1, core)
    return y


def vector_states(variant: Variant, y: Floats, cells: Ints) -> dict[str, Floats]:
    """Core, positions and velocities by name, from vectors (…, entries); "body" where it is one mass.

    `y`: (…, entries); `cells`: (2,) int.
    """
    at, positions = make_frame(variant)(cells), wiring(variant).positions.paths
    states = {path: y[..., at.core + row] for row, path in enumerate(core_of(variant).paths)}
    for row, path in enumerate(positions):
        states[".".join(filter(None, ("body.z", path)))] = y[..., at.body + 2 * row]
    return states
