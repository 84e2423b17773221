"""Kinds of measured data by their `kind` in study files.

A new kind is registered here; one of an installed package by an entry point of the group "data".
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from operator import or_
from types import UnionType

from commonrail.base import registry
from commonrail.base.errors import InputError
from commonrail.data.base import DataSet, Role
from commonrail.data.curves.data import RateData
from commonrail.data.feature_targets.data import FeatureData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.quantities.returned import ReturnData

# By `kind` in files; an objective, a report and its tables take them in this order.
KINDS: Mapping[str, type[DataSet]] = {kind.kind: kind for kind in (RateData, QuantityData, ReturnData, FeatureData)}
ANY_KIND: UnionType = reduce(or_, (*KINDS.values(), DataSet))  # type: ignore[assignment]  # or_ of types is a union


def find_kind(name: str) -> type[DataSet] | None:
    """Kind of a name, that ships or is installed; None if there is none.

    Raises `PluginError` if that of an installed package cannot be loaded, derives from no `DataSet`, or has another
    name.
    """
    part = None if name in KINDS else registry.find("data", name)
    if part is None:
        return KINDS.get(name)
    found = part.part(type, "a class")
    if not issubclass(found, DataSet) or found.kind != name:
        raise part.refused(f'is to be a DataSet with kind = "{name}", and {part.target} is none')
    return found


def kind_of(name: str) -> type[DataSet]:
    """Kind of a name; see `find_kind`.

    Raises `InputError` if there is none: the package that had it is not installed.
    """
    if (found := find_kind(name)) is None:
        raise InputError(f'There is no kind of data "{name}"; install the package that has it.')
    return found


def kinds_of(names: Iterable[str]) -> list[type[DataSet]]:
    """Kinds of these names, each once: in the order of `KINDS`, those of installed packages by name behind them."""
    return [kind_of(name) for name in sorted(set(names), key=_place)]


def _place(name: str) -> tuple[int, str]:
    places = list(KINDS)
    return (places.index(name), "") if name in KINDS else (len(places), name)


def in_order(data: Sequence[DataSet]) -> tuple[DataSet, ...]:
    """Data sets by kind, in the order of `kinds_of`; those of one kind stay in theirs."""
    return tuple(sorted(data, key=lambda one: _place(one.kind)))


def of_role(data: Sequence[DataSet], role: Role) -> list[DataSet]:
    """Data sets of one role."""
    return [one for one in data if one.role is role]
