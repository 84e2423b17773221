"""What every optimiser offers: it proposes trials, is told their costs, and never simulates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from commonrail.errors import StudyError

__all__ = ["Best", "Counts", "Optimiser", "Trials", "clean_costs"]

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Trials(NamedTuple):
    """Points (n, d) to be tried, SI, and which of them (n,) are to be simulated.

    A trial that the treatment of constraints rejects is not simulated; whatever cost is told for
    it is ignored.
    """

    x: FloatArray
    simulate: BoolArray


class Best(NamedTuple):
    """The best feasible point (d,) so far, SI, and its cost: +inf until a simulation succeeds."""

    x: FloatArray
    cost: float


@dataclass(frozen=True)
class Counts:
    """What a search has used: slots offered, trials simulated, and simulations that failed."""

    slots: int = 0
    simulated: int = 0
    failed: int = 0

    def plus(self, costs: FloatArray, simulate: BoolArray) -> Counts:
        """These counts and those of one batch, with its cleaned costs (n,) and mask (n,)."""
        return Counts(
            self.slots + len(costs),
            self.simulated + int(simulate.sum()),
            self.failed + int((simulate & ~np.isfinite(costs)).sum()),
        )


class Optimiser(Protocol):
    """A search as a conversation: `ask` for trials, simulate them elsewhere, `tell` their costs.

    `ask` repeats itself until it is answered. `state` then describes the search as it was before
    that `ask`, so that a search restored from it asks for the same trials, bit by bit.
    """

    def ask(self) -> Trials:
        """Return the next trials; raise StudyError once the search has finished."""
        ...

    def tell(self, costs: ArrayLike) -> None:
        """Take the costs (n,) of the trials asked for; a cost that is not finite never wins."""
        ...

    @property
    def finished(self) -> bool:
        """Whether the search has stopped."""
        ...

    @property
    def reason(self) -> str:
        """Why it has stopped; empty while it has not."""
        ...

    @property
    def best(self) -> Best:
        """The best feasible point so far."""
        ...

    @property
    def population(self) -> FloatArray:
        """The members (n, d) kept so far, SI; no rows before the first `tell`."""
        ...

    @property
    def costs(self) -> FloatArray:
        """Costs (n,) of the members; +inf for failed or infeasible ones."""
        ...

    @property
    def counts(self) -> Counts:
        """Slots, simulations and failures so far."""
        ...

    def state(self) -> dict[str, Any]:
        """Everything needed to go on later: arrays, numbers and the generator's state."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from `state`, given by a search with the same space and settings."""
        ...


def clean_costs(costs: ArrayLike, simulate: BoolArray) -> FloatArray:
    """Costs (n,) with +inf for trials not simulated and for costs that are not finite.

    Raises
    ------
    StudyError
        If there is not one cost for each trial.
    """
    told = np.asarray(costs, dtype=float)
    if told.shape != simulate.shape:
        raise StudyError(
            f"costs: an array of shape {told.shape} was told for {len(simulate)} trials, expected "
            "one cost for each trial in the order asked for"
        )
    return np.where(simulate & np.isfinite(told), told, np.inf)
