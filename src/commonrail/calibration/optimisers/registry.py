"""The optimisers that a study can name: those that ship, and the group "optimisers" of installed packages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Any, NamedTuple

from commonrail.base import registry
from commonrail.base.errors import PluginError
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


def named(method: str) -> Registered | None:
    """The optimiser that a study names; None if there is none.

    Raises
    ------
    PluginError
        If that of an installed package cannot be loaded, is no `Registered`, or has another name.
    """
    own = next((entry for entry in REGISTERED if entry.name == method), None)
    part = None if own else registry.find("optimisers", method)
    return own if part is None else _of(part)


def _of(part: registry.Entry) -> Registered:
    found = part.part(Registered, "a Registered")
    if found.name != part.name:
        raise part.refused(f'has the method "{found.name}"')
    return found


def shipped_methods() -> list[str]:
    """Names of the optimisers that ship."""
    return [entry.name for entry in REGISTERED]


def methods() -> list[str]:
    """Names of all optimisers, those that ship first."""
    return [*shipped_methods(), *registry.installed("optimisers")]


def registered(settings: object) -> Registered | None:
    """The optimiser that settings belong to; None if they are no optimiser's."""
    return next((entry for entry in _all() if isinstance(settings, entry.settings)), None)


def _all() -> Iterator[Registered]:
    """All that can be loaded, those that ship first."""
    yield from REGISTERED
    for part in registry.installed("optimisers").values():
        with suppress(PluginError):  # another's settings do not depend on it
            yield _of(part)


def size_in_words(record: Mapping[str, Any]) -> str:
    """Size of a search in the words of its optimiser, such as "70 generations of 50 members".

    Parameters
    ----------
    record : mapping
        Key "method", and the settings by their names.
    """
    entry = None
    with suppress(PluginError):  # a report is made without it
        entry = named(record["method"])
    return str(getattr(entry and entry.settings, "size", EvolutionSettings.size).format(**record))
