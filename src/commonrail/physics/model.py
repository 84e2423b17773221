"""The whole injector as data: parameters, coefficients and state of all components, and what comes from outside."""

from __future__ import annotations

from typing import Any, NamedTuple

from commonrail.physics.components import (
    accumulation,
    control_chamber,
    drive,
    feed_pipe,
    needle_seat,
    nozzle,
    plunger_needle,
    rail,
    return_line,
    sac,
    solenoid,
    valve,
)
from commonrail.physics.flow.volume import Contents
from commonrail.physics.fuel_kernel import FuelCoefficients


class Parameters(NamedTuple):
    """Every parameter of the injector (SI), component by component: ``p.plunger_needle.k1``."""

    rail: rail.Parameters
    feed_pipe: feed_pipe.Parameters
    control_chamber: control_chamber.Parameters
    valve: valve.Parameters
    solenoid: solenoid.Parameters
    drive: drive.Parameters
    return_line: return_line.Parameters
    accumulation: accumulation.Parameters
    plunger_needle: plunger_needle.Parameters
    needle_seat: needle_seat.Parameters
    sac: sac.Parameters
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
    """Travel times in steps; shares of the eddy lag that a step makes up, and of c_d's memory that it takes [1]."""

    feed: float
    back: float
    eddy_lag_fraction: float
    memory_lag_fraction: float


class Coefficients(NamedTuple):
    """Numbers that the step needs, computed once per candidate and operating point."""

    fuel: FuelCoefficients
    rail: rail.Coefficients
    feed_pipe: feed_pipe.Coefficients
    control_chamber: control_chamber.Coefficients
    valve: valve.Coefficients
    solenoid: solenoid.Coefficients
    drive: drive.Parameters
    return_line: return_line.Coefficients
    plunger_needle: plunger_needle.Coefficients
    needle_seat: needle_seat.Coefficients
    accumulation: accumulation.Parameters
    sac: sac.Parameters
    nozzle: nozzle.Coefficients
    source: Ambient
    cylinder: Ambient
    delays: Delays


class CumulativeFlows(NamedTuple):
    """Fuel given to the return and supplied by the rail so far [kg]."""

    returned: float
    supplied: float


class State(NamedTuple):
    """State at t_n. `body` is that of the chain or of the rigid body."""

    rail: Contents
    feed_pipe: feed_pipe.State
    control_chamber: control_chamber.State
    valve: valve.State
    solenoid: solenoid.State
    drive: drive.State
    return_line: return_line.State
    accumulation: accumulation.State
    body: Any
    sac: Contents
    nozzle: nozzle.State
    cumulative_flows: CumulativeFlows


class Waves(NamedTuple):
    """Means over a step of the waves [Pa] at their ends: down the feed pipe, up it, and in the return line."""

    down: float
    up: float
    back: float


class Inputs(NamedTuple):
    """Means over a step of the boundary pressures [Pa] and of the drive's trace, and the energising's clock [s]."""

    rail: float
    cylinder: float
    low: float
    trace: float
    since_start: float
    since_end: float
