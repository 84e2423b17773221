"""Conditions that a candidate must meet at operating points besides its fit to the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from commonrail.arguments import chosen, instance, settle
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK

__all__ = ["Condition", "Wanted", "broken"]

Bools = NDArray[np.bool_]

NOTHING = 1e-12  # volume per stroke [m³] up to which nothing is injected: far below what a bench resolves


class Wanted(StrEnum):
    """Behaviour that is wanted of the injector at an operating point."""

    SUCCEEDS = "succeeds"
    """The simulation succeeds: the needle closes again, and no number runs away."""

    SHUT = "stays shut"
    """It succeeds and nothing is injected."""

    INJECTS = "injects"
    """It succeeds and something is injected."""


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


def broken(conditions: Sequence[Condition], batch: Batch) -> Bools:
    """Mask (candidates, conditions) of the conditions that candidates do not meet.

    Parameters
    ----------
    conditions : sequence of Condition
    batch : Batch
        Candidates at the points of the conditions, in order.
    """
    failed = batch.status != OK
    injects = batch.injected_mass / batch.reference_density > NOTHING
    shut = np.array([condition.wanted is Wanted.SHUT for condition in conditions])
    open_ = np.array([condition.wanted is Wanted.INJECTS for condition in conditions])
    return np.asarray(failed | (injects & shut) | (~injects & open_))
