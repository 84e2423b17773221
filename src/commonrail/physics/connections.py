"""Laws that connect the components at one instant, used by the fast step and by the reference's equations."""

from __future__ import annotations

import math
from typing import NamedTuple

from commonrail.physics import fuel_kernel as fuel
from commonrail.physics.components import control_chamber, needle_seat, valve
from commonrail.physics.components.nozzle import RESIDUAL_LIFT
from commonrail.physics.components.plunger_needle import Motion
from commonrail.physics.flow import (
    Contents,
    Flow,
    Guide,
    Restriction,
    conductance_growth,
    jet,
    leakage_slope,
    limit_by_cavitation,
    orifice,
    series,
)
from commonrail.physics.law import physics
from commonrail.physics.model import Coefficients, SharedCoefficients, SharedState, accumulation_volume, control_volume

# Pressure drop below which the film on the valve's land counts as at this one, for a finite quotient [Pa].
LEAST_DROP = 1.0

# A seated needle whose SAC has come this near to cylinder pressure has ended its injection [Pa].
RELAXED = 1e5

PER_RESIDUAL, PER_RELAXED = 1.0 / RESIDUAL_LIFT, 1.0 / RELAXED  # in single precision every division is carried out


class Volumes(NamedTuple):
    """Volumes of control chamber, accumulation and SAC [m³]."""

    control: float
    accumulation: float
    sac: float


class Drain(NamedTuple):
    """(c_d A)² Δp of A-hole and valve [m⁴ Pa], its derivatives in the pressures before and (negated) after [m⁴]."""

    cda2_dp: float
    cda2: float
    line_cda2: float


class Hole(NamedTuple):
    """A hole's (c_d A)² without cavitation and (C_c A)² in full cavitation [m⁴]."""

    cda2: float
    choked: float


# A needle is open once its tip has risen this far; what stays below is ringing of the closed or just closed needle [m].
CLEAR_LIFT = 5e-6

# A reopening below that lift counts too if more than this share of all that was injected flows meanwhile [1].
REOPENED = 1e-3


@physics
def middle(a: float, b: float) -> float:
    """Mean of two values."""
    return 0.5 * (a + b)


@physics
def a_hole(hole: control_chamber.Coefficients, pressure: float, behind: float) -> Hole:
    """A-hole of the paper, equal at all pressures. Installed packages may replace this law.

    `pressure`, `behind`: in the control chamber and downstream of the valve [Pa].
    """
    return Hole(hole.a_cda2, hole.a_cda2_choked)


@physics
def seat_pressure(c: Coefficients, hole: Hole, gap_cda2: float, upstream: float, behind: float) -> float:
    """Pressure difference over the valve's seat [Pa], which opens it, with A-hole and seat in series.

    `hole`: the A-hole; `gap_cda2`: (c_d A)² of the valve's gap [m⁴]; `upstream`, `behind`: pressures in the control
    chamber and downstream of the valve [Pa].
    """
    free, both = (upstream - behind) * hole.cda2, hole.cda2 + gap_cda2
    cavitating, gap = hole.choked * (upstream - c.fuel.vapour_pressure), max(gap_cda2, 1e-3 * hole.cda2)
    limited = cavitating * both < free * gap
    return (cavitating if limited else free) / (gap if limited else both)


@physics
def volumes_of(c: Coefficients, lifts: Motion) -> Volumes:
    """Fuel volumes at the given lifts of plunger and needle."""
    return Volumes(
        control_volume(c, lifts),
        accumulation_volume(c, lifts),
        needle_seat.sac_volume(c.sac, c.needle_seat.area, lifts.tip),
    )


@physics
def seat_cda2(c: SharedCoefficients, upstream: float, sac_pressure: float, tip: float) -> Restriction:
    """Restriction of the needle seat's gap, with its derivative. Shared by servo and direct-acting injectors.

    `upstream`, `sac_pressure`: pressures in front of the seat and in the SAC [Pa]; `tip`: lift of the needle's tip [m].
    """
    cda2 = needle_seat.gap_cda2(c.needle_seat, tip)
    return Restriction(cda2 * (upstream - sac_pressure), cda2)


@physics
def nozzle_cda2(c: SharedCoefficients, pressure: float, cylinder: float, discharge: float) -> Restriction:
    """Restriction of the nozzle's holes, cavitation included, with its derivative in the SAC's pressure.

    `pressure`, `cylinder`: pressures in SAC and cylinder [Pa]; `discharge`: c_d of Eq. (9) [1].
    """
    cda2, cavitating = c.nozzle.area_squared * discharge * discharge, c.nozzle.cda2_choked
    return limit_by_cavitation(
        Restriction(cda2 * (pressure - cylinder), cda2),
        Restriction(cavitating * (pressure - c.fuel.vapour_pressure), cavitating),
    )


@physics
def seat_flow(c: SharedCoefficients, upstream: Contents, sac: Contents, tip: float) -> Flow:
    """Flow through the needle seat, Eq. (4), from the accumulation volume into the SAC at a lift of the tip [m]."""
    return orifice(seat_cda2(c, upstream.pressure, sac.pressure, tip), upstream.density, c.needle_seat.offset)


@physics
def nozzle_flow(c: SharedCoefficients, sac: Contents, cylinder: float, discharge: float) -> Flow:
    """Flow through the nozzle's holes, Eq. (4), into the cylinder's pressure [Pa] at a coefficient c_d [1]."""
    return orifice(nozzle_cda2(c, sac.pressure, cylinder, discharge), sac.density, c.nozzle.offset)


@physics
def guide_leak(c: Coefficients, guide: Guide, pressure: float, low: float) -> Flow:
    """Leakage through a guide, Eq. (5), at the viscosity of its mean pressure.

    `guide`: guide with a rigid gap; `pressure`, `low`: at both ends [Pa].
    """
    slope = leakage_slope(guide.conductance, fuel.fluidity(c.fuel, middle(pressure, low)))
    return Flow(slope * (pressure - low), slope)


@physics
def widening_leak(c: Coefficients, guide: Guide, pressure: float, low: float) -> Flow:
    """Leakage through a guide whose gap the pressure widens, Eq. (5), gap and viscosity at the mean pressure.

    `pressure`, `low`: at both ends [Pa].
    """
    mean = middle(pressure, low)
    slope = leakage_slope(guide.conductance * conductance_growth(guide.growth, mean), fuel.fluidity(c.fuel, mean))
    return Flow(slope * (pressure - low), slope)


@physics
def fading_share(tip: float, excess: float) -> float:
    """Share of the memory of c_d that fades [1]: all on the seat with an empty SAC, none from `RESIDUAL_LIFT` on.

    Linear in the lift and in the SAC's pressure up to `RELAXED`, which is about what a gap of that lift lets through:
    so neither a touch of the seat nor the step in which it falls makes a jump.

    `tip`: lift of the needle [m]; `excess`: of the SAC over cylinder pressure [Pa].
    """
    return min(max(1.0 - tip / RESIDUAL_LIFT, 0.0), 1.0) * relaxed_share(excess)


@physics
def relaxed_share(excess: float) -> float:
    """Share of `fading_share` that the SAC leaves [1]: all of it at cylinder pressure, none from `RELAXED` on.

    `excess`: of the SAC over cylinder pressure [Pa].
    """
    return min(max(1.0 - excess * PER_RELAXED, 0.0), 1.0)


@physics
def remembered_lift(c: SharedCoefficients, s: SharedState, tip: float, cylinder: float) -> float:
    """Lift that c_d remembers over a step [m]: on the seat the exact decay of `memory_rate`. For both actuations.

    `tip`: lift of the needle at the middle of the step [m]; `cylinder`: pressure in the cylinder [Pa].
    """
    # `tip` enters last: it is on the critical path of the step
    most = s.nozzle.lift_reached
    lost = most * (c.delays.memory_lag_fraction * relaxed_share(s.sac.pressure - cylinder))
    least = most - lost
    return min(max(least + lost * PER_RESIDUAL * tip, least), most)


@physics
def memory_rate(c: SharedCoefficients, lift_reached: float, tip: float, rise: float, excess: float) -> float:
    """Rate of the lift that c_d remembers [m/s]: it follows a rising needle and fades at rest. For both actuations.

    It fades by no more than a touch of the seat lasts; with a reset the quantity would jump at the first touch.

    `lift_reached`: lift that c_d remembers [m]; `tip`, `rise`: lift [m] and speed [m/s] of the needle; `excess`: of the
    SAC over cylinder pressure [Pa].
    """
    rising = max(rise, 0.0) if tip >= lift_reached else 0.0
    return rising - fading_share(tip, excess) * lift_reached / c.nozzle.memory


@physics
def plain_gap_cda2(c: Coefficients, hole: Hole, chamber: Contents, behind: float, lift: float) -> float:
    """(c_d A)² of the valve's gap, for Eq. (4) [m⁴]; same signature as `land_gap_cda2`."""
    return valve.gap_cda2(c.valve, lift)


@physics
def land_gap_cda2(c: Coefficients, hole: Hole, chamber: Contents, behind: float, lift: float) -> float:
    """(c_d A)² of the valve's gap with the film on its land [m⁴], at the present pressures.

    A-hole, gap and film in series pass Δp = q²/(2 ρ g) + R q, 1/g = 1/g_A + 1/g_s, at most what the cavitating A-hole
    passes. The gap that takes the same pressure at this flow is 1/(1/g_s + 2 ρ R/q).

    `hole`: the A-hole; `behind`: pressure downstream of the valve [Pa]; `lift`: of the valve [m].
    """
    gap = valve.gap_cda2(c.valve, lift)
    resistance = valve.land_resistance(c.valve, lift, fuel.fluidity(c.fuel, middle(chamber.pressure, behind)))
    cda2 = series(hole.cda2, gap)
    drop = max(abs(chamber.pressure - behind), LEAST_DROP)
    offset = chamber.density * cda2 * resistance
    # 2 ρ g_s/q, free and cavitating; without cancellation where friction rules
    free = (jet(cda2 * drop, chamber.density, offset).root + offset) * (1.0 + gap / hole.cda2) / drop
    vapour = hole.choked * max(chamber.pressure - c.fuel.vapour_pressure, LEAST_DROP)
    cavitating = gap * math.sqrt(2.0 * chamber.density / vapour)
    return gap / (1.0 + resistance * max(free, cavitating))


@physics
def drain_cda2(c: Coefficients, hole: Hole, pressure: float, behind: float, gap_cda2: float) -> Drain:
    """Restriction of A-hole and valve in series, cavitation in the A-hole included.

    `hole`: the A-hole; `pressure`, `behind`: in the control chamber and behind the valve [Pa]; `gap_cda2`: (c_d A)² of
    the valve's gap [m⁴].
    """
    cda2 = series(hole.cda2, gap_cda2)
    free = Restriction(cda2 * (pressure - behind), cda2)
    cavitating = Restriction(hole.choked * (pressure - c.fuel.vapour_pressure), hole.choked)
    through = limit_by_cavitation(free, cavitating)
    return Drain(through.cda2_dp, through.cda2, cda2 if through.cda2_dp == free.cda2_dp else 0.0)


@physics
def z_hole_cda2(c: Coefficients, feed: float, pressure: float) -> Restriction:
    """Restriction of the Z-hole, cavitation included; its derivative in the chamber's pressure.

    `feed`, `pressure`: in front of the hole and in the control chamber [Pa].
    """
    hole = c.control_chamber
    free = Restriction(hole.z_cda2 * (feed - pressure), hole.z_cda2)
    return limit_by_cavitation(free, Restriction(hole.z_cda2_choked * (feed - c.fuel.vapour_pressure), 0.0))
