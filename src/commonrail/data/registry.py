"""Kinds of measured data by their `kind` in study files: plug-ins of the group "data", imported when needed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from commonrail.base import registry
from commonrail.base.errors import InputError
from commonrail.data.base import DataSet, Role


def find_kind(name: str) -> type[DataSet] | None:
    """Kind of a name, shipped or installed, else None.

    Raises `PluginError` if the kind of an installed package cannot be loaded, derives from no `DataSet`, or has another
    name.
    """
    entry = registry.find("data", name)
    if entry is None:
        return None
    kind_class = entry.load_as(type, "a class")
    if not issubclass(kind_class, DataSet) or kind_class.kind != name:
        raise entry.part_error(f'must be a DataSet with kind = "{name}", and {entry.target} is not')
    return kind_class


def get_kind(name: str) -> type[DataSet]:
    """Kind of a name; see `find_kind`.

    Raises `InputError` for an unknown kind: its package is not installed.
    """
    if (kind := find_kind(name)) is None:
        raise InputError(f'There is no kind of data "{name}"; install the package that has it.', code="unknown-kind")
    return kind


def get_kinds(names: Iterable[str]) -> list[type[DataSet]]:
    """Kinds of these names, each once: shipped kinds in their order, then installed ones by name."""
    return [get_kind(name) for name in sorted(set(names), key=_place)]


def _place(name: str) -> tuple[int, str]:
    places = list(registry.find_shipped("data"))
    return (places.index(name), "") if name in places else (len(places), name)


def in_order(data: Sequence[DataSet]) -> tuple[DataSet, ...]:
    """Data sets sorted by kind, in the order of `get_kinds`; the order within a kind is kept."""
    return tuple(sorted(data, key=lambda data_set: _place(data_set.kind)))


def of_role(data: Sequence[DataSet], role: Role) -> list[DataSet]:
    """Data sets of one role."""
    return [data_set for data_set in data if data_set.role is role]
