"""Laws that the reference solves at one instant: boundaries, coil and drives, without any time step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.base.choices import Boundary, Drive
from commonrail.physics import connections
from commonrail.physics.components import drive, flux_decay, solenoid
from commonrail.physics.flow.orifice import jet, orifice
from commonrail.physics.flow.volume import Contents, contents
from commonrail.physics.law import physics
from commonrail.physics.layout import layout_of
from commonrail.physics.model import Coefficients
from commonrail.physics.setup import ambient_density
from commonrail.physics.variants import Variant

# The pressure behind the valve follows the line within this time: a thirtieth of what a wave takes through a cell [s].
OUTLET_TIME = 1e-7


class Outside(NamedTuple):
    """Boundary pressures [Pa], and what drives the coil: schedule, PWM's transistor, trace."""

    rail: float
    cylinder: float
    low: float
    on: float
    peak: float
    conducting: float
    trace: float


OUTSIDE = layout_of(Outside)
AT: Any = OUTSIDE.load(range(len(OUTSIDE.paths)), 0, 1)  # where each stands in an array


class Drain(NamedTuple):
    """Flow out of the control chamber [kg/s], pressure behind the valve [Pa], flow into the line, rate of `outlet`."""

    flow: float
    behind: float
    line_flow: float
    outlet_rate: float


class Inlet(NamedTuple):
    """Rail pressure from outside [Pa], mass in a rail volume [kg], and flow into the feed pipe [kg/s]."""

    rail: float
    rail_mass: float
    flow: float


class Feed(NamedTuple):
    """Pressure at the feed pipe's inlet [Pa] and flow through the Z-hole [kg/s]."""

    inlet: float
    z_flow: float


@physics
def pressure_behind(c: Coefficients, outlet: float, wave: float) -> float:
    """Pressure behind the valve [Pa]; arguments as of `drain_flow`."""
    return max(outlet if c.return_line.impedance > 0.0 else wave, c.fuel.vapour_pressure)


@physics
def drain_flow(c: Coefficients, chamber: Contents, gap_cda2: float, outlet: float, wave: float) -> Drain:
    """Flow through A-hole and valve, Eq. (4), and into the return line.

    A small volume of liquid at the valve's outlet, which the line's impedance fills within `OUTLET_TIME`, gives the
    pressure there; it holds the vapour pressure while liquid is missing, as the other volumes do.

    `gap_cda2`: (c_d A)² of the valve's gap [m⁴]; `outlet`: of `Core` [Pa]; not used where there is no line; `wave`:
    that arrives in the line; the tank's pressure where there is no line [Pa].
    """
    z = c.return_line.impedance
    behind = pressure_behind(c, outlet, wave)
    through = connections.drain_cda2(c, chamber.pressure, behind, gap_cda2)
    flow = jet(through.cda2_dp, chamber.density, c.control_chamber.a_offset).mass_flow
    if z > 0.0:
        return Drain(flow, behind, (behind - wave) / z, (z * flow - (behind - wave)) / OUTLET_TIME)
    return Drain(flow, behind, flow, 0.0)


@physics
def coil_rates(
    c: Any, outside: Outside, law: Any, s: solenoid.State, gap: float, lags: tuple[float, float]
) -> solenoid.State:
    """Rates of both fluxes [V]: N dφ/dt = v − R i, Eq. (11), and dφ_f/dt = (φ − φ_f)/τ; of either actuation.

    `c`, `outside`: coefficients, and what comes from outside; `gap`: air gap that the armature leaves [m]; `lags`
    (float, float): of a rising and of a falling flux [s]; the first is zero for none.
    """
    rising, falling = lags
    now = solenoid.circuit(c.solenoid, s.flux, gap)
    supply = drive.Supply(drive.Schedule(outside.on, outside.peak), outside.trace)
    rate = law(c, outside, supply, now)
    pulling_rate = flux_decay.rate(s.flux, s.pulling_flux, rising, falling) if rising > 0.0 else rate
    return solenoid.State(rate, pulling_rate)


@physics
def inlet_ideal(c: Coefficients, at: Inlet, z_flow: float) -> float:
    """Pressure at the pipe's inlet: the rail's."""
    return at.rail


@physics
def inlet_throttled(c: Coefficients, at: Inlet, z_flow: float) -> float:
    """Pressure at the pipe's inlet behind the rail's throttle, Eq. (4) solved for the pressure."""
    rail = contents(c.fuel, at.rail_mass, 1.0 / c.rail.volume)
    total = at.flow + c.control_chamber.z_inlet_fraction * z_flow
    return rail.pressure - total * abs(total) / (2.0 * rail.density * c.rail.throttle_cda2)


@physics
def feed(c: Coefficients, law: Any, at: Inlet, accumulation: float, control: float) -> Feed:
    """Pressure at the inlet, and flow through the Z-hole.

    The Z-hole's flow needs the inlet's pressure, which (rail volume) needs that flow: six rounds converge.

    `law`: `inlet_law` of a variant; `accumulation`, `control`: pressures in accumulation volume and control chamber
    [Pa].
    """
    z_flow = 0.0
    inlet = at.rail
    from_inlet = c.control_chamber.z_inlet_fraction
    for _ in range(6):
        inlet = law(c, at, z_flow)
        source = from_inlet * inlet + (1.0 - from_inlet) * accumulation
        through = connections.z_hole_cda2(c, source, control)
        z_flow = orifice(through, ambient_density(c.source, source), c.control_chamber.z_offset).mass_flow
        if from_inlet == 0.0:
            break
    return Feed(inlet, z_flow)


@physics
def past_limit(c: Any, peak: float, conducting: float, flux: float, gap: float) -> float:
    """Positive once the PWM's current has passed the limit at which it switches; relative to its band.

    `flux`: linked by the coil [Wb]; `gap`: air gap that the armature leaves [m]; `peak`, `conducting`: as in `Outside`.
    """
    in_peak = peak > 0.5
    mean = c.drive.peak_current if in_peak else c.drive.hold_current
    band = c.drive.peak_band if in_peak else c.drive.hold_band
    over = (solenoid.circuit(c.solenoid, flux, gap).current - mean) / band
    return (over if conducting > 0.5 else -over) - 0.5


@physics
def regulated(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """Ideal regulator."""
    return drive.regulated(c.drive, c.solenoid, drive.State(1.0), supply, now, 0.0).flux_rate


@physics
def free_wheeling(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """Ideal regulator with a free-wheel diode."""
    return drive.free_wheel(c.drive, c.solenoid, drive.State(1.0), supply, now, 0.0).flux_rate


@physics
def switched(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """PWM whose transistor is set by the solver's events; after the end −boost until the current is gone."""
    live = drive.applied(c.solenoid, drive.pwm_voltage(c.drive, outside.conducting), now).flux_rate
    off = drive.switched_off(c.drive, c.solenoid, now).flux_rate
    return live if outside.on > 0.5 else off


@physics
def by_voltage(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """Measured voltage."""
    return drive.applied(c.solenoid, supply.trace, now).flux_rate


@physics
def by_current(c: Coefficients, outside: Outside, supply: drive.Supply, now: solenoid.Circuit) -> float:
    """Measured current."""
    return drive.current_trace(c.drive, c.solenoid, drive.State(1.0), supply, now, 0.0).flux_rate


def inlet_law(variant: Variant) -> Callable[..., float]:
    """Law of the pressure at the feed pipe's inlet."""
    return inlet_ideal if variant.boundary is Boundary.IDEAL else inlet_throttled


def coil_law(variant: Variant) -> Callable[..., float]:
    """Law of the coil's flux rate."""
    return {
        Drive.REGULATED: regulated,
        Drive.PWM: switched,
        Drive.VOLTAGE: by_voltage,
        Drive.CURRENT: by_current,
        Drive.FREE_WHEEL: free_wheeling,
    }[variant.drive]
