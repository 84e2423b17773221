"""Settings of differential evolution; the defaults are the paper's."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar

from commonrail.arguments import array, chosen, number, settle, whole
from commonrail.calibration.optimisers.base import MOST_GENERATIONS
from commonrail.calibration.optimisers.treatments import Treatment
from commonrail.calibration.sampling import reference_start
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError

__all__ = ["EvolutionSettings", "InitialSampling", "check_initial"]

FEWEST_MEMBERS = 4
MOST_MEMBERS = 100_000  # far above what anybody calibrates; below what would fill the memory
MOST_REDRAWS = 1000


class InitialSampling(StrEnum):
    """Sampling of the initial population."""

    FEASIBLE = "feasible"
    """Uniformly where bounds and constraints hold, by `sample_feasible`."""

    UNIFORM = "uniform"
    """Uniformly in the bounds, Eq. (17), then treated as trials are."""

    REFERENCE = "reference"
    """As FEASIBLE, with the reference values (the paper's theoretical ones) in place of the first draw."""


@dataclass(frozen=True)
class EvolutionSettings:
    """Settings of `DifferentialEvolution`; the defaults are the paper's (70, 50).

    Parameters
    ----------
    members : int
        Population size N_pop, at least 4.
    generations : int
        Generations G_max after the initial population: (1 + G_max) N_pop slots in all.
    crossover : float
        CR of Eq. (19), from 0 to 1.
    factor : tuple of float
        Range that F of Eq. (18) is drawn from, anew for each member and parameter.
    treatment : Treatment
        What becomes of trials that break bounds or constraints.
    initial : InitialSampling
        How the initial population is drawn.
    redraws : int
        Mutations drawn again for an infeasible trial at most, if `treatment` resamples.

    Raises
    ------
    ConfigurationError
        If a number lies outside its range, or is not whole where it counts something.
    """

    size: ClassVar[str] = "{generations} generations of {members} members"  # in words, of a report

    # "most" is what a study file may ask for
    members: int = field(default=50, metadata={"most": MOST_MEMBERS})
    generations: int = field(default=70, metadata={"most": MOST_GENERATIONS})
    crossover: float = 0.8
    factor: tuple[float, float] = (0.4, 1.0)
    treatment: Treatment = Treatment.REPAIR
    initial: InitialSampling = InitialSampling.FEASIBLE
    redraws: int = field(default=10, metadata={"most": MOST_REDRAWS})

    def __post_init__(self) -> None:
        factor = array(self.factor, "1", "factor", 1).tolist()
        if len(factor) != 2:
            raise ConfigurationError(f"factor = {self.factor} must be a range of two numbers, such as (0.4, 1.0).")
        settle(
            self,
            members=whole(self.members, "members", -MOST_MEMBERS, MOST_MEMBERS),
            generations=whole(self.generations, "generations", -MOST_GENERATIONS, MOST_GENERATIONS),
            crossover=number(self.crossover, "1", "crossover"),
            factor=tuple(factor),
            treatment=chosen(self.treatment, Treatment, "treatment"),
            initial=chosen(self.initial, InitialSampling, "initial"),
            redraws=whole(self.redraws, "redraws", -MOST_GENERATIONS, MOST_GENERATIONS),
        )
        if self.members < FEWEST_MEMBERS:
            raise ConfigurationError(
                f"members = {self.members} must be at least {FEWEST_MEMBERS}: a mutation combines "
                "three members other than the parent."
            )
        if self.generations < 0:
            raise ConfigurationError(f"generations = {self.generations} must be 0 or more.")
        if not 0.0 <= self.crossover <= 1.0:
            raise ConfigurationError(f"crossover = {self.crossover:g} must lie between 0 and 1.")
        if not 0.0 < self.factor[0] <= self.factor[1] <= 2.0:
            raise ConfigurationError(
                f"factor = {self.factor[0]:g} to {self.factor[1]:g} must be an ascending range above 0 and not above 2."
            )
        if self.redraws < 1:
            raise ConfigurationError(f"redraws = {self.redraws} must be 1 or more.")

    @property
    def slots(self) -> int:
        """Trials offered in all, (1 + G_max) N_pop."""
        return (1 + self.generations) * self.members


def check_initial(settings: EvolutionSettings, space: Space) -> None:
    """Refuse to start from reference values that break a bound or a constraint.

    Raises
    ------
    ConfigurationError
        If they do, and the settings' `initial` asks for them.
    """
    if settings.initial is InitialSampling.REFERENCE:
        reference_start(space)
