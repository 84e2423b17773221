"""Entries of the catalogue: fuels, injectors, meters, features and parameters, by what they contain."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from commonrail.base.errors import CommonrailError
from commonrail.base.hooks import note
from commonrail.base.registry import part_digits

if TYPE_CHECKING:
    from commonrail.readers.part_number import PartMatch

_Found = TypeVar("_Found")
_SIGNS = re.compile(r"[^\S\n]|[._-]")


class Section(StrEnum):
    """Sections of the catalogue."""

    FUELS = "fuels"
    INJECTORS = "injectors"
    METERS = "meters"
    FEATURES = "features"
    PARAMETERS = "parameters"


class Entries(NamedTuple):
    """Entries of the catalogue by section, and the part numbers that a search has matched."""

    sections: dict[str, list[dict[str, Any]]]
    parts: tuple[PartMatch, ...]


def catalogue(section: Section | None = None, search: str = "") -> Entries:
    """List fuels, injectors, meters, features and parameters.

    Parameters
    ----------
    section : Section, optional
        All by default.
    search : str
        Text that the entries contain, or a part number, whole or in part.
    """
    from commonrail.readers.part_number import find_part

    sections = list(Section) if section is None else [Section(section)]
    parts = find_part(search) if Section.INJECTORS in sections and part_digits(search) else ()
    listed_injectors = {match.injector for match in parts}
    entries = {
        s.value: [e for e in _ENTRIES[s]() if _matches(e, search) or e["name"] in listed_injectors] for s in sections
    }
    return Entries(entries, tuple(parts))


def _fuels() -> list[dict[str, Any]]:
    from commonrail.readers.fuel import fuel_catalogue, load_fuel

    fuels = _load_all(load_fuel, fuel_catalogue()).values()
    return [{"name": f.name, "title": f.title, "mark": f.mark, "source": f.source} for f in fuels]


def _injectors() -> list[dict[str, Any]]:
    from commonrail.readers.injector import injector_catalogue, load_injector

    return [
        {"name": name, "title": i.title, "variant": i.variant.label, "synthetic": i.synthetic}
        for name, i in _load_all(load_injector, injector_catalogue()).items()
    ]


def _meters() -> list[dict[str, Any]]:
    from commonrail.base import registry
    from commonrail.readers.meters import installed_meter

    return [
        {"name": name, "law": f"{m.law.value}, order {m.order}", "quantities": ", ".join(m.values)}
        for name, m in _load_all(installed_meter, list(registry.find_installed("meters"))).items()
    ]


def _features() -> list[dict[str, Any]]:
    from commonrail.plugins.features.table import known_features

    return [
        {
            "name": feature.name,
            "unit": feature.unit,
            "meaning": feature.meaning,
            "found in": " and ".join(
                word
                for word, is_available in (("traces", feature.of_trace), ("simulations", feature.of_simulation))
                if is_available
            ),
        }
        for feature in known_features().values()
    ]


def _load_all(load: Callable[[str], _Found], names: Sequence[str]) -> dict[str, _Found]:
    """Files that can be loaded, by name; one of an installed package that cannot be is named in a warning."""
    injectors = {}
    for name in names:
        try:
            injectors[name] = load(name)
        except CommonrailError as error:
            note(f"commonrail: {error}")
    return injectors


def _parameters() -> list[dict[str, Any]]:
    from commonrail.physics.injector import parameter_quantities

    return [
        {
            "name": name,
            "unit": q.unit,
            "meaning": q.meaning,
            "must be": q.domain.value,
            "usual": list(q.usual or ()),
            "default": q.default,
        }
        for name, q in parameter_quantities().items()
    ]


_ENTRIES: dict[Section, Callable[[], list[dict[str, Any]]]] = {
    Section.FUELS: _fuels,
    Section.INJECTORS: _injectors,
    Section.METERS: _meters,
    Section.FEATURES: _features,
    Section.PARAMETERS: _parameters,
}


def _matches(entry: dict[str, Any], search: str) -> bool:
    """Return whether an entry contains a text; between words a blank, a point, a dash and none are equal."""
    text = "\n".join(map(str, entry.values()))
    return _SIGNS.sub("", search.casefold()) in _SIGNS.sub("", text.casefold())
