"""Kinds of measured data: one object each, with all that the house does with data; a new kind is registered here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from types import UnionType

from commonrail.kinds.base import DataSet, Role, Score
from commonrail.kinds.curves.data import RateData, RateScore
from commonrail.kinds.features.data import FeatureData, FeatureScore
from commonrail.kinds.maps.data import QuantityData, QuantityScore
from commonrail.kinds.maps.returned import ReturnData

__all__ = [
    "ANY_KIND",
    "KINDS",
    "DataSet",
    "FeatureData",
    "FeatureScore",
    "QuantityData",
    "QuantityScore",
    "RateData",
    "RateScore",
    "ReturnData",
    "Role",
    "Score",
    "in_order",
    "of_role",
]

# By `kind` in files; an objective, a report and its tables take them in this order.
KINDS: Mapping[str, type[DataSet]] = {kind.kind: kind for kind in (RateData, QuantityData, ReturnData, FeatureData)}
ANY_KIND: UnionType = reduce(or_, KINDS.values())  # type: ignore[assignment]  # or_ of types is a union


def in_order(data: Sequence[DataSet]) -> tuple[DataSet, ...]:
    """Data sets by kind, in the order of `KINDS`; those of one kind stay in theirs."""
    places = list(KINDS)
    return tuple(sorted(data, key=lambda one: places.index(one.kind)))


def of_role(data: Sequence[DataSet], role: Role) -> list[DataSet]:
    """Data sets of one role."""
    return [one for one in data if one.role is role]
