"""The optimisers that a study can name, and the row in which they run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from commonrail.calibration.optimisers.base import Optimiser
from commonrail.calibration.optimisers.covariance import CovarianceSettings, CovarianceStrategy
from commonrail.calibration.optimisers.differential_evolution import DifferentialEvolution
from commonrail.calibration.optimisers.evolution_settings import EvolutionSettings, check_initial
from commonrail.calibration.optimisers.multistart import MultiStartLeastSquares, MultiStartSettings
from commonrail.calibration.optimisers.refinement import Refinement, RefinementSettings
from commonrail.calibration.optimisers.simplex import NelderMead, NelderMeadSettings
from commonrail.calibration.optimisers.staged import StagedLeastSquares
from commonrail.calibration.optimisers.staged_settings import StagedSettings
from commonrail.calibration.optimisers.success_history import SuccessHistoryEvolution, SuccessHistorySettings
from commonrail.calibration.space import Space

if TYPE_CHECKING:
    from commonrail.calibration.study import Method

__all__ = ["REGISTERED", "Registered", "Stage", "registered", "row", "size_in_words"]

Stage = Callable[[Optimiser | None], Optimiser]
"""Begins an optimiser, given the one before it in the row."""


class Registered(NamedTuple):
    """An optimiser that a study can name.

    Attributes
    ----------
    begin : type
        The `Optimiser`, made of a space, a random generator and settings.
    settings : type
        Its `Settings`. The fields are keys of a study file's table [optimiser]; their metadata may limit them ("most").
        Its `size`, if it has one, is the template of `size_in_words`.
    checks : mapping of str to callable
        By the key to blame, what raises a ConfigurationError if settings do not suit a space.
    """

    begin: type[Any]
    settings: type[Any]
    checks: Mapping[str, Callable[[Any, Space], None]] = MappingProxyType({})

    @property
    def name(self) -> str:
        """Key `method` of that table."""
        return str(self.begin.method)


# The first one is what a study without the key `method` means.
REGISTERED = (
    Registered(DifferentialEvolution, EvolutionSettings, {"initial": check_initial}),
    Registered(StagedLeastSquares, StagedSettings),
    Registered(MultiStartLeastSquares, MultiStartSettings),
    Registered(SuccessHistoryEvolution, SuccessHistorySettings),
    Registered(CovarianceStrategy, CovarianceSettings),
    Registered(NelderMead, NelderMeadSettings),
)


def registered(settings: object) -> Registered | None:
    """The optimiser that settings belong to; None if they are no optimiser's."""
    return next((entry for entry in REGISTERED if isinstance(settings, entry.settings)), None)


def size_in_words(record: Mapping[str, Any]) -> str:
    """Size of a search in the words of its optimiser, such as "70 generations of 50 members".

    Parameters
    ----------
    record : mapping
        Key "method", and the settings by their names.
    """
    entry = next((entry for entry in REGISTERED if entry.name == record["method"]), REGISTERED[0])
    return str(getattr(entry.settings, "size", EvolutionSettings.size).format(**record))


def row(method: Method, space: Space, seed: int, same_bits: bool = False, squares: bool = False) -> list[Stage]:
    """Optimisers of a study in the order in which they run: the one that it names, then refinements of what that found.

    Parameters
    ----------
    method : Method
    space : Space
    seed : int
        Of all their draws.
    same_bits : bool
        Take methods whose bits do not depend on the processor.
    squares : bool
        The squares of the residuals sum to the objective; see `RefinementSettings`.
    """
    first = registered(method.evolution)
    assert first is not None  # Method has checked it
    stages: list[Stage] = [lambda _: first.begin(space, np.random.default_rng(seed), method.evolution)]
    if method.polish:
        settings = RefinementSettings(method.polish, method.polish_iterations, same_bits, squares)
        stages.append(lambda before: Refinement(space, seed, settings, before))  # type: ignore[arg-type]
    return stages
