"""Return line: the control chamber's link to the low-pressure circuit, by characteristics, Eq. (6).

The valve's outflow raises the pressure at its outlet by Z q; the wave runs to the tank, which holds
the return pressure, and comes back inverted after 2 L/a. A line of length zero is the tank itself.
"""

from __future__ import annotations

from typing import NamedTuple

from commonrail.compile import physics
from commonrail.flow.wave import impedance, pipe_area
from commonrail.parts.furniture import Annotated, Domain, Q


class Parameters(NamedTuple):
    """Drawing of the return line."""

    length: Annotated[
        float, Q("m", "length of the return line (0: none)", Domain.NON_NEGATIVE, 0.0, usual=(0.01, 20.0))
    ]
    diameter: Annotated[float, Q("m", "bore of the return line", Domain.POSITIVE, 4e-3, usual=(0.5e-3, 30e-3))]


class Coefficients(NamedTuple):
    """Impedance [Pa s/kg] (0 without a line) and travel time of a wave to the tank and back [s]."""

    impedance: float
    round_trip: float


class State(NamedTuple):
    """Pressure behind the valve over the last step [Pa]."""

    pressure: float


@physics
def coefficients(p: Parameters, sound_speed: float) -> Coefficients:
    """Coefficients of the line, Eq. (6) without friction.

    Parameters
    ----------
    p : Parameters
        Drawing.
    sound_speed : float
        a at the return pressure [m/s].
    """
    z = impedance(sound_speed, pipe_area(p.diameter)) if p.length > 0.0 else 0.0
    return Coefficients(z, 2.0 * p.length / sound_speed)
