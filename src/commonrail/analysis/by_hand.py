"""The laws of steady flow written out once more, from the drawing and the fuel's own laws alone.

Nothing here uses the model's coefficients or its fuel polynomials: `closed_forms` sets runs beside these figures.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from commonrail.injector.definition import FUEL_TEMPERATURE, Injector

RAIL = 160e6  # [Pa]


class Fluid(NamedTuple):
    """Fuel at the rail pressure by its own laws: ρ [kg/m³], a [m/s], isothermal K [Pa], η [Pa s]."""

    density: float
    sound_speed: float
    modulus: float
    viscosity: float


def fluid(injector: Injector) -> Fluid:
    """The fuel at `RAIL` by the host's laws, not the hot loop's polynomials."""
    temperature, fuel = injector.values[FUEL_TEMPERATURE], injector.fuel
    density = float(fuel.density(RAIL, temperature))
    return Fluid(
        density,
        float(fuel.sound_speed(RAIL, temperature)),
        float(fuel.bulk_modulus(RAIL, temperature)),
        density * float(fuel.kinematic_viscosity(RAIL, temperature)),
    )


def pipe_area(injector: Injector) -> float:
    """Cross-section of the feed pipe [m²]."""
    return math.pi / 4.0 * injector.values["feed_pipe.diameter"] ** 2


def nozzle_by_hand(injector: Injector, lift: float) -> tuple[float, float]:
    """Mass flow [kg/s] and SAC pressure [Pa] at which seat and nozzle, held at a lift [m], pass the same."""
    from scipy.optimize import brentq  # slow to import

    p, at = injector.parameters, fluid(injector)
    half = 0.5 * p.needle_seat.cone_angle
    way = lift * math.sin(half)
    gap = p.needle_seat.discharge * math.pi * way * (p.needle_seat.diameter - way * math.cos(half))
    holes = p.nozzle.holes * math.pi / 4.0 * p.nozzle.hole_diameter**2
    discharge = _equation_9(injector, lift) * holes
    choked = p.nozzle.contraction * holes
    seat_offset = _offset(at, p.needle_seat.transition_reynolds, 0.5 * math.pi * p.needle_seat.diameter)
    hole_width = p.nozzle.holes * math.pi / 4.0 * p.nozzle.hole_diameter
    hole_offset = _offset(at, p.nozzle.transition_reynolds, hole_width)
    temperature = injector.values[FUEL_TEMPERATURE]
    vapour = float(injector.fuel.vapour_pressure(temperature))

    def through_seat(sac: float) -> float:
        return _turbulent(gap, RAIL - sac, at.density, seat_offset)

    def excess(sac: float) -> float:
        density = float(injector.fuel.density(sac, temperature))
        full = min(discharge**2 * (sac - 5e6), choked**2 * (sac - vapour))
        return through_seat(sac) - _turbulent(1.0, full, density, hole_offset)

    sac = float(brentq(excess, 5.1e6, RAIL - 1e3))
    return through_seat(sac), sac


def drain_by_hand(injector: Injector, valve_lift: float) -> tuple[float, float]:
    """Mass flow [kg/s] and control pressure [Pa] at which Z-hole, and A-hole with valve, pass the same."""
    from scipy.optimize import brentq  # slow to import

    p, at, low = injector.parameters, fluid(injector), 0.5e6
    hole = p.control_chamber
    z_area, a_area = (math.pi / 4.0 * d**2 for d in (hole.z_hole_diameter, hole.a_hole_diameter))
    ring = math.pi * p.valve.seat_diameter * valve_lift * math.sin(p.valve.seat_angle)
    first, second = hole.a_hole_discharge * a_area, p.valve.seat_discharge * ring
    both = 1.0 / math.sqrt(first**-2 + second**-2)
    temperature = injector.values[FUEL_TEMPERATURE]
    vapour = float(injector.fuel.vapour_pressure(temperature))
    z_offset, a_offset = (
        _offset(at, hole.transition_reynolds, math.pi / 4.0 * d) for d in (hole.z_hole_diameter, hole.a_hole_diameter)
    )

    def through_z(pressure: float) -> float:
        drive = min(
            (hole.z_hole_discharge * z_area) ** 2 * (RAIL - pressure),
            (hole.z_hole_contraction * z_area) ** 2 * (RAIL - vapour),
        )
        return _turbulent(1.0, drive, at.density, z_offset)

    def excess(pressure: float) -> float:
        density = float(injector.fuel.density(pressure, temperature))
        choked = (hole.a_hole_contraction * a_area) ** 2 * (pressure - vapour)
        return through_z(pressure) - _turbulent(1.0, min(both**2 * (pressure - low), choked), density, a_offset)

    pressure = float(brentq(excess, 1e6, RAIL - 1e3))
    return through_z(pressure), pressure


def _equation_9(injector: Injector, lift: float) -> float:
    n = injector.parameters.nozzle
    top = n.lift_maximum_slope * RAIL + n.lift_maximum_offset
    knee = n.lift_transition_slope * RAIL + n.lift_transition_offset
    if lift < knee:
        return float(n.discharge_transition * math.sin(0.5 * math.pi * lift / knee))
    share = min((lift - knee) / (top - knee), 1.0)
    return float(n.discharge_transition + (n.discharge_maximum - n.discharge_transition) * share)


def _offset(at: Fluid, reynolds: float, width: float) -> float:
    """Half the mass flow at the transition Reynolds number of a hole, [kg/s]."""
    return 0.5 * at.viscosity * reynolds * width


def _turbulent(effective: float, drop: float, density: float, offset: float) -> float:
    """Eq. (4) with its laminar limit [kg/s]: c_d A [m²], Δp [Pa]."""
    return math.sqrt(offset**2 + 2.0 * density * effective**2 * drop) - offset
