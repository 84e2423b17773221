"""Conditions that a candidate must meet at operating points besides its fit to the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from commonrail.arguments import chosen, instance, settle
from commonrail.arrays import Bools, Floats
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK
from commonrail.kinds.simulator import Simulator
from commonrail.kinds.stops import past_stops

__all__ = ["Condition", "Wanted", "broken", "distances_past"]


NOTHING = 1e-12  # volume per stroke [m³] up to which nothing is injected: far below what a bench resolves


class Wanted(StrEnum):
    """Behaviour that is wanted of the injector at an operating point."""

    SUCCEEDS = "succeeds"
    """The simulation succeeds: the needle closes again, and no number runs away."""

    SHUT = "stays shut"
    """It succeeds and nothing is injected."""

    INJECTS = "injects"
    """It succeeds and something is injected."""

    NEEDLE_AT_STOP = "needle reaches its stop"
    """It succeeds and the plunger touches its upper stop."""

    NEEDLE_OFF_STOP = "needle stays off its stop"
    """It succeeds and the plunger does not touch its upper stop."""

    VALVE_AT_STOP = "valve reaches its stop"
    """It succeeds and the valve touches its stop."""

    VALVE_OFF_STOP = "valve stays off its stop"
    """It succeeds and the valve does not touch its stop."""


_AT = {Wanted.NEEDLE_AT_STOP, Wanted.VALVE_AT_STOP}
_OFF = {Wanted.NEEDLE_OFF_STOP, Wanted.VALVE_OFF_STOP}
_NEEDLE = {Wanted.NEEDLE_AT_STOP, Wanted.NEEDLE_OFF_STOP}


@dataclass(frozen=True)
class Condition:
    """Behaviour that is wanted at an operating point; a candidate without it loses.

    Parameters
    ----------
    wanted : Wanted
    point : OperatingPoint

    Raises
    ------
    ConfigurationError
        If an argument is of another kind.
    """

    wanted: Wanted
    point: OperatingPoint

    def __post_init__(self) -> None:
        settle(self, wanted=chosen(self.wanted, Wanted, "wanted"))
        instance(self.point, OperatingPoint, "point of a condition")


def broken(conditions: Sequence[Condition], batch: Batch, past: Floats | None = None) -> Bools:
    """Mask (candidates, conditions) of the conditions that candidates do not meet.

    Parameters
    ----------
    conditions : sequence of Condition
    batch : Batch
        Candidates at the points of the conditions, in order.
    past : (candidates, conditions), optional
        Of `distances_past`; needed where a condition is about a stop.
    """
    failed = batch.status != OK
    injects = batch.injected_mass / batch.reference_density > NOTHING
    shut = np.array([condition.wanted is Wanted.SHUT for condition in conditions])
    open_ = np.array([condition.wanted is Wanted.INJECTS for condition in conditions])
    found = np.asarray(failed | (injects & shut) | (~injects & open_))
    if past is None:
        return found
    at = np.array([condition.wanted in _AT for condition in conditions])
    off = np.array([condition.wanted in _OFF for condition in conditions])
    touches = past > 0.0  # False where the simulation failed, which breaks the condition anyway
    return np.asarray(found | (~touches & at) | (touches & off))


def distances_past(conditions: Sequence[Condition], simulator: Simulator, values: Floats) -> Floats | None:
    """Distances beyond the stop that each condition names, (candidates, conditions) [m]; None if none names a stop.

    NaN for conditions that name none, and for failed simulations. Each condition that does costs one more simulation,
    in f64.

    Parameters
    ----------
    conditions : sequence of Condition
    simulator : Simulator
    values : (candidates, names)
        [SI].
    """
    if not any(condition.wanted in _AT | _OFF for condition in conditions):
        return None
    found = np.full((len(values), len(conditions)), np.nan)
    for i, condition in enumerate(conditions):
        if condition.wanted in _AT | _OFF:
            past = past_stops(simulator, condition.point, values)
            found[:, i] = past.needle if condition.wanted in _NEEDLE else past.valve
    return found
