"""Vector that the reference integrates: feed pipe, injector, plunger and needle, return line.

Its order gives a banded Jacobian. Flows at the faces and pressures in the cells of a pipe, and position and velocity
of a mass, stand side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from commonrail.arrays import Floats, Ints
from commonrail.compile import physics
from commonrail.injector.layout import layout_of
from commonrail.injector.model import Books, Setting, State
from commonrail.injector.variants import Variant, wiring
from commonrail.parts import nozzle, solenoid, valve

__all__ = ["CORE", "ROW", "Core", "Frame", "Masses", "make_frame", "start_vector", "typical_sizes", "vector_states"]


LINE = 1e6  # typical pressure in the return line, for absolute tolerances [Pa]


class Masses(NamedTuple):
    """Fuel in control chamber, accumulation and SAC [kg]."""

    control: float
    store: float
    sac: float


class Core(NamedTuple):
    """State of the injector between the pipes, all at one time, without plunger and needle; or its rates.

    `outlet` is the pressure behind the valve [Pa] as if the liquid there could be stretched: what it lacks to the
    vapour pressure stands for the liquid missing in a cavity.
    """

    solenoid: solenoid.State
    valve: valve.State
    fuel: Masses
    nozzle: nozzle.State
    books: Books
    rail_mass: float
    outlet: float


CORE = layout_of(Core)
ROW: Any = CORE.load(range(len(CORE.paths)), 0, 1)  # row of each field


class Frame(NamedTuple):
    """First places in the vector of the injector, of plunger and needle, and of the return line."""

    core: int
    body: int
    line: int

    @property
    def tip(self) -> int:
        """Place of the needle's tip, the last of the masses."""
        return self.line - 2


def make_frame(variant: Variant) -> Callable[[Any], Frame]:
    """Function (cells of feed pipe and return line) → `Frame`."""
    core, body = len(CORE.paths), 2 * len(wiring(variant).positions.paths)

    @physics
    def frame(cells: Any) -> Frame:
        first = 2 * cells[0] + 1
        return Frame(first, first + core, first + core + body)

    return frame


def start_vector(variant: Variant, s: State, cells: Ints, at: Setting) -> Floats:
    """The vector at rest.

    Parameters
    ----------
    variant : Variant
    s : State
        At rest.
    cells : (2,) int
        Of feed pipe and return line.
    at : Setting
        Boundary pressures.
    """
    masses = Masses(s.control_chamber.fuel.mass, s.accumulation.fuel.mass, s.sac.mass)
    core = Core(s.solenoid, s.valve, masses, s.nozzle, s.books, s.rail.mass, at.low)
    return _joined(variant, core, (s.body.z, 0.0), cells, ((0.0, at.rail), (at.low, 0.0)))


def typical_sizes(variant: Variant, start: Floats, cells: Ints, rail: float) -> Floats:
    """Typical size of each entry, for a solver's absolute tolerances.

    Parameters
    ----------
    variant : Variant
    start : array
        The vector at rest, which gives those of the masses.
    cells : (2,) int
    rail : float
        Rail pressure [Pa].
    """
    held: Core = CORE.load(np.abs(start), make_frame(variant)(cells).core, 1)
    sizes = solenoid.TYPICAL, valve.TYPICAL, held.fuel, nozzle.State(1e-4, 1e-5), Books(1e-5, 1e-5), held.rail_mass
    return _joined(variant, Core(*sizes, LINE), (1e-4, 1.0), cells, ((1e-1, rail), (LINE, 1e-1)))


def _joined(variant: Variant, core: Core, body: Any, cells: Any, pipes: Any) -> Floats:
    """Vector of a core, of positions and velocities, and of pairs that repeat along the pipes."""
    at = make_frame(variant)(cells)
    y = np.empty(at.line + 2 * cells[1])
    for first, last, pair in ((0, at.core, pipes[0]), (at.body, at.line, body), (at.line, len(y), pipes[1])):
        y[first:last:2], y[first + 1 : last : 2] = pair
    CORE.store(y, at.core, 1, core)
    return y


def vector_states(variant: Variant, y: Floats, cells: Ints) -> dict[str, Floats]:
    """Core, positions and velocities by name, from vectors (…, entries); "body" where it is one mass.

    Parameters
    ----------
    variant : Variant
    y : (…, entries)
    cells : (2,) int
    """
    at, positions = make_frame(variant)(cells), wiring(variant).positions.paths
    named = {path: y[..., at.core + row] for row, path in enumerate(CORE.paths)}
    for row, path in enumerate(positions):
        named[".".join(filter(None, ("body.z", path)))] = y[..., at.body + 2 * row]
    return named
