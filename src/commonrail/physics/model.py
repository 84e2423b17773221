"""The whole injector as data: parameters, coefficients and state of all components, and what comes from outside.

Protocols of the exchangeable parts (`Body`, `DriveLaw` and others; the type checker compares them in `variants`), and
the computation of coefficients from parameters. The state at rest is in `rest`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol

from commonrail.physics import fuel_kernel as fuel
from commonrail.physics.components import (
    control_chamber,
    drive,
    feed_pipe,
    needle_seat,
    nozzle,
    plunger_needle,
    return_line,
    solenoid,
    valve,
)
from commonrail.physics.components.plunger_needle import Motion, SeatContact
from commonrail.physics.elementary import exponential
from commonrail.physics.flow import Contents, Flow, Guide
from commonrail.physics.fuel_kernel import FuelCoefficients
from commonrail.physics.law import physics


class Parameters(NamedTuple):
    """Every parameter of the injector (SI), component by component: ``p.plunger_needle.k1``."""

    rail: feed_pipe.RailParameters
    feed_pipe: feed_pipe.Parameters
    control_chamber: control_chamber.Parameters
    valve: valve.Parameters
    solenoid: solenoid.Parameters
    drive: drive.Parameters
    return_line: return_line.Parameters
    accumulation: needle_seat.AccumulationParameters
    plunger_needle: plunger_needle.Parameters
    needle_seat: needle_seat.Parameters
    sac: needle_seat.SacParameters
    nozzle: nozzle.Parameters


class Setting(NamedTuple):
    """Boundary values at time zero [Pa] and the time step [s]."""

    rail: float
    cylinder: float
    low: float
    dt: float


class Ambient(NamedTuple):
    """Fuel at a boundary at time zero: pressure [Pa], density [kg/m³], dρ/dp [kg/(m³ Pa)]."""

    pressure: float
    density: float
    compressibility: float


class Delays(NamedTuple):
    """Travel times in steps; shares of the flux lag and of the c_d memory that decay in one step [1]."""

    feed: float
    back: float
    rising_lag_fraction: float
    falling_lag_fraction: float
    memory_lag_fraction: float


class Coefficients(NamedTuple):
    """Numbers that the step needs, computed once per candidate and operating point."""

    fuel: FuelCoefficients
    rail: feed_pipe.RailCoefficients
    feed_pipe: feed_pipe.Coefficients
    control_chamber: control_chamber.Coefficients
    valve: valve.Coefficients
    solenoid: solenoid.Coefficients
    drive: drive.Parameters
    return_line: return_line.Coefficients
    plunger_needle: plunger_needle.Coefficients
    needle_seat: needle_seat.Coefficients
    accumulation: needle_seat.AccumulationParameters
    sac: needle_seat.SacCoefficients
    nozzle: nozzle.Coefficients
    source: Ambient
    cylinder: Ambient
    delays: Delays


class CumulativeFlows(NamedTuple):
    """Fuel given to the return and supplied by the rail so far [kg]."""

    returned: float
    supplied: float


class State(NamedTuple):
    """State at t_n. `body` is the state of the chain or of the rigid body."""

    rail: Contents
    feed_pipe: feed_pipe.State
    control_chamber: control_chamber.State
    valve: valve.State
    solenoid: solenoid.State
    drive: drive.State
    return_line: return_line.State
    accumulation: needle_seat.AccumulationState
    body: Any
    sac: Contents
    nozzle: nozzle.State
    cumulative_flows: CumulativeFlows


class SharedDelays(Protocol):
    """Fields of `Delays` that both actuations have."""

    @property
    def feed(self) -> float: ...

    @property
    def rising_lag_fraction(self) -> float: ...

    @property
    def falling_lag_fraction(self) -> float: ...

    @property
    def memory_lag_fraction(self) -> float: ...


class SharedCoefficients(Protocol):
    """Coefficients that both actuations have, for the laws that they share."""

    @property
    def fuel(self) -> FuelCoefficients: ...

    @property
    def feed_pipe(self) -> feed_pipe.Coefficients: ...

    @property
    def solenoid(self) -> solenoid.Coefficients: ...

    @property
    def drive(self) -> drive.Parameters: ...

    @property
    def sac(self) -> needle_seat.SacCoefficients: ...

    @property
    def needle_seat(self) -> needle_seat.Coefficients: ...

    @property
    def nozzle(self) -> nozzle.Coefficients: ...

    @property
    def delays(self) -> SharedDelays: ...


class SharedState(Protocol):
    """State that both actuations have."""

    @property
    def solenoid(self) -> solenoid.State: ...

    @property
    def drive(self) -> drive.State: ...

    @property
    def accumulation(self) -> needle_seat.AccumulationState: ...

    @property
    def sac(self) -> Contents: ...

    @property
    def nozzle(self) -> nozzle.State: ...


class Waves(NamedTuple):
    """Arriving waves [Pa], mean over a step: down the feed pipe, up the feed pipe, in the return line."""

    down: float
    up: float
    back: float


class Inputs(NamedTuple):
    """Boundary pressures [Pa] and measured drive, mean over a step, and clocks of the energising [s]."""

    rail: float
    cylinder: float
    low: float
    trace: float
    since_start: float
    since_end: float


# Protocols of the exchangeable parts: bodies, drives, boundaries.


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
        Paths in `State`: the position that meets the stop, and the needle's tip.
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
        """See `Advance`."""

    def accelerations(self, c: Any, seat: SeatContact, z: Any, v: Any, load: Any, /) -> Any:
        """See `Accelerations`."""

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


class InletLaw(Protocol):
    """Boundary at the feed pipe's inlet: (coefficients, state, inputs, arriving wave [Pa]) → mean pressure and flow."""

    def __call__(self, c: Any, s: Any, u: Inputs, wave: float, /) -> Any: ...


class DrawLaw(Protocol):
    """Rail after `drawn` [kg] have left it."""

    def __call__(self, c: Any, s: Any, drawn: float, /) -> Contents: ...


class DischargeLaw(Protocol):
    """Coefficient c_d of the nozzle [1], as Eq. (9): (coefficients of the nozzle, greatest lift [m], pressures [Pa]).

    The pressures are in the SAC (in the fast step, at its start) and in the cylinder.
    """

    def __call__(self, c: Any, lift_reached: float, sac: float, cylinder: float, /) -> float: ...


class LeakLaw(Protocol):
    """Leakage through a guide, Eq. (5): (coefficients, guide, pressures at both ends [Pa]) → flow."""

    def __call__(self, c: Any, guide: Guide, pressure: float, low: float, /) -> Flow: ...


class FilmLaw(Protocol):
    """Damping coefficient of the films that the valve squeezes [N s/m]: (coefficients of the valve, its state)."""

    def __call__(self, c: valve.Coefficients, s: valve.State, /) -> float: ...


class HoleLaw(Protocol):
    """A-hole as `connections.a_hole`: (coefficients of the control chamber, pressures in it and after the valve)."""

    def __call__(self, c: Any, pressure: float, behind: float, /) -> Any: ...


class GapLaw(Protocol):
    """(c_d A)² of the valve's gap [m⁴]: (coefficients, A-hole, control chamber, downstream pressure [Pa], lift [m])."""

    def __call__(self, c: Any, hole: Any, chamber: Contents, behind: float, lift: float, /) -> float: ...


# From parameters to coefficients, for one candidate at one operating point.


# Largest deformation of seat, stop and needle [m]: chosen far above the 0.1 mm of the catalogue's injectors.
GIVE = 2e-3


@physics
def coefficients(p: Parameters, f: fuel.FuelCoefficients, at: Setting) -> Coefficients:
    """Coefficients of all components; wave speeds, laminar offsets and films at the pressures of time zero."""
    density = fuel.density(f, at.rail)
    speed = fuel.sound_speed(f, density)
    viscosity, mean_pressure = fuel.dynamic_viscosity(f, at.rail), 0.5 * (at.rail + at.low)
    low_density = fuel.density(f, at.low)
    feed = feed_pipe.coefficients(p.feed_pipe, density, speed)
    back = return_line.coefficients(p.return_line, fuel.sound_speed(f, low_density), at.dt)
    eddy_lag_fraction = lag_fraction(p.solenoid.eddy_lag, at.dt)
    return Coefficients(
        fuel=f,
        rail=feed_pipe.rail_coefficients(p.rail),
        feed_pipe=feed,
        control_chamber=control_chamber.coefficients(p.control_chamber, viscosity),
        valve=valve.coefficients(p.valve, fuel.dynamic_viscosity(f, at.low), fuel.dynamic_viscosity(f, mean_pressure)),
        solenoid=solenoid.coefficients(p.solenoid),
        drive=p.drive,
        return_line=back,
        plunger_needle=plunger_needle.coefficients(p.plunger_needle, at.dt),
        needle_seat=needle_seat.coefficients(p.needle_seat, viscosity),
        accumulation=p.accumulation,
        sac=needle_seat.sac_coefficients(p.sac),
        nozzle=nozzle.coefficients(p.nozzle, at.rail, viscosity),
        source=ambient(f, at.rail),
        cylinder=ambient(f, at.cylinder),
        delays=Delays(
            feed.travel_time / at.dt,
            back.round_trip / at.dt,
            eddy_lag_fraction,
            eddy_lag_fraction,
            lag_fraction(p.nozzle.discharge_memory, at.dt),
        ),
    )


@physics
def lag_fraction(lag: float, dt: float) -> float:
    """Share of a first-order lag that decays in a step [1]; `lag`: τ [s], ≥ 0; zero means no lag."""
    return 1.0 - exponential(-dt / lag) if lag > 0.0 else 1.0


@physics
def ambient(f: fuel.FuelCoefficients, pressure: float) -> Ambient:
    """Fuel at a boundary pressure [Pa]."""
    density = fuel.density(f, pressure)
    return Ambient(pressure, density, 1.0 / fuel.stiffness(f, density))


@physics
def ambient_density(around: Ambient, pressure: float) -> float:
    """Density [kg/m³] near the boundary pressure of time zero."""
    return around.density + (pressure - around.pressure) * around.compressibility


@physics
def seat_contact(c: SharedCoefficients) -> plunger_needle.SeatContact:
    """Needle seat as a contact of the needle. Shared by both actuations."""
    return plunger_needle.SeatContact(c.needle_seat.contact_stiffness, c.needle_seat.contact_damping)


@physics
def control_volume(c: Coefficients, lifts: plunger_needle.Motion) -> float:
    """Volume of the control chamber [m³]; the rising plunger reduces it."""
    return c.control_chamber.volume - c.plunger_needle.guides.plunger_area * lifts.top


@physics
def accumulation_volume(c: Coefficients, lifts: plunger_needle.Motion) -> float:
    """Accumulation volume [m³]: a rising shoulder and tip of the needle enlarge it."""
    guides = c.plunger_needle.guides
    shoulder = (guides.guide_area - guides.stem_area) * lifts.shoulder
    return c.accumulation.volume + shoulder + (guides.stem_area - c.needle_seat.area) * lifts.tip


@physics
def longest_contact(c: Coefficients) -> float:
    """Longest contact [s] of a bouncing needle or valve with its seat: one period on the contact stiffness."""
    needle = c.plunger_needle.total_mass / c.needle_seat.contact_stiffness
    return contact_period(needle, 1.0 / (c.valve.per_mass * c.valve.contact_stiffness))


@physics
def contact_period(first: float, second: float) -> float:
    """Period of the slower of two masses on their contacts, 2π sqrt(m/k) [s], from m/k of each [s²]."""
    return 2.0 * math.pi * math.sqrt(max(first, second))


@physics
def farthest_lift(c: Coefficients) -> float:
    """Lift [m] beyond which plunger or needle have passed their stop; its negative bounds the seat."""
    return c.plunger_needle.guides.stop_lift + GIVE
