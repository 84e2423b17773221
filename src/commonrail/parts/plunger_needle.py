"""Plunger and needle as a chain of nine masses, Eq. (7), (8), (10), Fig. 1.

Masses 1…6 are the plunger's five cylinders (springs k1…k5), masses 7…9 the needle's two (k6, k7). An
inner mass takes half of each neighbouring cylinder, an end mass half of its one. Positions are measured
from the unloaded, touching chain with the tip on its seat, positive when the needle opens. Eq. (10) as printed
ties mass 1 to the ground; here k1 acts between masses 1 and 2, as mass 2's line demands. Between 6 and 7
there is only contact: the plunger can leave its needle. Guide friction is not modelled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from commonrail.compile import physics, reciprocals
from commonrail.flow.contact import contact
from commonrail.flow.leakage import gap_conductance
from commonrail.flow.wave import pipe_area
from commonrail.parts.furniture import Annotated, Domain, Q

_MASS = "mass of cylinder"
_USUAL_STIFFNESS, _USUAL_MASS = (2e6, 5e9), (2e-5, 0.3)  # [N/m], [kg]: see `furniture.Q`
_STIFFNESS = "axial stiffness E A/l of cylinder"


class Parameters(NamedTuple):
    """Drawing and stiffness of plunger and needle."""

    k1: Annotated[float, Q("N/m", f"{_STIFFNESS} 1 (plunger, control chamber end)", usual=_USUAL_STIFFNESS)]
    k2: Annotated[float, Q("N/m", f"{_STIFFNESS} 2 (plunger)", usual=_USUAL_STIFFNESS)]
    k3: Annotated[float, Q("N/m", f"{_STIFFNESS} 3 (plunger)", usual=_USUAL_STIFFNESS)]
    k4: Annotated[float, Q("N/m", f"{_STIFFNESS} 4 (plunger)", usual=_USUAL_STIFFNESS)]
    k5: Annotated[float, Q("N/m", f"{_STIFFNESS} 5 (plunger, needle end)", usual=_USUAL_STIFFNESS)]
    k6: Annotated[float, Q("N/m", f"{_STIFFNESS} 6 (needle guide)", usual=_USUAL_STIFFNESS)]
    k7: Annotated[float, Q("N/m", f"{_STIFFNESS} 7 (needle stem)", usual=_USUAL_STIFFNESS)]
    m1: Annotated[float, Q("kg", f"{_MASS} 1", usual=_USUAL_MASS)]
    m2: Annotated[float, Q("kg", f"{_MASS} 2", usual=_USUAL_MASS)]
    m3: Annotated[float, Q("kg", f"{_MASS} 3", usual=_USUAL_MASS)]
    m4: Annotated[float, Q("kg", f"{_MASS} 4", usual=_USUAL_MASS)]
    m5: Annotated[float, Q("kg", f"{_MASS} 5", usual=_USUAL_MASS)]
    m6: Annotated[float, Q("kg", f"{_MASS} 6", usual=_USUAL_MASS)]
    m7: Annotated[float, Q("kg", f"{_MASS} 7", usual=_USUAL_MASS)]
    joint_stiffness: Annotated[
        float, Q("N/m", "contact stiffness between plunger and needle", Domain.POSITIVE, 1e8, usual=(1e6, 1e10))
    ]
    damping_ratio: Annotated[float, Q("1", "ξ of c = 2 ξ sqrt(k M)", Domain.NON_NEGATIVE, 0.005)]
    plunger_diameter: Annotated[float, Q("m", "plunger diameter in the control chamber", usual=(0.5e-3, 30e-3))]
    guide_diameter: Annotated[float, Q("m", "needle guide diameter", usual=(0.5e-3, 30e-3))]
    stem_diameter: Annotated[float, Q("m", "needle stem diameter", usual=(0.5e-3, 30e-3))]
    plunger_gap: Annotated[float, Q("m", "radial gap of the plunger guide", Domain.NON_NEGATIVE, usual=(0.2e-6, 50e-6))]
    plunger_guide_length: Annotated[float, Q("m", "length of the plunger guide", usual=(1e-3, 0.2))]
    needle_gap: Annotated[float, Q("m", "radial gap of the needle guide", Domain.NON_NEGATIVE, usual=(0.2e-6, 50e-6))]
    needle_guide_length: Annotated[float, Q("m", "length of the needle guide", usual=(1e-3, 0.2))]
    spring_preload: Annotated[
        float, Q("N", "force of the needle spring, needle closed and unloaded", Domain.NON_NEGATIVE, usual=(1.0, 2e3))
    ]
    spring_stiffness: Annotated[
        float, Q("N/m", "stiffness of the needle spring", Domain.NON_NEGATIVE, usual=(500.0, 2e6))
    ]
    stop_lift: Annotated[float, Q("m", "way of the plunger's unloaded top to its upper stop", usual=(20e-6, 5e-3))]
    stop_stiffness: Annotated[float, Q("N/m", "stiffness of the upper stop", Domain.POSITIVE, 1.5e8, usual=(1e6, 1e10))]
    stop_damping: Annotated[float, Q("s/m", "Hunt–Crossley factor of the upper stop", Domain.NON_NEGATIVE, 0.2)]


class Nine(NamedTuple):
    """One value for each of the nine masses: positions [m], velocities [m/s] or forces [N]."""

    i1: float
    i2: float
    i3: float
    i4: float
    i5: float
    i6: float
    i7: float
    i8: float
    i9: float


class Seven(NamedTuple):
    """One value for each cylinder: stiffness [N/m] or damping [N s/m]."""

    i1: float
    i2: float
    i3: float
    i4: float
    i5: float
    i6: float
    i7: float


class Guides(NamedTuple):
    """Pressure areas [m²], gap conductances of Eq. (5) [m³], needle spring and upper stop."""

    plunger_area: float
    guide_area: float
    stem_area: float
    plunger_leak: float
    needle_leak: float
    spring_preload: float
    spring_stiffness: float
    stop_lift: float
    stop_stiffness: float
    stop_damping: float


class Coefficients(NamedTuple):
    """Springs, dampers, inverse masses [1/kg] and step over mass [s/kg] of the chain, its mass [kg], and the guides."""

    k: Seven
    c: Seven
    per_mass: Nine
    impulse: Nine
    joint_stiffness: float
    total_mass: float
    guides: Guides


class State(NamedTuple):
    """Positions at t_n, velocities at t_n − dt/2 and t_n − 3dt/2."""

    z: Nine
    v: Nine
    v_before: Nine


class Motion(NamedTuple):
    """What the fluid sees: lift of the plunger's top, the needle's shoulder and its tip [m]."""

    top: float
    shoulder: float
    tip: float


class Loads(NamedTuple):
    """Pressure forces on masses 1, 6, 7, 8 and 9 [N], positive when they open; the spring's preload is in `head`."""

    top: float
    foot: float
    head: float
    shoulder: float
    tip: float


class SeatContact(NamedTuple):
    """Stiffness [N/m] and Hunt–Crossley factor [s/m] of the needle seat."""

    stiffness: float
    damping: float


@physics
def cylinder_stiffness(elastic_modulus: float, diameter: float, length: float) -> float:
    """Axial stiffness of a cylinder k = E A/l0 [N/m], Eq. (8)."""
    return elastic_modulus * pipe_area(diameter) / length


@physics
def cylinder_mass(density: float, diameter: float, length: float) -> float:
    """Mass of a cylinder ρ A l0 [kg]."""
    return density * pipe_area(diameter) * length


@physics
def damper(damping_ratio: float, stiffness: float, mass: float) -> float:
    """c = 2 ξ sqrt(k M) [N s/m], text below Eq. (8), M being the cylinder's mass."""
    return 2.0 * damping_ratio * math.sqrt(stiffness * mass)


@physics
def coefficients(p: Parameters, dt: float) -> Coefficients:
    """Coefficients of chain, guides, spring and stop; `dt` is the leapfrog's step [s]."""
    x = p.damping_ratio
    m = Nine(
        2.0 / p.m1,
        2.0 / (p.m1 + p.m2),
        2.0 / (p.m2 + p.m3),
        2.0 / (p.m3 + p.m4),
        2.0 / (p.m4 + p.m5),
        2.0 / p.m5,
        2.0 / p.m6,
        2.0 / (p.m6 + p.m7),
        2.0 / p.m7,
    )
    guides = Guides(
        pipe_area(p.plunger_diameter),
        pipe_area(p.guide_diameter),
        pipe_area(p.stem_diameter),
        gap_conductance(p.plunger_diameter, p.plunger_gap, p.plunger_guide_length),
        gap_conductance(p.guide_diameter, p.needle_gap, p.needle_guide_length),
        p.spring_preload,
        p.spring_stiffness,
        p.stop_lift,
        p.stop_stiffness,
        p.stop_damping,
    )
    return Coefficients(
        Seven(p.k1, p.k2, p.k3, p.k4, p.k5, p.k6, p.k7),
        Seven(
            damper(x, p.k1, p.m1),
            damper(x, p.k2, p.m2),
            damper(x, p.k3, p.m3),
            damper(x, p.k4, p.m4),
            damper(x, p.k5, p.m5),
            damper(x, p.k6, p.m6),
            damper(x, p.k7, p.m7),
        ),
        m,
        Nine(dt * m.i1, dt * m.i2, dt * m.i3, dt * m.i4, dt * m.i5, dt * m.i6, dt * m.i7, dt * m.i8, dt * m.i9),
        p.joint_stiffness,
        p.m1 + p.m2 + p.m3 + p.m4 + p.m5 + p.m6 + p.m7,
        guides,
    )


@physics
def loads(g: Guides, seat_area: float, control: float, accumulation: float, sac: float, low: float) -> Loads:
    """F1…F9 of Eq. (10): pressure on every area normal to the axis, `low` being the return pressure [Pa]."""
    return Loads(
        -control * g.plunger_area,
        low * g.plunger_area,
        -low * g.guide_area - g.spring_preload,
        accumulation * (g.guide_area - g.stem_area),
        accumulation * (g.stem_area - seat_area) + sac * seat_area,
    )


@physics
def forces(c: Coefficients, z: Nine, v: Nine, load: Loads) -> Nine:
    """Sum of spring, damper and pressure forces on each mass [N], Eq. (10), without seat and stop."""
    s1 = c.k.i1 * (z.i1 - z.i2) + c.c.i1 * (v.i1 - v.i2)
    s2 = c.k.i2 * (z.i2 - z.i3) + c.c.i2 * (v.i2 - v.i3)
    s3 = c.k.i3 * (z.i3 - z.i4) + c.c.i3 * (v.i3 - v.i4)
    s4 = c.k.i4 * (z.i4 - z.i5) + c.c.i4 * (v.i4 - v.i5)
    s5 = c.k.i5 * (z.i5 - z.i6) + c.c.i5 * (v.i5 - v.i6)
    joint = c.joint_stiffness * min(z.i6 - z.i7, 0.0)
    s6 = c.k.i6 * (z.i7 - z.i8) + c.c.i6 * (v.i7 - v.i8)
    s7 = c.k.i7 * (z.i8 - z.i9) + c.c.i7 * (v.i8 - v.i9)
    return Nine(
        load.top - s1,
        s1 - s2,
        s2 - s3,
        s3 - s4,
        s4 - s5,
        s5 - joint + load.foot,
        joint - s6 + load.head - c.guides.spring_stiffness * z.i7,
        s6 - s7 + load.shoulder,
        s7 + load.tip,
    )


@physics
def next_velocity(v: float, gain: float, half: float, per_one_plus_half: float) -> float:
    """Velocity after a step whose contact damping is taken at mid-step (implicit, never unstable).

    `gain` is dt F/M [m/s], `half` dt c/(2 M) [1] and the last argument 1/(1 + half).
    """
    return (v * (1.0 - half) + gain) * per_one_plus_half


class Needle(NamedTuple):
    """One value for each of masses 6 to 9: gains of velocity over a step [m/s] or forces [N]."""

    foot: float
    head: float
    shoulder: float
    tip: float


@physics
def bends(c: Coefficients, seat: SeatContact, z: Nine, gain: Needle, dt: float) -> Needle:
    """dt²/12 d²F/dt² of the springs from the joint to the seat [N]; `gain` is dt times the acceleration [m/s].

    Numerov's correction: with it leapfrog is of fourth order in these springs. The plunger's own springs go without,
    as their waves hardly move the needle.
    """
    share = dt * (1.0 / 12.0)
    joint = c.joint_stiffness * (gain.foot - gain.head) if z.i6 < z.i7 else 0.0
    guide, stem = c.k.i6 * (gain.head - gain.shoulder), c.k.i7 * (gain.shoulder - gain.tip)
    rest = seat.stiffness * gain.tip if z.i9 < 0.0 else 0.0
    return Needle(-share * joint, share * (joint - guide), share * (guide - stem), share * (stem - rest))


@physics
def advance(c: Coefficients, seat: SeatContact, s: State, load: Loads, dt: float) -> State:
    """One leapfrog step; dampers see the velocity extrapolated to t_n."""
    z, v, w, m = s.z, s.v, s.v_before, c.impulse
    now = Nine(
        1.5 * v.i1 - 0.5 * w.i1,
        1.5 * v.i2 - 0.5 * w.i2,
        1.5 * v.i3 - 0.5 * w.i3,
        1.5 * v.i4 - 0.5 * w.i4,
        1.5 * v.i5 - 0.5 * w.i5,
        1.5 * v.i6 - 0.5 * w.i6,
        1.5 * v.i7 - 0.5 * w.i7,
        1.5 * v.i8 - 0.5 * w.i8,
        1.5 * v.i9 - 0.5 * w.i9,
    )
    f = forces(c, z, now, load)
    stop = contact(z.i1 - c.guides.stop_lift, c.guides.stop_stiffness, c.guides.stop_damping)
    rest = contact(-z.i9, seat.stiffness, seat.damping)
    half1, half9 = 0.5 * m.i1 * stop.damping, 0.5 * m.i9 * rest.damping
    per1, per9 = reciprocals(1.0 + half1, 1.0 + half9)
    gain = Needle(m.i6 * f.i6, m.i7 * f.i7, m.i8 * f.i8, m.i9 * (f.i9 + rest.force))
    bent = bends(c, seat, z, gain, dt)
    u = Nine(
        next_velocity(v.i1, m.i1 * (f.i1 - stop.force), half1, per1),
        v.i2 + m.i2 * f.i2,
        v.i3 + m.i3 * f.i3,
        v.i4 + m.i4 * f.i4,
        v.i5 + m.i5 * f.i5,
        v.i6 + gain.foot + m.i6 * bent.foot,
        v.i7 + gain.head + m.i7 * bent.head,
        v.i8 + gain.shoulder + m.i8 * bent.shoulder,
        next_velocity(v.i9, gain.tip + m.i9 * bent.tip, half9, per9),
    )
    moved = Nine(
        z.i1 + dt * u.i1,
        z.i2 + dt * u.i2,
        z.i3 + dt * u.i3,
        z.i4 + dt * u.i4,
        z.i5 + dt * u.i5,
        z.i6 + dt * u.i6,
        z.i7 + dt * u.i7,
        z.i8 + dt * u.i8,
        z.i9 + dt * u.i9,
    )
    return State(moved, u, v)


@physics
def accelerations(c: Coefficients, seat: SeatContact, z: Nine, v: Nine, load: Loads) -> Nine:
    """Right-hand side of Eq. (10) [m/s²] with seat and stop, for a solver that knows z and v at one time."""
    f, m = forces(c, z, v, load), c.per_mass
    stop = contact(z.i1 - c.guides.stop_lift, c.guides.stop_stiffness, c.guides.stop_damping)
    rest = contact(-z.i9, seat.stiffness, seat.damping)
    return Nine(
        m.i1 * (f.i1 - stop.force - stop.damping * v.i1),
        m.i2 * f.i2,
        m.i3 * f.i3,
        m.i4 * f.i4,
        m.i5 * f.i5,
        m.i6 * f.i6,
        m.i7 * f.i7,
        m.i8 * f.i8,
        m.i9 * (f.i9 + rest.force - rest.damping * v.i9),
    )


@physics
def motion(s: State) -> Motion:
    """Lifts that the fluid sees."""
    return Motion(s.z.i1, s.z.i8, s.z.i9)


@physics
def at_rest(c: Coefficients, seat: SeatContact, load: Loads) -> State:
    """Chain at rest on its seat under static loads, in closed form (spring by spring)."""
    k = c.k
    push = -load.top  # compression of k1…k5
    joint = push - load.foot
    bare = joint - load.head  # compression of k6 without the spring's stiffness
    below = 1.0 / seat.stiffness + 1.0 / k.i7 + 1.0 / k.i6
    offset = (bare - load.shoulder - load.tip) / seat.stiffness + (bare - load.shoulder) / k.i7 + bare / k.i6
    z7 = -offset / (1.0 + c.guides.spring_stiffness * below)
    f6 = bare + c.guides.spring_stiffness * z7
    f7 = f6 - load.shoulder
    z9 = -(f7 - load.tip) / seat.stiffness
    z8 = z9 - f7 / k.i7
    z6 = z7 - joint / c.joint_stiffness
    z5 = z6 - push / k.i5
    z4 = z5 - push / k.i4
    z3 = z4 - push / k.i3
    z2 = z3 - push / k.i2
    z1 = z2 - push / k.i1
    still = Nine(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return State(Nine(z1, z2, z3, z4, z5, z6, z7, z8, z9), still, still)
