"""Rail: a volume behind a throttle, or an ideal source of the measured rail pressure."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.flow.pipe import pipe_area
from commonrail.physics.law import physics
from commonrail.physics.parameters import Domain, Q


class Parameters(NamedTuple):
    """Drawing of the rail; used only where the injector's `rail_boundary` is "volume"."""

    volume: Annotated[float, Q("m3", "volume of the rail", Domain.POSITIVE, 22e-6, usual=(2e-6, 2e-3))]
    throttle_diameter: Annotated[
        float, Q("m", "throttle at the rail's outlet", Domain.POSITIVE, 0.85e-3, usual=(0.2e-3, 10e-3))
    ]
    throttle_discharge: Annotated[float, Q("1", "discharge coefficient of the throttle", Domain.COEFFICIENT, 0.8)]


class Coefficients(NamedTuple):
    """Volume [m³] and (c_d A)² of the throttle [m⁴]."""

    volume: float
    throttle_cda2: float


@physics
def coefficients(p: Parameters) -> Coefficients:
    """Coefficients of the rail, Eq. (3) and (4)."""
    effective = p.throttle_discharge * pipe_area(p.throttle_diameter)
    return Coefficients(p.volume, effective * effective)
