"""Laws that join rooms at one instant, without any time step: both engines use them."""

from __future__ import annotations

from typing import Any, NamedTuple

from commonrail.compile import physics, reciprocals
from commonrail.flow.leakage import leakage_slope
from commonrail.flow.orifice import Flow, choked, series
from commonrail.fuel import kernel as fuel
from commonrail.injector.model import Coefficients
from commonrail.injector.setup import accumulation_volume, control_volume
from commonrail.parts import sac
from commonrail.parts.plunger_needle import Motion

# A seated needle whose SAC has come this near to cylinder pressure has ended its injection [Pa].
RELAXED = 1e5


class Room(NamedTuple):
    """Volumes of control chamber, accumulation and SAC [m³]."""

    control: float
    store: float
    sac: float


class Drain(NamedTuple):
    """Drive of A-hole and valve, and its gains in the pressure before [m⁴] and behind it."""

    drive: float
    gain: float
    line_gain: float


# A needle is open once its tip has risen this far; what stays below is ringing of the closed or just closed needle [m].
CLEAR_LIFT = 5e-6

# A reopening below that lift counts too if more than this share of all that was injected flows meanwhile [1].
REOPENED = 1e-3


@physics
def middle(a: float, b: float) -> float:
    """Mean of two values."""
    return 0.5 * (a + b)


@physics
def seat_pressure(c: Coefficients, gap: float, upstream: float, behind: float) -> float:
    """Pressure [Pa] that opens the valve: what A-hole and seat, in series, leave in front of the seat."""
    hole = c.control_chamber.a_drive
    per_series, per_gap = reciprocals(hole + gap, max(gap, 1e-3 * hole))
    cavitating = c.control_chamber.a_choked * (upstream - c.fuel.vapour_pressure) * per_gap
    return min((upstream - behind) * hole * per_series, cavitating)


@physics
def make_room(c: Coefficients, lifts: Motion) -> Room:
    """Volumes that the plunger–needle leaves to the fuel."""
    return Room(
        control_volume(c, lifts),
        accumulation_volume(c, lifts),
        sac.volume(c.sac, c.needle_seat.area, lifts.tip),
    )


@physics
def nozzle_drive(c: Any, pressure: float, cylinder: float, discharge: float) -> tuple[float, float]:
    """Drive and gain of the nozzle's outflow at a discharge coefficient, cavitation included; of either actuation."""
    holes = c.nozzle.area_squared * discharge * discharge
    vapour = c.nozzle.choked * (pressure - c.fuel.vapour_pressure)
    return choked(holes * (pressure - cylinder), holes, vapour, c.nozzle.choked)


@physics
def guide_leak(c: Coefficients, conductance: float, pressure: float, low: float) -> Flow:
    """Leakage through a guide, Eq. (5), at the viscosity of its mean pressure."""
    slope = leakage_slope(conductance, fuel.fluidity(c.fuel, middle(pressure, low)))
    return Flow(slope * (pressure - low), slope)


@physics
def drain_drive(c: Coefficients, pressure: float, behind: float, gap: float) -> Drain:
    """Drive of the flow through A-hole and the valve's gap in series, cavitation in the A-hole included."""
    hole = c.control_chamber
    gain = series(hole.a_drive, gap)
    free = gain * (pressure - behind)
    drive_, gain_ = choked(free, gain, hole.a_choked * (pressure - c.fuel.vapour_pressure), hole.a_choked)
    return Drain(drive_, gain_, gain if drive_ == free else 0.0)


@physics
def z_hole_drive(c: Coefficients, feed: float, pressure: float) -> tuple[float, float]:
    """Drive of the flow through the Z-hole and its gain in the chamber's pressure, cavitation included."""
    hole = c.control_chamber
    vapour = hole.z_choked * (feed - c.fuel.vapour_pressure)
    return choked(hole.z_drive * (feed - pressure), hole.z_drive, vapour, 0.0)
