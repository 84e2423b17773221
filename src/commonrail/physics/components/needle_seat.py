"""Needle seat, and the volumes upstream and downstream of it: accumulation volume and SAC, Eq. (3)."""

from __future__ import annotations

from math import pi
from typing import Annotated, NamedTuple

from commonrail.physics.elementary import cosine, sine
from commonrail.physics.flow import Contents, laminar_offset, pipe_area
from commonrail.physics.law import Domain, Q, physics

TINY_PATH = 1e-20  # what counts as no path of the needle [m]


class AccumulationParameters(NamedTuple):
    """Drawing of the accumulation volume around the needle, fed by the pipe."""

    volume: Annotated[float, Q("m3", "accumulation volume, needle unloaded on its seat", usual=(5e-9, 2e-5))]


class AccumulationState(NamedTuple):
    """Fuel in the volume, and its pressure one step before [Pa]."""

    fuel: Contents
    pressure_before: float


class SacParameters(NamedTuple):
    """Drawing of the SAC, the small volume between needle seat and nozzle holes."""

    volume: Annotated[float, Q("m3", "SAC volume, needle on its seat", usual=(0.01e-9, 50e-9))]


class SacCoefficients(NamedTuple):
    """SAC volume with the needle on its seat [m³], and its inverse [1/m³]."""

    volume: float
    per_volume: float


@physics
def sac_coefficients(p: SacParameters) -> SacCoefficients:
    """Volume of the SAC [m³] and its inverse [1/m³]."""
    return SacCoefficients(p.volume, 1.0 / p.volume)


@physics
def sac_volume(c: SacCoefficients, seat_area: float, tip_lift: float) -> float:
    """SAC volume V of Eq. (3) [m³].

    `seat_area`: area inside the seat line [m²]; `tip_lift`: lift of the needle's tip [m]; below zero it is elastic
    flattening of the seat and does not shrink the SAC.
    """
    return c.volume + seat_area * max(tip_lift, 0.0)


class Opening(NamedTuple):
    """Mean of max(z, 0) over a step [m], z being the lift, and the share of the step in which the seat is open [1]."""

    mean: float
    share: float


@physics
def opening_between(before: float, after: float) -> Opening:
    """Mean opening [m] over a step, and the share of the step in which the seat is open [1], on a straight path.

    Both are smooth in the lifts, wherever in the step the needle meets its seat.

    `before`, `after`: lift of the needle's tip at both ends of the step [m].
    """
    both = max(before, 0.0) + max(after, 0.0)
    share = both / max(abs(before) + abs(after), TINY_PATH)
    return Opening(0.5 * both * share, share)


class Parameters(NamedTuple):
    """Drawing of the seat between needle cone and body."""

    diameter: Annotated[float, Q("m", "seat diameter", usual=(0.3e-3, 10e-3))]
    cone_angle: Annotated[float, Q("rad", "full angle of the seat cone", Domain.CONE, usual=(0.35, 2.6))]
    discharge: Annotated[float, Q("1", "discharge coefficient of the seat gap", Domain.COEFFICIENT, 0.8)]
    contact_stiffness: Annotated[
        float, Q("N/m", "stiffness of needle on seat", Domain.POSITIVE, 2e8, usual=(1e6, 1e10))
    ]
    contact_damping: Annotated[float, Q("s/m", "Hunt–Crossley factor of the seat", Domain.NON_NEGATIVE, 0.2)]
    transition_reynolds: Annotated[
        float, Q("1", "Reynolds number at which viscous and inertial loss are equal", Domain.POSITIVE, 10.0)
    ]


class Coefficients(NamedTuple):
    """Area inside the seat line [m²], gap geometry, laminar offset [kg/s], contact."""

    area: float
    gap_slope: float
    gap_curvature: float
    offset: float
    contact_stiffness: float
    contact_damping: float


@physics
def coefficients(p: Parameters, dynamic_viscosity: float) -> Coefficients:
    """Coefficients of gap and contact; `dynamic_viscosity`: η at the rail pressure of time zero [Pa s]."""
    across, along = sine(0.5 * p.cone_angle), cosine(0.5 * p.cone_angle)
    return Coefficients(
        pipe_area(p.diameter),
        p.discharge * pi * across * p.diameter,
        p.discharge * pi * across * across * along,
        laminar_offset(dynamic_viscosity, p.transition_reynolds, 0.5 * pi * p.diameter),
        p.contact_stiffness,
        p.contact_damping,
    )


@physics
def gap_cda2(c: Coefficients, lift: float) -> float:
    """(c_d A)² of the seat gap, for Eq. (4) [m⁴]: frustum A = π z sin(α/2) (d − z sin(α/2) cos(α/2)).

    `lift`: z of the needle's tip [m]; shut at zero and below.
    """
    z = max(lift, 0.0)
    effective = z * (c.gap_slope - c.gap_curvature * z)
    return effective * effective
