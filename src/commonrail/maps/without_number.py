"""Combinations of a sweep that have no number: how many, for which reasons, and the first of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.engine.status import OK, Status
from commonrail.maps.base_point import AFTER
from commonrail.units import to_text

if TYPE_CHECKING:
    from commonrail.maps.sweep import Sweep

__all__ = ["WithoutNumber", "most_frequent", "reason_of", "without_number"]

# Statuses whose cure is another one in a sweep, which has no horizon; nor has it bounds, see `reason_of`.
_SENTENCES = {
    Status.STILL_INJECTING: (
        f"The needle was still open {to_text(AFTER, 's')} after the last energising, so the quantity is not known."
    ),
}


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


def reason_of(status: Status) -> str:
    """Sentence of a status, as it is in a sweep."""
    return _SENTENCES.get(status, status.sentence.replace("narrow the bounds", "other values"))


def most_frequent(statuses: NDArray[np.integer]) -> str:
    """Sentence of the status that most simulations ended with."""
    kinds, counts = np.unique(statuses, return_counts=True)
    return reason_of(Status(int(kinds[np.argmax(counts)])))


def without_number(found: Sweep) -> list[WithoutNumber]:
    """Reasons for missing numbers, the most frequent first."""
    groups = [*_groups(found, found.status, False)]
    groups += _groups(found, np.where(found.status == OK, found.first_status, OK), True)
    return sorted(groups, key=lambda group: (group.alone, -group.combinations))


def _groups(found: Sweep, statuses: NDArray[np.int64], alone: bool) -> Iterator[WithoutNumber]:
    for status in np.unique(statuses[statuses != OK]).tolist():
        places = np.argwhere(statuses == status)
        first = {v.name: float(v.values[i]) for v, i in zip(found.variables, places[0].tolist(), strict=True)}
        yield WithoutNumber(Status(status), len(places), first, alone)
