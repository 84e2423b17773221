"""Direct-acting injector as data: parameters, coefficients and state of the components that it has.

No control chamber, no A- and Z-hole, no control valve and no return: the armature moves the needle. Components that
both injectors have bear the same names in both, so that the laws between them (`joints`, `step.fill_sac`) serve both.
"""

from __future__ import annotations

from typing import NamedTuple

from commonrail.fuel.kernel import FuelCoefficients
from commonrail.injector.model import Ambient, CumulativeFlows
from commonrail.parts import (
    accumulation,
    armature,
    direct_needle,
    drive,
    feed_pipe,
    flux_decay,
    needle_seat,
    nozzle,
    sac,
    solenoid,
)
from commonrail.parts.contents import Contents


class Parameters(NamedTuple):
    """Every parameter of the direct-acting injector (SI), component by component."""

    feed_pipe: feed_pipe.Parameters
    solenoid: solenoid.Parameters
    flux_decay: flux_decay.Parameters
    drive: drive.Parameters
    armature: armature.Parameters
    needle: direct_needle.Parameters
    accumulation: accumulation.Parameters
    needle_seat: needle_seat.Parameters
    sac: sac.Parameters
    nozzle: nozzle.Parameters


class Delays(NamedTuple):
    """Travel time in steps; shares of the flux's lag that a step makes up, and of c_d's memory that it takes [1]."""

    feed: float
    rising: float
    falling: float
    memory_lag_fraction: float


class Coefficients(NamedTuple):
    """Numbers that the step needs, computed once per candidate and operating point."""

    fuel: FuelCoefficients
    feed_pipe: feed_pipe.Coefficients
    solenoid: solenoid.Coefficients
    flux_decay: flux_decay.Parameters
    drive: drive.Parameters
    armature: armature.Coefficients
    needle: direct_needle.Coefficients
    needle_seat: needle_seat.Coefficients
    accumulation: accumulation.Parameters
    sac: sac.Parameters
    nozzle: nozzle.Coefficients
    cylinder: Ambient
    delays: Delays


class State(NamedTuple):
    """State at t_n."""

    feed_pipe: feed_pipe.State
    solenoid: solenoid.State
    drive: drive.State
    accumulation: accumulation.State
    body: direct_needle.State
    sac: Contents
    nozzle: nozzle.State
    cumulative_flows: CumulativeFlows
