"""Protocol of the optimisers: each proposes trials, is told what became of them, and never simulates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError, StudyError

__all__ = [
    "MOST_GENERATIONS",
    "Best",
    "Counts",
    "Optimiser",
    "Settings",
    "Trials",
    "Wanted",
    "check_origin",
    "clean_costs",
    "origin",
    "restore_generator",
]

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MOST_GENERATIONS = 1_000_000  # far above what anybody calibrates; below what would fill the memory


class Wanted(Enum):
    """Answers that an optimiser asks for."""

    COSTS = "costs"
    """One for each trial (n,)."""

    RESIDUALS = "residuals"
    """One row for each trial (n, m)."""

    COSTS_AGAIN = "costs again"
    """Costs of points whose residuals were told before; their simulations are not counted twice."""


class Trials(NamedTuple):
    """Points (n, d) to be tried, SI, which of them (n,) are to be simulated, and what is asked of them.

    A trial that the treatment of constraints rejects is not simulated; whatever is told of it is ignored.
    """

    x: FloatArray
    simulate: BoolArray
    wanted: Wanted = Wanted.COSTS


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


class Settings(Protocol):
    """Settings of an optimiser: a frozen dataclass whose fields are the keys of a study file."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def members(self) -> int:
        """Trials of a step."""
        ...

    @property
    def generations(self) -> int:
        """Steps after the first one; a finished search can be lengthened by more of them."""
        ...


class Optimiser(Protocol):
    """A search as a conversation: `ask` for trials, simulate them elsewhere, `tell` what became of them.

    `ask` repeats itself until it is answered. A step may take several questions; `steps` counts those that are done.
    `state` describes the search as it was after the last of them, so that one restored from it asks for the same
    trials, bit by bit. Nobody else looks into it.
    """

    @property
    def phase(self) -> str:
        """What it does, in a word for the user."""
        ...

    @property
    def steps(self) -> int:
        """Steps done."""
        ...

    @property
    def total(self) -> int:
        """Steps wanted."""
        ...

    def ask(self) -> Trials:
        """Return the next trials; raise StudyError once the search has finished."""
        ...

    def tell(self, answers: ArrayLike) -> None:
        """Take what was asked for: costs (n,) or residuals (n, m); one that is not finite never wins."""
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
        """Points (n, d) from which another optimiser may go on, SI; no rows before the first step."""
        ...

    @property
    def costs(self) -> FloatArray:
        """Costs (n,) of those points; +inf for failed or infeasible ones."""
        ...

    @property
    def counts(self) -> Counts:
        """Slots, simulations and failures so far."""
        ...

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later: texts, numbers and arrays, in lists and mappings."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from `state`, given by a search with the same space and settings, but for `generations`.

        Raises
        ------
        ConfigurationError
            If it is another search's.
        """
        ...


def origin(method: str, space: Space, **settings: Any) -> dict[str, Any]:
    """What a state must share with the search that takes it up: optimiser, parameters, bounds and `settings`."""
    return {
        "method": method,
        **settings,
        "names": list(space.names),
        "lower": space.lower.copy(),
        "upper": space.upper.copy(),
    }


def check_origin(state: Mapping[str, Any], mine: Mapping[str, Any]) -> None:
    """Refuse the state of another search.

    Raises
    ------
    ConfigurationError
        If it does not share `mine`.
    """
    for key, value in mine.items():
        if key not in state or not np.array_equal(state[key], value):
            raise ConfigurationError(
                f"state: its {key} differs from this search's: restore it with the space and settings that it was "
                "saved with"
            )


def restore_generator(rng: np.random.Generator, state: Mapping[str, Any]) -> None:
    """Go on with the draws that a state kept under "rng".

    Raises
    ------
    ConfigurationError
        If it has none for this kind of generator.
    """
    try:
        rng.bit_generator.state = state["rng"]
    except (KeyError, TypeError, ValueError) as error:
        kind = type(rng.bit_generator).__name__
        raise ConfigurationError(
            f"state: it holds no state for a {kind} generator, use the kind it was saved with"
        ) from error


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
