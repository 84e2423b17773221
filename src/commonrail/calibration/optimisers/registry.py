"""The optimisers that a study can name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from commonrail.calibration.optimisers.evolution import DifferentialEvolution, EvolutionSettings, check_initial
from commonrail.calibration.optimisers.multistart import MultiStartLeastSquares, MultiStartSettings
from commonrail.calibration.optimisers.staged import StagedLeastSquares, StagedSettings
from commonrail.calibration.space import Space


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
