"""Protocols of the modules and functions that steps and equations use: bodies, drives, boundaries.

A module that is given as a `Body` holds these functions; the type checker compares it with the protocol where
`injector.variants` chooses it.
"""

from __future__ import annotations

from typing import Any, Protocol

from commonrail.physics.components import drive, solenoid
from commonrail.physics.components.plunger_needle import Motion, SeatContact
from commonrail.physics.flow.volume import Contents
from commonrail.physics.model import Inputs


class Advance(Protocol):
    """Motion of a body over one leapfrog step: (coefficients, seat, state, loads at t_n, dt [s]) → state."""

    def __call__(self, c: Any, seat: SeatContact, s: Any, load: Any, dt: float, /) -> Any: ...


class Accelerations(Protocol):
    """Right-hand side of a body's motion: (coefficients, seat, positions [m], velocities [m/s], loads) → [m/s²]."""

    def __call__(self, c: Any, seat: SeatContact, z: Any, v: Any, load: Any, /) -> Any: ...


class Body(Protocol):
    """Module of what moves with the needle: `plunger_needle`, `rigid_body` or `direct_needle`.

    Attributes
    ----------
    TOP, TIP : str
        Paths in its `State` of the position that meets the stop and of the needle's tip.
    State, Positions : type
        NamedTuple of numbers, or one number.
    """

    TOP: str
    TIP: str

    @property
    def State(self) -> type[Any]: ...

    @property
    def Positions(self) -> Any: ...

    def advance(self, c: Any, seat: SeatContact, s: Any, load: Any, dt: float, /) -> Any:
        """As of `Advance`."""

    def accelerations(self, c: Any, seat: SeatContact, z: Any, v: Any, load: Any, /) -> Any:
        """As of `Accelerations`."""

    def lifts(self, z: Any, /) -> Motion:
        """Lifts [m] of positions, and speeds [m/s] of velocities."""

    def at_rest(self, c: Any, seat: SeatContact, load: Any, /) -> Any:
        """State at rest on the seat under static loads."""


class DriveLaw(Protocol):
    """Drive of the solenoid: mean of dφ/dt over a step of dt [s], N dφ/dt = v − R i of Eq. (11)."""

    def __call__(
        self,
        p: drive.Parameters,
        c: solenoid.Coefficients,
        s: drive.State,
        supply: drive.Supply,
        now: solenoid.Circuit,
        dt: float,
        /,
    ) -> drive.Change: ...


class Inlet(Protocol):
    """Boundary at the feed pipe's inlet: (coefficients, state, inputs, arriving wave [Pa]) → mean pressure and flow."""

    def __call__(self, c: Any, s: Any, u: Inputs, wave: float, /) -> Any: ...


class Draw(Protocol):
    """Rail after `drawn` [kg] have left it."""

    def __call__(self, c: Any, s: Any, drawn: float, /) -> Contents: ...


class Discharge(Protocol):
    """Coefficient c_d of the nozzle [1] at the greatest lift [m], Eq. (9)."""

    def __call__(self, c: Any, lift_reached: float, /) -> float: ...


class ValveGap(Protocol):
    """(c_d A)² of the valve's gap [m⁴]: (coefficients, control chamber, pressure behind [Pa], lift [m])."""

    def __call__(self, c: Any, chamber: Contents, behind: float, lift: float, /) -> float: ...
