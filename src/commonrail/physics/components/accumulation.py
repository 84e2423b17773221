"""Accumulation volume around the needle, fed by the pipe, Eq. (3)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.flow.volume import Contents
from commonrail.physics.parameters import Q


class Parameters(NamedTuple):
    """Drawing of the accumulation volume."""

    volume: Annotated[float, Q("m3", "accumulation volume, needle unloaded on its seat", usual=(5e-9, 2e-5))]


class State(NamedTuple):
    """Fuel in the volume, and its pressure one step before [Pa]."""

    fuel: Contents
    pressure_before: float
