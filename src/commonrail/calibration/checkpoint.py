"""Steps of a search as they are told, so that they can be kept, and the state from which it goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from commonrail.arrays import Floats
from commonrail.calibration.optimisers import Optimiser
from commonrail.errors import StudyError

__all__ = ["Checkpoint", "CheckpointError", "Generation", "Recorder", "Stage", "Step"]


NOT_SIMULATED = -1  # in place of a status


class CheckpointError(StudyError):
    """A checkpoint is damaged, or another search's."""


class Step(NamedTuple):
    """One step of an optimiser: the trials whose costs it was told, and what became of them.

    Attributes
    ----------
    x : (n, d)
        The trials, SI.
    costs : (n,)
        +inf where a simulation failed or there was none.
    statuses : (n,) int8
        Values of `Status`; -1 for a trial that was not simulated.
    simulations : int
        Single injections that the step took.
    """

    x: Floats
    costs: Floats
    statuses: NDArray[np.int8]
    simulations: int


class Generation(NamedTuple):
    """Objective after a step: best so far, and mean of the population's finite ones."""

    generation: int
    best: float
    mean: float

    @classmethod
    def of(cls, generation: int, optimiser: Optimiser) -> Generation:
        """Of a search as it stands."""
        costs = optimiser.costs
        finite = costs[np.isfinite(costs)]
        return cls(generation, optimiser.best.cost, float(finite.mean()) if len(finite) else float("inf"))


class Stage(NamedTuple):
    """A search after the latest step of one of its optimisers.

    Attributes
    ----------
    state : mapping
        `Optimiser.state`.
    simulations : int
        Single injections so far.
    failures : mapping of str to int
        Failed candidates of the first optimiser by the name of their status.
    seconds : float
        Time spent so far [s].
    """

    state: Mapping[str, Any]
    simulations: int
    failures: Mapping[str, int]
    seconds: float


@dataclass(frozen=True)
class Checkpoint:
    """A search between two steps: all it needs to go on to the same bits.

    Attributes
    ----------
    stages : tuple of Stage
        One for each optimiser that has begun, in the order in which they run.
    history : tuple of Generation
        Of the first one.
    """

    stages: tuple[Stage, ...]
    history: tuple[Generation, ...]


class Recorder(Protocol):
    """Keeps a search step by step; what it raises ends the search."""

    def step(self, step: Step, reached: Generation, after: Checkpoint) -> None:
        """Take one step of the last of the checkpoint's stages.

        Parameters
        ----------
        step : Step
        reached : Generation
            Objective after it.
        after : Checkpoint
        """
        ...
