"""Longest time step of the fast engines for a direct-acting injector; see `time_step` for the servo injector.

Armature and needle are judged as two masses with all contacts closed that can be at once: the armature on its stop and
on the needle, the needle on its seat and on the fuel enclosed in the SAC. Leapfrog bears the largest eigenvalue λ of
that pair as long as dt² λ < 4; the limit here is stricter, so that contacts are resolved: see `RIGID`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from commonrail.physics.flow import pipe_area

RIGID = 0.7  # largest ω dt of a mode in contact, as for the servo injector's rigid body
DRAWN = 0.5  # share of the accumulation volume that a wave may draw through the seat's bore in a step

# Parameters that shorten the longest step as they grow, and as they shrink.
SHORTENS = (
    "armature.contact_stiffness",
    "armature.spring_stiffness",
    "needle.spring_stiffness",
    "needle_seat.contact_stiffness",
    "needle_seat.diameter",
)
LENGTHENS = ("armature.mass", "needle.mass", "accumulation.volume", "sac.volume", "feed_pipe.length")


def bears(values: Mapping[str, Any], modulus: float, speed: float, dt: float) -> Any:
    """True where a step is short enough.

    Parameters
    ----------
    values : mapping of str to float or (n,)
        SI values of `SHORTENS` and `LENGTHENS` by dotted name.
    modulus : float
        Bulk modulus of the fuel [Pa].
    speed : float
        Sound speed [m/s].
    dt : float
        Step [s].

    Returns
    -------
    bool or (n,) bool
        NaN anywhere counts as too long.
    """
    seat = pipe_area(values["needle_seat.diameter"])
    way = speed * dt
    moves = dt * dt * _stiffest(values, modulus * seat * seat) < RIGID * RIGID
    waves = (values["feed_pipe.length"] >= way) & (way * seat <= DRAWN * values["accumulation.volume"])
    return moves & waves


def _stiffest(values: Mapping[str, Any], enclosed: Any) -> Any:
    """Largest eigenvalue [1/s²] of the pair of masses, `enclosed` being K A² of the needle's tip [N m²]."""
    push = values["armature.contact_stiffness"]
    fuel = enclosed / values["sac.volume"] + enclosed / values["accumulation.volume"]
    a = (2.0 * push + values["armature.spring_stiffness"]) / values["armature.mass"]
    held = values["needle_seat.contact_stiffness"] + values["needle.spring_stiffness"] + fuel
    n = (push + held) / values["needle.mass"]
    coupling = push * push / (values["armature.mass"] * values["needle.mass"])
    return 0.5 * (a + n) + (0.25 * (a - n) * (a - n) + coupling) ** 0.5
