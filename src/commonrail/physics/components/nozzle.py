"""Nozzle: holes from the SAC to the cylinder, with the lift-dependent discharge coefficient, Eq. (9), and its shape."""

from __future__ import annotations

from math import pi
from typing import Annotated, NamedTuple

from commonrail.physics.flow import laminar_offset, pipe_area, square
from commonrail.physics.law import Domain, Q, physics

# Eq. (9) shuts the holes at zero lift, which would cut a full SAC off from the cylinder. They are held
# open as at this lift [m], far below z0.
RESIDUAL_LIFT = 1e-6

# Rail pressure at which c_d(zM) has the value of `discharge_maximum` [Pa]: catalogue flows are measured there.
CATALOGUE_PRESSURE = 10e6

# Estimate [s]: the flow that a closing needle leaves in a hole is gone once fuel has passed the hole a few times. 15 us
# are three passages of 1 mm at 200 m/s (20 MPa), and nine at 600 m/s (160 MPa).
MEMORY = 15e-6


_KNOT, _SHAPE = "lift of knot", "relative change of c_d(z) of Eq. (9) at knot"
_USUAL_KNOT, _USUAL_SHAPE = (2e-6, 2e-3), (-0.6, 0.6)  # [m], [1]: see `law.Q`
_MEMORY = "time in which c_d forgets the largest lift once needle and SAC are at rest"
_USUAL_GROWTH = (-8e-9, 8e-9)  # [1/Pa]: 0.2 from 10 to 35 MPa, the range of direct-acting injectors


class Parameters(NamedTuple):
    """Drawing of the nozzle, the constants of Eq. (9), and the change of its c_d(z) at up to eight lifts."""

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
    discharge_growth: Annotated[
        float, Q("1/Pa", "growth of c_d(zM) with rail pressure above 10 MPa", Domain.ANY, 0.0, usual=_USUAL_GROWTH)
    ]
    discharge_memory: Annotated[float, Q("s", _MEMORY, Domain.POSITIVE, MEMORY, usual=(1e-6, 1e-3))]
    knot_1: Annotated[float, Q("m", f"{_KNOT} 1", Domain.NON_NEGATIVE, 40e-6, usual=_USUAL_KNOT)]
    knot_2: Annotated[float, Q("m", f"{_KNOT} 2 (0: none)", Domain.NON_NEGATIVE, 90e-6, usual=_USUAL_KNOT)]
    knot_3: Annotated[float, Q("m", f"{_KNOT} 3 (0: none)", Domain.NON_NEGATIVE, 150e-6, usual=_USUAL_KNOT)]
    knot_4: Annotated[float, Q("m", f"{_KNOT} 4 (0: none)", Domain.NON_NEGATIVE, 230e-6, usual=_USUAL_KNOT)]
    knot_5: Annotated[float, Q("m", f"{_KNOT} 5 (0: none)", Domain.NON_NEGATIVE, 340e-6, usual=_USUAL_KNOT)]
    knot_6: Annotated[float, Q("m", f"{_KNOT} 6 (0: none)", Domain.NON_NEGATIVE, 0.0, usual=_USUAL_KNOT)]
    knot_7: Annotated[float, Q("m", f"{_KNOT} 7 (0: none)", Domain.NON_NEGATIVE, 0.0, usual=_USUAL_KNOT)]
    knot_8: Annotated[float, Q("m", f"{_KNOT} 8 (0: none)", Domain.NON_NEGATIVE, 0.0, usual=_USUAL_KNOT)]
    shape_1: Annotated[float, Q("1", f"{_SHAPE} 1", Domain.CHANGE, 0.0, usual=_USUAL_SHAPE)]
    shape_2: Annotated[float, Q("1", f"{_SHAPE} 2", Domain.CHANGE, 0.0, usual=_USUAL_SHAPE)]
    shape_3: Annotated[float, Q("1", f"{_SHAPE} 3", Domain.CHANGE, 0.0, usual=_USUAL_SHAPE)]
    shape_4: Annotated[float, Q("1", f"{_SHAPE} 4", Domain.CHANGE, 0.0, usual=_USUAL_SHAPE)]
    shape_5: Annotated[float, Q("1", f"{_SHAPE} 5", Domain.CHANGE, 0.0, usual=_USUAL_SHAPE)]
    shape_6: Annotated[float, Q("1", f"{_SHAPE} 6", Domain.CHANGE, 0.0, usual=_USUAL_SHAPE)]
    shape_7: Annotated[float, Q("1", f"{_SHAPE} 7", Domain.CHANGE, 0.0, usual=_USUAL_SHAPE)]
    shape_8: Annotated[float, Q("1", f"{_SHAPE} 8", Domain.CHANGE, 0.0, usual=_USUAL_SHAPE)]


class Eight(NamedTuple):
    """One value for each of the eight knots."""

    i1: float
    i2: float
    i3: float
    i4: float
    i5: float
    i6: float
    i7: float
    i8: float


class Shape(NamedTuple):
    """Relative change of c_d(z): value up to the first knot [1], knots [m], and change of slope at each [1/m]."""

    first: float
    knots: Eight
    slope_changes: Eight


class Coefficients(NamedTuple):
    """Hole area A² [m⁴], (C_c A)² [m⁴], laminar offset [kg/s], memory [s], Eq. (9) with z0, zM, and its shape."""

    area_squared: float
    cda2_choked: float
    offset: float
    memory: float
    discharge_transition: float
    lift_transition: float
    lift_maximum: float
    per_lift_transition: float
    discharge_slope: float
    shape: Shape


class State(NamedTuple):
    """Largest lift that c_d remembers [m], which fades while needle and SAC are at rest; fuel injected so far [kg]."""

    lift_reached: float
    injected: float


@physics
def coefficients(p: Parameters, rail_pressure: float, dynamic_viscosity: float) -> Coefficients:
    """Coefficients of Eq. (4) and (9).

    `rail_pressure`: p_CR of time zero [Pa]; `dynamic_viscosity`: η at that pressure [Pa s].
    """
    area = p.holes * pipe_area(p.hole_diameter)
    # K1…K4 may have any sign: keep 0 < z0 < zM, whatever a search proposes
    knee = max(p.lift_transition_slope * rail_pressure + p.lift_transition_offset, RESIDUAL_LIFT)
    top = max(p.lift_maximum_slope * rail_pressure + p.lift_maximum_offset, knee + RESIDUAL_LIFT)
    greatest = min(max(grown_discharge(p, rail_pressure), 0.0), 1.0)
    return Coefficients(
        area_squared=area * area,
        cda2_choked=square(p.contraction * area),
        offset=laminar_offset(dynamic_viscosity, p.transition_reynolds, p.holes * 0.25 * pi * p.hole_diameter),
        memory=p.discharge_memory,
        discharge_transition=p.discharge_transition,
        lift_transition=knee,
        lift_maximum=top,
        per_lift_transition=1.0 / knee,
        discharge_slope=(greatest - p.discharge_transition) / (top - knee),
        shape=shape(p),
    )


@physics
def grown_discharge(p: Parameters, rail_pressure: float) -> float:
    """Coefficient c_d(zM) with its growth [1], before it is held between 0 and 1.

    `rail_pressure`: p_CR of time zero [Pa].
    """
    return p.discharge_maximum + p.discharge_growth * (rail_pressure - CATALOGUE_PRESSURE)


@physics
def shape(p: Parameters) -> Shape:
    """Piecewise linear change of c_d(z): value before the first knot [1], knots [m], changes of slope [1/m].

    A knot of zero lift after the first does not count: the previous value holds. Knots that do not rise are
    separated, whatever a search proposes.
    """
    s1 = p.shape_1
    s2 = p.shape_2 if p.knot_2 > 0.0 else s1
    s3 = p.shape_3 if p.knot_3 > 0.0 else s2
    s4 = p.shape_4 if p.knot_4 > 0.0 else s3
    s5 = p.shape_5 if p.knot_5 > 0.0 else s4
    s6 = p.shape_6 if p.knot_6 > 0.0 else s5
    s7 = p.shape_7 if p.knot_7 > 0.0 else s6
    s8 = p.shape_8 if p.knot_8 > 0.0 else s7
    z1 = p.knot_1
    z2 = max(p.knot_2, z1 + RESIDUAL_LIFT)
    z3 = max(p.knot_3, z2 + RESIDUAL_LIFT)
    z4 = max(p.knot_4, z3 + RESIDUAL_LIFT)
    z5 = max(p.knot_5, z4 + RESIDUAL_LIFT)
    z6 = max(p.knot_6, z5 + RESIDUAL_LIFT)
    z7 = max(p.knot_7, z6 + RESIDUAL_LIFT)
    z8 = max(p.knot_8, z7 + RESIDUAL_LIFT)
    m1, m2, m3 = (s2 - s1) / (z2 - z1), (s3 - s2) / (z3 - z2), (s4 - s3) / (z4 - z3)
    m4, m5, m6, m7 = (s5 - s4) / (z5 - z4), (s6 - s5) / (z6 - z5), (s7 - s6) / (z7 - z6), (s8 - s7) / (z8 - z7)
    return Shape(
        s1,
        Eight(i1=z1, i2=z2, i3=z3, i4=z4, i5=z5, i6=z6, i7=z7, i8=z8),
        Eight(i1=m1, i2=m2 - m1, i3=m3 - m2, i4=m4 - m3, i5=m5 - m4, i6=m6 - m5, i7=m7 - m6, i8=-m7),
    )


@physics
def quarter_sine(s: float) -> float:
    """sin(π s/2) [1]: odd Taylor polynomial of degree 9, error < 4e-6; `s`: lift over z0 [1], from 0 to 1."""
    x = 0.5 * pi * s
    y = x * x
    return x * (1.0 + y * (-1.0 / 6.0 + y * (1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0)))))


@physics
def discharge(c: Coefficients, lift_reached: float, sac: float = 0.0, cylinder: float = 0.0) -> float:
    """Discharge coefficient c_d of Eq. (9) [1].

    A needle that turns before zM closes with the coefficient it had reached, which Eq. (9), written for a
    full opening, leaves open.

    `lift_reached`: largest lift of this injection [m], ≥ 0: while the needle rises it is the lift itself (opening
    branches), after that it stays (closing branch, c_d constant); `sac`, `cylinder`: pressures [Pa], not read by this
    law; one of another package may.
    """
    z = max(lift_reached, RESIDUAL_LIFT)
    rising = quarter_sine(min(z * c.per_lift_transition, 1.0))
    beyond = min(max(z, c.lift_transition), c.lift_maximum) - c.lift_transition
    return c.discharge_transition * rising + c.discharge_slope * beyond


@physics
def change(s: Shape, lift_reached: float) -> float:
    """Relative change of c_d [1]: linear between the knots, constant before the first and after the last.

    `lift_reached`: as in `discharge` [m].
    """
    z, at, turn = lift_reached, s.knots, s.slope_changes
    low = turn.i1 * max(z - at.i1, 0.0) + turn.i2 * max(z - at.i2, 0.0)
    low = low + turn.i3 * max(z - at.i3, 0.0) + turn.i4 * max(z - at.i4, 0.0)
    high = turn.i5 * max(z - at.i5, 0.0) + turn.i6 * max(z - at.i6, 0.0)
    high = high + turn.i7 * max(z - at.i7, 0.0) + turn.i8 * max(z - at.i8, 0.0)
    return s.first + low + high


@physics
def shaped_discharge(c: Coefficients, lift_reached: float, sac: float = 0.0, cylinder: float = 0.0) -> float:
    """Discharge coefficient c_d of Eq. (9) times 1 + its change over lift, at most 1 [1].

    Eq. (9) rises as a sine and then as a ramp; measured quantity maps show a finer shape.

    Arguments as in `discharge`.
    """
    return min(discharge(c, lift_reached, sac, cylinder) * (1.0 + change(c.shape, lift_reached)), 1.0)
