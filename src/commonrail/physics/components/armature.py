"""Armature of a direct-acting injector: a mass between rest and stop that meets the needle after an idle stroke."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.law import physics
from commonrail.physics.parameters import Domain, Q


class Parameters(NamedTuple):
    """Mass, travel, spring and contacts of the armature."""

    mass: Annotated[float, Q("kg", "mass of the armature", usual=(0.1e-3, 0.1))]
    idle_stroke: Annotated[
        float, Q("m", "travel of the armature until it meets the needle", Domain.NON_NEGATIVE, usual=(2e-6, 1e-3))
    ]
    lift: Annotated[float, Q("m", "travel from the needle to the stop", usual=(5e-6, 1e-3))]
    spring_preload: Annotated[
        float, Q("N", "force of the armature's spring at rest", Domain.NON_NEGATIVE, usual=(0.1, 300.0))
    ]
    spring_stiffness: Annotated[
        float, Q("N/m", "stiffness of the armature's spring", Domain.NON_NEGATIVE, 0.0, usual=(100.0, 5e5))
    ]
    damping: Annotated[float, Q("N s/m", "viscous damping of the armature", Domain.NON_NEGATIVE, 0.0)]
    contact_stiffness: Annotated[
        float, Q("N/m", "stiffness of rest, stop and needle contact", Domain.POSITIVE, 3e7, usual=(1e6, 1e10))
    ]
    contact_damping: Annotated[
        float, Q("s/m", "Hunt–Crossley factor of rest, stop and needle contact", Domain.NON_NEGATIVE, 0.5)
    ]


class Coefficients(NamedTuple):
    """Inverse mass [1/kg], idle stroke and travel to the stop [m], spring, damper, contacts."""

    per_mass: float
    idle_stroke: float
    travel: float
    spring_preload: float
    spring_stiffness: float
    damping: float
    contact_stiffness: float
    contact_damping: float


@physics
def coefficients(p: Parameters) -> Coefficients:
    """Coefficients of the armature."""
    return Coefficients(
        per_mass=1.0 / p.mass,
        idle_stroke=p.idle_stroke,
        travel=p.idle_stroke + p.lift,
        spring_preload=p.spring_preload,
        spring_stiffness=p.spring_stiffness,
        damping=p.damping,
        contact_stiffness=p.contact_stiffness,
        contact_damping=p.contact_damping,
    )


@physics
def free_force(c: Coefficients, position: float, magnetic_force: float) -> float:
    """Force of magnet and spring [N], positive when opening.

    `position`: travel from the rest [m]; `magnetic_force`: magnetic force [N], ≥ 0.
    """
    return magnetic_force - c.spring_preload - c.spring_stiffness * position
