"""SAC: the small volume between needle seat and nozzle holes, Eq. (3)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.law import physics
from commonrail.physics.parameters import Q


class Parameters(NamedTuple):
    """Drawing of the SAC."""

    volume: Annotated[float, Q("m3", "SAC volume, needle on its seat", usual=(0.01e-9, 50e-9))]


@physics
def volume(p: Parameters, seat_area: float, tip_lift: float) -> float:
    """SAC volume V of Eq. (3) [m³].

    `seat_area`: area inside the seat line [m²]; `tip_lift`: lift of the needle's tip [m]; below zero it is elastic
    flattening of the seat and does not shrink the SAC.
    """
    return p.volume + seat_area * max(tip_lift, 0.0)
