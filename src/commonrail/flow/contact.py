"""One-sided contact with Hunt–Crossley damping."""

from __future__ import annotations

from typing import NamedTuple

from commonrail.compile import physics

__all__ = ["Contact", "contact"]


class Contact(NamedTuple):
    """Elastic force [N], pushing only, and its damping coefficient [N s/m], acting against the approach."""

    force: float
    damping: float


@physics
def contact(depth: float, stiffness: float, damping_factor: float) -> Contact:
    """Force between two bodies that overlap by `depth` [m], zero when they are apart.

    F = k δ (1 + β δ̇) (Hunt & Crossley 1975, doi:10.1115/1.3423596): the damping grows with the overlap,
    so the force does not jump at touch. Here k δ and k δ β are returned apart, the step being implicit
    in the second. β [s/m] is about 1.5 (1 − restitution)/speed.
    """
    elastic = stiffness * max(depth, 0.0)
    return Contact(elastic, elastic * damping_factor)
