"""Settings of the staged least squares."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from commonrail.arguments import settle, whole
from commonrail.calibration.optimisers.base import MOST_GENERATIONS
from commonrail.errors import ConfigurationError

__all__ = ["StagedSettings"]

MOST_MEMBERS = 100_000  # far above what anybody calibrates; below what would fill the memory
MOST_STARTS = 1000
FEWEST_MEMBERS = 4  # a mutation combines three members other than the parent


@dataclass(frozen=True)
class StagedSettings:
    """Settings of `StagedLeastSquares`; the defaults suit parameters with priors.

    Parameters
    ----------
    members : int
        Candidates that are screened, at least 4.
    generations : int
        Steps after the screening: generations of the evolution, then iterations of the descents.
    evolution : int
        Generations of differential evolution of the best screened candidates before the descents; 0 for none. Without
        priors about 90 are needed.
    starts : int
        Descents that begin side by side.
    trial_iterations : int
        Iterations after which only the best descents continue; 0 lets all of them continue.
    finalists : int
        Descents that continue.
    stage_iterations : int
        Largest number of iterations with one difference step; then the next smaller one is used.

    Raises
    ------
    ConfigurationError
        If a number lies outside its range, or is not whole.
    """

    size: ClassVar[str] = "{members} screened candidates, {generations} steps"  # in words, of a report

    # "most" is what a study file may ask for
    members: int = field(default=400, metadata={"most": MOST_MEMBERS})
    generations: int = field(default=52, metadata={"most": MOST_GENERATIONS})
    evolution: int = field(default=0, metadata={"most": MOST_GENERATIONS})
    starts: int = field(default=3, metadata={"most": MOST_STARTS})
    trial_iterations: int = field(default=10, metadata={"most": MOST_GENERATIONS})
    finalists: int = field(default=1, metadata={"most": MOST_STARTS})
    stage_iterations: int = field(default=14, metadata={"most": MOST_GENERATIONS})

    def __post_init__(self) -> None:
        settle(
            self,
            members=whole(self.members, "members", FEWEST_MEMBERS, MOST_MEMBERS),
            generations=whole(self.generations, "generations", 0, MOST_GENERATIONS),
            evolution=whole(self.evolution, "evolution", 0, MOST_GENERATIONS),
            starts=whole(self.starts, "starts", 1, MOST_STARTS),
            trial_iterations=whole(self.trial_iterations, "trial_iterations", 0, MOST_GENERATIONS),
            finalists=whole(self.finalists, "finalists", 1, MOST_STARTS),
            stage_iterations=whole(self.stage_iterations, "stage_iterations", 1, MOST_GENERATIONS),
        )
        if self.starts > self.members:
            raise ConfigurationError(f"starts = {self.starts} must not exceed members = {self.members}.")
