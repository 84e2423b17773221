"""The optimisers that a study can name: those of this folder, and the group "optimisers" of plug-ins."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from commonrail.base import registry
from commonrail.base.errors import PluginError
from commonrail.calibration import optimisers
from commonrail.calibration.optimisers.base import Optimiser, Registered
from commonrail.calibration.optimisers.evolution import EvolutionSettings


def _registered() -> tuple[Registered, ...]:
    """`REGISTERED` of the modules of this folder; differential evolution first, which a study means that names none."""
    names = [module.name for module in iter_modules(optimisers.__path__) if module.name != "registry"]
    names.sort(key=lambda name: (name != "evolution", name))
    modules = (import_module(f"{optimisers.__name__}.{name}") for name in names)
    return tuple(module.REGISTERED for module in modules if hasattr(module, "REGISTERED"))


REGISTERED = _registered()


def find_optimiser(method: str) -> Registered | None:
    """The optimiser that a study names; None if there is none.

    Raises `PluginError` if that of a plug-in cannot be loaded, is no `Registered`, or has another name.
    """
    shipped = next((entry for entry in REGISTERED if entry.name == method), None)
    registration = None if shipped else registry.find("optimisers", method)
    return shipped if registration is None else _of(registration)


def _of(entry: registry.Entry) -> Registered:
    optimiser = entry.load_as(Registered, "a Registered")
    if optimiser.name != entry.name:
        raise entry.part_error(f'has the method "{optimiser.name}"')
    return optimiser


def shipped_methods() -> list[str]:
    """Names of the optimisers that ship."""
    return [*(entry.name for entry in REGISTERED), *registry.find_shipped("optimisers")]


def methods() -> list[str]:
    """Names of all optimisers, those that ship first."""
    return [*shipped_methods(), *registry.find_installed("optimisers")]


def registered(settings: object) -> Registered | None:
    """The optimiser that settings belong to; None if they are no optimiser's."""
    return next((entry for entry in _all() if isinstance(settings, entry.settings)), None)


def blamed(optimiser: type[Optimiser]) -> AbstractContextManager[None]:
    """Name the installed package of an optimiser in what its code raises inside, as `Entry.blame`."""
    if optimiser.__module__.startswith(f"{registry.PACKAGE}."):
        return nullcontext()  # without a search for installed packages, which takes longer than many a fit
    entry = registry.find_installed("optimisers").get(optimiser.method)
    return nullcontext() if entry is None else entry.blame("fails")


def _all() -> Iterator[Registered]:
    """All that can be loaded, those that ship first."""
    yield from REGISTERED
    for parts in (registry.find_shipped, registry.find_installed):
        for entry in parts("optimisers").values():
            with suppress(PluginError):  # another's settings do not depend on it
                yield _of(entry)


def size_in_words(record: Mapping[str, Any]) -> str:
    """Size of a search in the words of its optimiser, such as "70 generations of 50 members".

    `record`: key "method", and the settings by their names.
    """
    entry = None
    with suppress(PluginError):  # a report is made without it
        entry = find_optimiser(record["method"])
    return str(getattr(entry and entry.settings, "size", EvolutionSettings.size).format(**record))
