"""One-sided contact with Hunt–Crossley damping, at an instant and as the mean of a leapfrog step."""

from __future__ import annotations

from typing import NamedTuple

from commonrail.physics.law import physics

TINY_PATH = 1e-15  # what counts as no path [m]


class Contact(NamedTuple):
    """Elastic force [N], never pulling, and damping coefficient [N s/m] against approach and separation equally.

    Bodies that part faster than 1/β would be held back.
    """

    force: float
    damping: float


@physics
def contact(depth: float, stiffness: float, damping_factor: float) -> Contact:
    """Force between two bodies that overlap, zero when they are apart.

    F = k δ (1 + β δ̇) (Hunt & Crossley 1975, doi:10.1115/1.3423596): the damping grows with the overlap,
    so the force does not jump at touch. k δ and k δ β are returned apart, because the step is implicit
    in the second.

    `depth`: overlap δ [m], negative where the bodies are apart; small against their size; `stiffness`: k [N/m], > 0;
    `damping_factor`: β [s/m], ≥ 0: about 1.5 (1 − restitution)/speed.
    """
    elastic = stiffness * max(depth, 0.0)
    return Contact(elastic, elastic * damping_factor)


class Overlap(NamedTuple):
    """Mean of max(δ, 0) [m] over a leapfrog step, and the share of it in which bodies touch [1]."""

    mean: float
    share: float


@physics
def overlap_over_step(depth: float, move: float) -> Overlap:
    """Overlap over a path from `depth` − `move` to `depth` + `move`, weighted 1 − |s| as leapfrog does; exact.

    With x = δ/|move| in −1 … 1 the mean is |move| ((1 + x)³ − 2 max(x, 0)³)/6 and the share (1 + x)²/2 − max(x, 0)²,
    twice and once differentiable: no step in which bodies touch or part makes a kink.

    `depth`: overlap δ in the middle of the path [m]; `move`: half the path [m]; its sign does not matter.
    """
    size = abs(move) + TINY_PATH
    x = min(max(depth / size, -1.0), 1.0)
    over, past = 1.0 + x, max(x, 0.0)
    share = 0.5 * over * over - past * past
    mean = size * (1.0 / 6.0) * (over * over * over - 2.0 * past * past * past)
    return Overlap(mean + max(depth - size, 0.0), share)


@physics
def mean_overlap(depth: float, move: float) -> float:
    """Mean of max(δ, 0) [m] of `overlap_over_step`.

    `depth`: overlap δ in the middle of the path [m]; `move`: half the path [m].
    """
    return overlap_over_step(depth, move).mean


@physics
def contact_over_step(
    depth: float, speed: float, outer: float, per_mass: float, law: tuple[float, float], dt: float
) -> Contact:
    """Contact force of a single mass over a leapfrog step: third order while bodies touch, where `contact` is second.

    Leapfrog changes the velocity from t − dt/2 to t + dt/2 by the mean of the force under the weight 1 − |s|, s from
    −1 to 1 being time in steps; up to dt⁴ that is F + dt²/12 F″. The overlap is averaged along the path, so
    that touching and parting may fall anywhere inside a step. The rest follows, for the share of the step in which
    bodies touch, from δ̈ and m δ⃛ = −k δ̇ − k β (δ̇² + δ δ̈):

        elastic force  k δ̄ + (k + c²/m) dt²/12 δ̈,      c = k β δ̄
        damping        c (1 + (k + k β δ̇) dt²/(12 m)) + k β dt²/4 δ̈

    the damping being applied to the mean of the velocities before and after the step, which is δ̇ + dt²/6 δ⃛. In these
    small terms δ̇ is half a step old, and the rate of the other forces is neglected: hence third order. A
    step in which bodies touch or part remains second order, with a far smaller error (`overlap_over_step`).

    `depth`: overlap δ at the start of the step [m]; `speed`: dδ/dt, half a step before [m/s]; `outer`: all other forces
    on the mass [N], positive when they increase the overlap; `per_mass`: 1/m [1/kg]; `law` (float, float): stiffness k
    [N/m] and Hunt–Crossley factor β [s/m]; `dt`: step [s]; k dt² < 4 m.
    """
    stiffness, factor = law
    per_step = dt * dt * per_mass
    now = speed + 0.5 * dt * per_mass * (outer - stiffness * max(depth, 0.0))  # at the start of the step
    overlap, share = overlap_over_step(depth, dt * now)
    damper = stiffness * factor
    damping = damper * overlap
    resisting = stiffness + damper * speed
    curvature = share * per_step * (outer - resisting * overlap)  # dt² δ̈
    return Contact(
        stiffness * overlap + (stiffness + damping * damping * per_mass) * curvature * (1.0 / 12.0),
        max(damping * (1.0 + per_step * resisting * (1.0 / 12.0)) + 0.25 * damper * curvature, 0.0),
    )


@physics
def velocity_gain(v: float, gain: float, half: float) -> float:
    """Gain of velocity over a step [m/s] whose contact damping is taken at mid-step (implicit, never unstable).

    `v`: velocity half a step before [m/s]; `gain`: dt F/m, without the damping [m/s]; `half`: dt c/(2 m) [1].
    """
    return (gain - 2.0 * half * v) / (1.0 + half)
