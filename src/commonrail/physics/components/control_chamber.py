"""Control chamber above the plunger: fed through the Z-hole, drained through the A-hole, Eq. (3), (4)."""

from __future__ import annotations

from math import pi
from typing import Annotated, NamedTuple

from commonrail.physics.flow import Contents, laminar_offset, pipe_area, square
from commonrail.physics.law import Domain, Q, physics


class Parameters(NamedTuple):
    """Drawing of the control chamber and its two holes."""

    volume: Annotated[
        float, Q("m3", "control chamber volume, plunger unloaded on the closed needle", usual=(1e-9, 1e-6))
    ]
    z_hole_diameter: Annotated[float, Q("m", "diameter of the Z-hole (inlet throttle)", usual=(0.03e-3, 1.5e-3))]
    z_hole_discharge: Annotated[float, Q("1", "discharge coefficient of the Z-hole", Domain.COEFFICIENT, 0.78)]
    z_hole_contraction: Annotated[
        float, Q("1", "contraction coefficient of the cavitating Z-hole", Domain.POSITIVE, 0.85)
    ]
    z_hole_from_inlet: Annotated[
        float,
        Q(
            "1",
            "share of the Z-hole's flow taken at the pipe's inlet (1) or from the accumulation volume (0)",
            Domain.UNIT,
            1.0,
        ),
    ]
    a_hole_diameter: Annotated[float, Q("m", "diameter of the A-hole (outlet throttle)", usual=(0.03e-3, 1.5e-3))]
    a_hole_discharge: Annotated[
        float, Q("1", "discharge coefficient of the A-hole, not cavitating", Domain.COEFFICIENT, 0.82)
    ]
    a_hole_contraction: Annotated[
        float, Q("1", "contraction coefficient of the cavitating A-hole", Domain.POSITIVE, 0.62)
    ]
    transition_reynolds: Annotated[
        float, Q("1", "Reynolds number at which viscous and inertial loss of a hole are equal", Domain.POSITIVE, 10.0)
    ]


class Coefficients(NamedTuple):
    """Volume [m³], (c_d A)² and (C_c A)² of the holes [m⁴], laminar offsets [kg/s], share of Z-hole from inlet [1]."""

    volume: float
    z_cda2: float
    z_cda2_choked: float
    z_offset: float
    z_inlet_fraction: float
    a_cda2: float
    a_cda2_choked: float
    a_offset: float


class State(NamedTuple):
    """Fuel in the chamber, and the Z-hole's mean flow over the last step [kg/s]."""

    fuel: Contents
    z_flow: float


@physics
def coefficients(p: Parameters, dynamic_viscosity: float) -> Coefficients:
    """Coefficients of the holes, Eq. (4); `dynamic_viscosity`: η at the rail pressure of time zero [Pa s]."""
    z_area = pipe_area(p.z_hole_diameter)
    a_area = pipe_area(p.a_hole_diameter)
    reynolds = p.transition_reynolds
    return Coefficients(
        volume=p.volume,
        z_cda2=square(p.z_hole_discharge * z_area),
        z_cda2_choked=square(p.z_hole_contraction * z_area),
        z_offset=laminar_offset(dynamic_viscosity, reynolds, 0.25 * pi * p.z_hole_diameter),
        z_inlet_fraction=p.z_hole_from_inlet,
        a_cda2=square(p.a_hole_discharge * a_area),
        a_cda2_choked=square(p.a_hole_contraction * a_area),
        a_offset=laminar_offset(dynamic_viscosity, reynolds, 0.25 * pi * p.a_hole_diameter),
    )
