"""Nozzle: holes from the SAC to the cylinder, with the lift-dependent discharge coefficient, Eq. (9)."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

from commonrail.compile import physics
from commonrail.flow.orifice import laminar_offset, square
from commonrail.flow.wave import pipe_area
from commonrail.parts.furniture import Annotated, Domain, Q

# Eq. (9) shuts the holes at zero lift, which would cut a full SAC off from the cylinder. They are held
# open as at this lift, far below z0.
RESIDUAL_LIFT = 1e-6


class Parameters(NamedTuple):
    """Drawing of the nozzle and the constants of Eq. (9)."""

    holes: Annotated[float, Q("1", "number of nozzle holes")]
    hole_diameter: Annotated[float, Q("m", "diameter of a nozzle hole", usual=(0.03e-3, 1.5e-3))]
    discharge_transition: Annotated[float, Q("1", "c_d(z0) of Eq. (9)", Domain.COEFFICIENT)]
    discharge_maximum: Annotated[float, Q("1", "c_d(zM) of Eq. (9)", Domain.COEFFICIENT)]
    contraction: Annotated[float, Q("1", "contraction coefficient of a cavitating hole", Domain.POSITIVE, 0.85)]
    lift_maximum_slope: Annotated[float, Q("m/Pa", "K1 of zM = K1 p_CR + K2", Domain.ANY, usual=(-1e-10, 1e-10))]
    lift_maximum_offset: Annotated[float, Q("m", "K2 of zM = K1 p_CR + K2", Domain.ANY, usual=(-2e-3, 2e-3))]
    lift_transition_slope: Annotated[float, Q("m/Pa", "K3 of z0 = K3 p_CR + K4", Domain.ANY, usual=(-1e-10, 1e-10))]
    lift_transition_offset: Annotated[float, Q("m", "K4 of z0 = K3 p_CR + K4", Domain.ANY, usual=(-2e-3, 2e-3))]
    transition_reynolds: Annotated[
        float, Q("1", "Reynolds number at which viscous and inertial loss are equal", Domain.POSITIVE, 10.0)
    ]


class Coefficients(NamedTuple):
    """Hole area A² [m⁴], (C_c A)² [m⁴], laminar offset [kg/s], and Eq. (9) with z0, zM worked out."""

    area_squared: float
    choked: float
    offset: float
    discharge_transition: float
    lift_transition: float
    lift_maximum: float
    per_lift_transition: float
    discharge_slope: float


class State(NamedTuple):
    """Largest lift since the needle last rested on its seat [m]; fuel injected so far [kg]."""

    lift_reached: float
    injected: float


@physics
def coefficients(p: Parameters, rail_pressure: float, dynamic_viscosity: float) -> Coefficients:
    """Coefficients of Eq. (4) and (9).

    Parameters
    ----------
    p : Parameters
        Drawing and constants of Eq. (9).
    rail_pressure : float
        p_CR of time zero [Pa].
    dynamic_viscosity : float
        η at that pressure [Pa s].
    """
    area = p.holes * pipe_area(p.hole_diameter)
    # K1…K4 may have any sign: keep 0 < z0 < zM, whatever a search proposes
    knee = max(p.lift_transition_slope * rail_pressure + p.lift_transition_offset, RESIDUAL_LIFT)
    top = max(p.lift_maximum_slope * rail_pressure + p.lift_maximum_offset, knee + RESIDUAL_LIFT)
    return Coefficients(
        area * area,
        square(p.contraction * area),
        laminar_offset(dynamic_viscosity, p.transition_reynolds, p.holes * 0.25 * pi * p.hole_diameter),
        p.discharge_transition,
        knee,
        top,
        1.0 / knee,
        (p.discharge_maximum - p.discharge_transition) / (top - knee),
    )


@physics
def quarter_sine(s: float) -> float:
    """sin(π s/2) [1]: odd Taylor polynomial of degree 9, error < 4e-6.

    Parameters
    ----------
    s : float
        Lift over z0 [1], from 0 to 1.
    """
    x = 0.5 * pi * s
    y = x * x
    return x * (1.0 + y * (-1.0 / 6.0 + y * (1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0)))))


@physics
def discharge(c: Coefficients, lift_reached: float) -> float:
    """Discharge coefficient c_d of Eq. (9) [1].

    A needle that turns before zM closes with the coefficient it had reached, which Eq. (9), written for a
    full opening, leaves open.

    Parameters
    ----------
    c : Coefficients
        Of this nozzle.
    lift_reached : float
        Largest lift of this injection [m], ≥ 0: while the needle rises it is the lift itself (opening
        branches), after that it stays (closing branch, c_d constant).
    """
    z = max(lift_reached, RESIDUAL_LIFT)
    rising = quarter_sine(min(z * c.per_lift_transition, 1.0))
    beyond = min(max(z, c.lift_transition), c.lift_maximum) - c.lift_transition
    return c.discharge_transition * rising + c.discharge_slope * beyond
