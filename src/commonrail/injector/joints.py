"""Laws that join rooms at one instant, without any time step: both engines use them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from commonrail.compile import physics, reciprocals
from commonrail.flow.leakage import leakage_slope
from commonrail.flow.orifice import Flow, choked, jet, series
from commonrail.fuel import kernel as fuel
from commonrail.injector.model import Coefficients
from commonrail.injector.setup import accumulation_volume, control_volume
from commonrail.parts import sac, valve
from commonrail.parts.contents import Contents
from commonrail.parts.nozzle import RESIDUAL_LIFT
from commonrail.parts.plunger_needle import Motion

# Pressure drop below which the film on the valve's land counts as at this one, for a finite quotient [Pa].
LEAST_DROP = 1.0

# A seated needle whose SAC has come this near to cylinder pressure has ended its injection [Pa].
RELAXED = 1e5

PER_RESIDUAL, PER_RELAXED = 1.0 / RESIDUAL_LIFT, 1.0 / RELAXED  # in single precision every division is carried out


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
def fading_share(tip: float, excess: float) -> float:
    """Share of the memory of c_d that fades [1]: all on the seat with an empty SAC, none from `RESIDUAL_LIFT` on.

    Linear in the lift and in the SAC's pressure up to `RELAXED`, which is about what a gap of that lift lets through:
    so neither a touch of the seat nor the step in which it falls makes a jump.

    Parameters
    ----------
    tip : float
        Lift of the needle [m].
    excess : float
        Of the SAC over cylinder pressure [Pa].
    """
    return min(max(1.0 - tip / RESIDUAL_LIFT, 0.0), 1.0) * relaxed_share(excess)


@physics
def relaxed_share(excess: float) -> float:
    """Share of `fading_share` that the SAC leaves [1]: all of it at cylinder pressure, none from `RELAXED` on.

    Parameters
    ----------
    excess : float
        Of the SAC over cylinder pressure [Pa].
    """
    return min(max(1.0 - excess * PER_RELAXED, 0.0), 1.0)


@physics
def remembered_lift(c: Any, s: Any, tip: float, cylinder: float) -> float:
    """Lift that c_d remembers over a step [m]: on the seat the exact decay of `memory_rate`; of either actuation.

    Parameters
    ----------
    c, s
        Coefficients and state.
    tip : float
        Lift of the needle at the middle of the step [m].
    cylinder : float
        Pressure in the cylinder [Pa].
    """
    # with the tip last: it comes late, and all of the injection waits for this lift
    most = s.nozzle.lift_reached
    lost = most * (c.delays.lift_lost * relaxed_share(s.sac.pressure - cylinder))
    least = most - lost
    return min(max(least + lost * PER_RESIDUAL * tip, least), most)


@physics
def memory_rate(c: Any, lift_reached: float, tip: float, rise: float, excess: float) -> float:
    """Rate of the lift that c_d remembers [m/s]: it follows a rising needle, and fades at rest; of either actuation.

    It fades by no more than a touch of the seat lasts; with a reset the quantity would jump at the first touch.

    Parameters
    ----------
    c
        Coefficients.
    lift_reached : float
        Lift that c_d remembers [m].
    tip, rise : float
        Lift [m] and speed [m/s] of the needle.
    excess : float
        Of the SAC over cylinder pressure [Pa].
    """
    rising = max(rise, 0.0) if tip >= lift_reached else 0.0
    return rising - fading_share(tip, excess) * lift_reached / c.nozzle.memory


@physics
def plain_gap(c: Coefficients, chamber: Contents, behind: float, lift: float) -> float:
    """(c_d A)² of the valve's gap, for Eq. (4) [m⁴]; signature as of `land_gap`."""
    return valve.gap_drive(c.valve, lift)


@physics
def land_gap(c: Coefficients, chamber: Contents, behind: float, lift: float) -> float:
    """(c_d A)² of the valve's gap with the film on its land [m⁴], at the present pressures.

    A-hole, gap and film in series pass Δp = q²/(2 ρ g) + R q, 1/g = 1/g_A + 1/g_s, at most what the cavitating A-hole
    passes. The gap that takes the same pressure at this flow is 1/(1/g_s + 2 ρ R/q).

    Parameters
    ----------
    c : Coefficients
    chamber : Contents
        Of the control chamber.
    behind : float
        Pressure behind the valve [Pa].
    lift : float
        Of the valve [m].
    """
    hole, gap = c.control_chamber, valve.gap_drive(c.valve, lift)
    resistance = valve.land_resistance(c.valve, lift, fuel.fluidity(c.fuel, middle(chamber.pressure, behind)))
    total = series(hole.a_drive, gap)
    drop = max(abs(chamber.pressure - behind), LEAST_DROP)
    offset = chamber.density * total * resistance
    # 2 ρ g_s/q, free and cavitating; without cancellation where friction rules
    free = (jet(total * drop, chamber.density, offset).root + offset) * (1.0 + gap / hole.a_drive) / drop
    vapour = hole.a_choked * max(chamber.pressure - c.fuel.vapour_pressure, LEAST_DROP)
    cavitating = gap * math.sqrt(2.0 * chamber.density / vapour)
    return gap / (1.0 + resistance * max(free, cavitating))


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
