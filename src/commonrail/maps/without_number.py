"""Combinations of a sweep that have no number: how many, for which reasons, and the first of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Ints
from commonrail.engine.status import OK, Status
from commonrail.maps.sweep import Sweep, reason_of

__all__ = ["WithoutNumber", "without_number"]


class WithoutNumber(NamedTuple):
    """Combinations that have no number for one reason.

    Attributes
    ----------
    status : Status
    combinations : int
    first : mapping of str to float
        Values of the variables at the first of them [SI].
    alone : bool
        The first of two injections failed alone, so that the second one's quantity alone is not known.
    """

    status: Status
    combinations: int
    first: Mapping[str, float]
    alone: bool = False

    @property
    def sentence(self) -> str:
        """Reason and cure."""
        return reason_of(self.status)


def without_number(found: Sweep) -> list[WithoutNumber]:
    """Reasons for missing numbers, the most frequent first."""
    groups = [*_groups(found, found.status, False)]
    groups += _groups(found, np.where(found.status == OK, found.first_status, OK), True)
    return sorted(groups, key=lambda group: (group.alone, -group.combinations))


def _groups(found: Sweep, statuses: Ints, alone: bool) -> Iterator[WithoutNumber]:
    for status in np.unique(statuses[statuses != OK]).tolist():
        places = np.argwhere(statuses == status)
        first = {v.name: float(v.values[i]) for v, i in zip(found.variables, places[0].tolist(), strict=True)}
        yield WithoutNumber(Status(status), len(places), first, alone)
