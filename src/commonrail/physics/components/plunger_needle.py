"""Plunger and needle as a chain of nine masses, Eq. (7), (8), (10), Fig. 1.

Masses 1…6 are the plunger's five cylinders (springs k1…k5), masses 7…9 the needle's two (k6, k7). An
inner mass takes half of each neighbouring cylinder, an end mass half of its one. Positions are measured
from the unloaded, touching chain with the tip on its seat, positive when the needle opens. Eq. (10) as printed
ties mass 1 to the ground; here k1 acts between masses 1 and 2, as mass 2's line demands. Between 6 and 7
there is only contact: the plunger can leave its needle. Friction of the guides: `guide_friction`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

from commonrail.physics.components.contact import Contact, contact, mean_overlap, overlap_over_step, velocity_gain
from commonrail.physics.flow import Guide, guide_of, pipe_area
from commonrail.physics.law import Domain, Q, physics

# Chain of nine masses on seven cylinders: a law of one mass or one cylinder, unrolled over all of them.
#
# Masses 1…6 stand at the ends of the plunger's five cylinders, masses 7…9 at the ends of the needle's two. Kernels see
# straight-line code: no loop, no array.


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
    """One value for each cylinder: stiffness [N/m], mass [kg] or damping [N s/m]."""

    i1: float
    i2: float
    i3: float
    i4: float
    i5: float
    i6: float
    i7: float


def each(kind: type, law: Callable[..., float], shared: str = "") -> Callable[..., Any]:
    """Function of the same arguments as `law` that takes `kind`s, applies it field by field, and returns a `kind`.

    `kind`: `Nine` or `Seven`; `law` (function of float): law of one mass or one cylinder; `shared`: names of the
    arguments that are one number for all.
    """
    arguments = law.__code__.co_varnames[: law.__code__.co_argcount]
    field_arguments = ", ".join(name if name in shared.split() else f"{name}.{{0}}" for name in arguments)
    values = ", ".join(f"law({field_arguments})".format(field) for field in kind._fields)  # type: ignore[attr-defined]
    names: dict[str, Any] = {"__name__": __name__, "law": physics(law), "kind": kind}
    text = f"def unrolled({', '.join(arguments)}):\n    return kind({values})\n"
    exec(compile(text, f"<{law.__name__} of each of {kind.__name__}>", "exec"), names)
    return physics(names["unrolled"])  # type: ignore[no-any-return]


@physics
def across(z: Nine) -> Seven:
    """Differences over each cylinder: the upper mass's value less the lower's, in its unit.

    `z`: positions [m] or velocities [m/s].
    """
    return Seven(
        i1=z.i1 - z.i2,
        i2=z.i2 - z.i3,
        i3=z.i3 - z.i4,
        i4=z.i4 - z.i5,
        i5=z.i5 - z.i6,
        i6=z.i7 - z.i8,
        i7=z.i8 - z.i9,
    )


@physics
def around(m: Seven) -> Nine:
    """Sums over the cylinders that end at each mass, in the unit of the cylinders' values; `m`: masses [kg]."""
    return Nine(
        i1=m.i1,
        i2=m.i1 + m.i2,
        i3=m.i2 + m.i3,
        i4=m.i3 + m.i4,
        i5=m.i4 + m.i5,
        i6=m.i5,
        i7=m.i6,
        i8=m.i6 + m.i7,
        i9=m.i7,
    )


@physics
def nodal_forces(s: Seven, joint: float) -> Nine:
    """Forces on the masses [N], positive when opening, from those in the cylinders and in the joint.

    `s`: forces in the cylinders [N], positive in tension; `joint`: force between plunger and needle [N], positive in
    tension; masses that touch give zero or less.
    """
    return Nine(
        i1=-s.i1,
        i2=s.i1 - s.i2,
        i3=s.i2 - s.i3,
        i4=s.i3 - s.i4,
        i5=s.i4 - s.i5,
        i6=s.i5 - joint,
        i7=joint - s.i6,
        i8=s.i6 - s.i7,
        i9=s.i7,
    )


_MASS = "mass of cylinder"
_USUAL_STIFFNESS, _USUAL_MASS = (2e6, 5e9), (2e-5, 0.3)  # [N/m], [kg]: see `law.Q`
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
    gap_widening: Annotated[
        float,
        Q(
            "m/Pa",
            "widening of both guides' gaps by the mean pressure in them (0: none)",
            Domain.NON_NEGATIVE,
            0.0,
            usual=(2e-15, 3e-13),
        ),
    ]
    eccentricity: Annotated[
        float, Q("1", "eccentricity of plunger and needle in their guides, over the gap", Domain.UNIT, 0.0)
    ]
    spring_preload: Annotated[
        float, Q("N", "force of the needle spring, needle closed and unloaded", Domain.NON_NEGATIVE, usual=(1.0, 2e3))
    ]
    spring_stiffness: Annotated[
        float, Q("N/m", "stiffness of the needle spring", Domain.NON_NEGATIVE, usual=(500.0, 2e6))
    ]
    stop_lift: Annotated[float, Q("m", "distance from the unloaded plunger top to the upper stop", usual=(20e-6, 5e-3))]
    stop_stiffness: Annotated[float, Q("N/m", "stiffness of the upper stop", Domain.POSITIVE, 1.5e8, usual=(1e6, 1e10))]
    stop_damping: Annotated[float, Q("s/m", "Hunt–Crossley factor of the upper stop", Domain.NON_NEGATIVE, 0.2)]
    viscous: Annotated[
        float,
        Q(
            "N s/m",
            "viscous friction of plunger and needle, each guide",
            Domain.NON_NEGATIVE,
            0.0,
            usual=(0.05, 200.0),
        ),
    ]
    friction: Annotated[
        float,
        Q("N", "dry friction of plunger and needle, each guide", Domain.NON_NEGATIVE, 0.0, usual=(0.05, 100.0)),
    ]


class Guides(NamedTuple):
    """Pressure areas [m²], gaps of the guides, needle spring, upper stop, friction of each guide."""

    plunger_area: float
    guide_area: float
    stem_area: float
    plunger_gap: Guide
    needle_gap: Guide
    spring_preload: float
    spring_stiffness: float
    stop_lift: float
    stop_stiffness: float
    stop_damping: float
    viscous: float
    friction: float


class Coefficients(NamedTuple):
    """Springs, dampers, inverse masses [1/kg] of the chain, its mass [kg], and the guides.

    `impulse` is dt/m [s/kg], `numerov` dt²/(12 m) [s²/kg].
    """

    k: Seven
    c: Seven
    per_mass: Nine
    impulse: Nine
    numerov: Nine
    joint_stiffness: float
    total_mass: float
    guides: Guides


class State(NamedTuple):
    """Positions at t_n, velocities at t_n − dt/2, and what those have gained since t_n − 3dt/2."""

    z: Nine
    v: Nine
    gain: Nine


class Motion(NamedTuple):
    """Lifts of the plunger's top, the needle's shoulder and its tip [m], which change the fuel's volumes."""

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
    """Axial stiffness of a cylinder k = E A/l0 [N/m], Eq. (8).

    `elastic_modulus`: E [Pa]; `diameter`: of the cylinder [m]; `length`: l0 [m].
    """
    return elastic_modulus * pipe_area(diameter) / length


@physics
def cylinder_mass(density: float, diameter: float, length: float) -> float:
    """Mass of a cylinder ρ A l0 [kg].

    `density`: ρ of the steel [kg/m³]; `diameter`: of the cylinder [m]; `length`: l0 [m].
    """
    return density * pipe_area(diameter) * length


@physics
def damper(damping_ratio: float, stiffness: float, mass: float) -> float:
    """Damping coefficient of a cylinder c = 2 ξ sqrt(k M) [N s/m], text below Eq. (8).

    `damping_ratio`: ξ [1], ≥ 0; `stiffness`: k [N/m]; `mass`: M of the cylinder [kg].
    """
    return 2.0 * damping_ratio * math.sqrt(stiffness * mass)


_dampers = each(Seven, damper, shared="damping_ratio")
_inverse = each(Nine, lambda doubled: 2.0 / doubled)
_scaled = each(Nine, lambda factor, x: factor * x, shared="factor")


@physics
def coefficients(p: Parameters, dt: float) -> Coefficients:
    """Coefficients of chain, guides, spring and stop."""
    k = Seven(i1=p.k1, i2=p.k2, i3=p.k3, i4=p.k4, i5=p.k5, i6=p.k6, i7=p.k7)
    m = Seven(i1=p.m1, i2=p.m2, i3=p.m3, i4=p.m4, i5=p.m5, i6=p.m6, i7=p.m7)
    per_mass = _inverse(around(m))
    guides = Guides(
        plunger_area=pipe_area(p.plunger_diameter),
        guide_area=pipe_area(p.guide_diameter),
        stem_area=pipe_area(p.stem_diameter),
        plunger_gap=guide_of(p.plunger_diameter, p.plunger_gap, p.plunger_guide_length, p.eccentricity, p.gap_widening),
        needle_gap=guide_of(p.guide_diameter, p.needle_gap, p.needle_guide_length, p.eccentricity, p.gap_widening),
        spring_preload=p.spring_preload,
        spring_stiffness=p.spring_stiffness,
        stop_lift=p.stop_lift,
        stop_stiffness=p.stop_stiffness,
        stop_damping=p.stop_damping,
        viscous=p.viscous,
        friction=p.friction,
    )
    return Coefficients(
        k=k,
        c=_dampers(p.damping_ratio, k, m),
        per_mass=per_mass,
        impulse=_scaled(dt, per_mass),
        numerov=_scaled(dt * dt * (1.0 / 12.0), per_mass),
        joint_stiffness=p.joint_stiffness,
        total_mass=m.i1 + m.i2 + m.i3 + m.i4 + m.i5 + m.i6 + m.i7,
        guides=guides,
    )


@physics
def loads(g: Guides, seat_area: float, control: float, accumulation: float, sac: float, low: float) -> Loads:
    """Forces F1…F9 of Eq. (10): pressure on every area normal to the axis, positive when opening.

    `seat_area`: of the needle seat [m²]; `control`: pressure in the control chamber [Pa]; `accumulation`: pressure in
    the accumulation volume [Pa]; `sac`: pressure in the SAC [Pa]; `low`: return pressure, between plunger and needle
    [Pa].
    """
    return Loads(
        -control * g.plunger_area,
        low * g.plunger_area,
        -low * g.guide_area - g.spring_preload,
        accumulation * (g.guide_area - g.stem_area),
        accumulation * (g.stem_area - seat_area) + sac * seat_area,
    )


_in_cylinders = each(Seven, lambda k, c, stretch, speed: k * stretch + c * speed)


@physics
def forces(c: Coefficients, z: Nine, v: Nine, load: Loads) -> Nine:
    """Sum of spring, damper and pressure forces on each mass [N], Eq. (10), without seat and stop.

    `z`: positions [m]; `v`: velocities [m/s] at the same time.
    """
    joint = c.joint_stiffness * min(z.i6 - z.i7, 0.0)
    f = nodal_forces(_in_cylinders(c.k, c.c, across(z), across(v)), joint)
    head = f.i7 + load.head - c.guides.spring_stiffness * z.i7
    return Nine(
        i1=f.i1 + load.top,
        i2=f.i2,
        i3=f.i3,
        i4=f.i4,
        i5=f.i5,
        i6=f.i6 + load.foot,
        i7=head,
        i8=f.i8 + load.shoulder,
        i9=f.i9 + load.tip,
    )


@physics
def with_ends(f: Nine, top: float, tip: float) -> Nine:
    """Forces [N] with the ends replaced, where stop and seat act; used for gains of velocity too.

    `f`: forces on the masses [N]; `top`: force on mass 1 [N]; `tip`: force on mass 9 [N].
    """
    return Nine(i1=top, i2=f.i2, i3=f.i3, i4=f.i4, i5=f.i5, i6=f.i6, i7=f.i7, i8=f.i8, i9=tip)


_springs = each(Seven, lambda k, stretch: k * stretch)
_product = each(Nine, lambda x, y: x * y)


@physics
def numerov_correction(c: Coefficients, seat: SeatContact, z: Nine, seated: float, gain: Nine) -> Nine:
    """Gain of velocity [m/s] by dt²/12 d²F/dt² of k1 to k7, of the joint and of the seat's elastic force.

    Numerov's correction: with it leapfrog is of fourth order in these springs; not in needle spring and upper stop. The
    plunger rings on after an injection; the phase of its waves decides the pressure in the control chamber at which the
    next one begins.

    `z`: positions [m]; `seated`: share of the step in which needle and seat touch [1]; `gain`: dt times the
    accelerations at t_n, without contact damping [m/s].
    """
    joint = c.joint_stiffness * (gain.i6 - gain.i7) if z.i6 < z.i7 else 0.0
    rest = seat.stiffness * seated * gain.i9
    f = nodal_forces(_springs(c.k, across(gain)), joint)
    return _product(c.numerov, with_ends(f, f.i1, f.i9 - rest))


_extrapolated = each(Nine, lambda v, gain: v + 0.5 * gain)


@physics
def at_stop(g: Guides, top: float) -> Contact:
    """Contact with the upper stop; `top`: lift of the plunger's top [m]."""
    return contact(top - g.stop_lift, g.stop_stiffness, g.stop_damping)


@physics
def on_seat(seat: SeatContact, tip: float, move: float) -> Contact:
    """Contact with the needle seat; `tip`: lift of the needle's tip [m]; `move`: in a step, zero at an instant [m]."""
    return contact(mean_overlap(-tip, move), seat.stiffness, seat.damping)


_advanced = each(Nine, lambda x, step, rate: x + step * rate, shared="step")
_sum = each(Nine, lambda x, y: x + y)


@physics
def advance(c: Coefficients, seat: SeatContact, s: State, load: Loads, dt: float) -> State:
    """State after one leapfrog step; dampers see the velocity extrapolated to t_n; `load`: pressure forces at t_n."""
    f, m = forces(c, s.z, _extrapolated(s.v, s.gain), load), c.impulse
    seated = overlap_over_step(-s.z.i9, dt * s.v.i9)
    stop, rest = at_stop(c.guides, s.z.i1), contact(seated.mean, seat.stiffness, seat.damping)
    first = _product(m, with_ends(f, f.i1 - stop.force, f.i9 + rest.force))
    free = _sum(first, numerov_correction(c, seat, s.z, seated.share, first))
    gain = with_ends(
        free,
        velocity_gain(s.v.i1, free.i1, 0.5 * m.i1 * stop.damping),
        velocity_gain(s.v.i9, free.i9, 0.5 * m.i9 * rest.damping),
    )
    u = _sum(s.v, gain)
    return State(_advanced(s.z, dt, u), u, gain)


@physics
def accelerations(c: Coefficients, seat: SeatContact, z: Nine, v: Nine, load: Loads) -> Nine:
    """Right-hand side of Eq. (10) [m/s²] with seat and stop, for a solver that has z and v at one time.

    `z`: positions [m]; `v`: velocities [m/s].
    """
    f = forces(c, z, v, load)
    stop, rest = at_stop(c.guides, z.i1), on_seat(seat, z.i9, 0.0)
    top = f.i1 - stop.force - stop.damping * v.i1
    return _product(c.per_mass, with_ends(f, top, f.i9 + rest.force - rest.damping * v.i9))


TOP, TIP = "z.i1", "z.i9"  # in `State`
Positions = Nine


@physics
def lifts(z: Nine) -> Motion:
    """Lifts at top, shoulder and tip. Also velocities [m/s], from velocities of the masses; `z`: positions [m]."""
    return Motion(z.i1, z.i8, z.i9)


@physics
def at_rest(c: Coefficients, seat: SeatContact, load: Loads) -> State:
    """Chain at rest on its seat under static loads, in closed form (spring by spring).

    `c`, `seat`, `load`: as in `advance`; the loads press the needle into its seat.
    """
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
    still = Nine(i1=0.0, i2=0.0, i3=0.0, i4=0.0, i5=0.0, i6=0.0, i7=0.0, i8=0.0, i9=0.0)
    return State(Nine(i1=z1, i2=z2, i3=z3, i4=z4, i5=z5, i6=z6, i7=z7, i8=z8, i9=z9), still, still)
