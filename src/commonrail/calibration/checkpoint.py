"""What a search tells of each step, so that it can be kept, and what it needs to go on from there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.optimisers import Optimiser
from commonrail.errors import StudyError

__all__ = ["Checkpoint", "CheckpointError", "Evolved", "Found", "Generation", "Recorder"]

Floats = NDArray[np.float64]

NOT_SIMULATED = -1  # in place of a status


class CheckpointError(StudyError):
    """A checkpoint is damaged, or another search's."""


class Evolved(NamedTuple):
    """One generation of trials and what became of them.

    Attributes
    ----------
    x : (n, d)
        The trials, SI.
    costs : (n,)
        +inf where a simulation failed or there was none.
    statuses : (n,) int8
        Values of `Status`; -1 for a trial that was not simulated.
    simulations : int
        Single injections that it took.
    """

    x: Floats
    costs: Floats
    statuses: NDArray[np.int8]
    simulations: int


class Generation(NamedTuple):
    """Objective after one generation: best so far, and mean of the population's finite ones."""

    generation: int
    best: float
    mean: float

    @classmethod
    def of(cls, generation: int, optimiser: Optimiser) -> Generation:
        """Of a search as it stands."""
        costs = optimiser.costs
        finite = costs[np.isfinite(costs)]
        return cls(generation, optimiser.best.cost, float(finite.mean()) if len(finite) else float("inf"))


class Found(NamedTuple):
    """A point (d,), SI, and its objective."""

    x: Floats
    cost: float


@dataclass(frozen=True)
class Checkpoint:
    """A search between two steps: all it needs to go on to the same bits.

    Attributes
    ----------
    evolution : mapping
        `DifferentialEvolution.state`.
    history : tuple of Generation
    simulations : int
        Single injections simulated.
    failures : mapping of str to int
        Failed candidates by the name of their status.
    refinements : int
        Refinements that are done.
    refined : Found or None
        The best of them, if it is better than the evolution's.
    hops : mapping or None
        State of the generator that draws the starts of refinements; None before the first.
    seconds : float
        Time spent [s].
    """

    evolution: Mapping[str, Any]
    history: tuple[Generation, ...]
    simulations: int = 0
    failures: Mapping[str, int] = field(default_factory=dict)
    refinements: int = 0
    refined: Found | None = None
    hops: Mapping[str, Any] | None = None
    seconds: float = 0.0


class Recorder(Protocol):
    """Keeps a search step by step; what it raises ends the search."""

    def evolved(self, trials: Evolved, after: Checkpoint) -> None:
        """Take one generation of the evolution."""
        ...

    def refined(self, start: Floats, end: Found, after: Checkpoint) -> None:
        """Take one refinement: where it began (d,) and ended."""
        ...
